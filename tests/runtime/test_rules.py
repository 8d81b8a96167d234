"""Names that are not known, and what they are near to."""

import pytest

from fabric_fenicsx.runtime.rules import did_you_mean, unknown_key


@pytest.mark.parametrize(
    "word, allowed, hint",
    [
        ("thiknes", ("thickness", "width"), " (did you mean thickness?)"),
        ("Thickness", ("thickness", "width"), " (did you mean thickness?)"),
        ("mpa", ("MPa", "kPa"), " (did you mean MPa?)"),
        ("material", ("fabric", "metal"), " (did you mean fabric?)"),
        ("Materials", ("fabric", "metal"), " (did you mean fabric?)"),
        ("material", ("warp", "weft"), ""),
        ("xyz", ("warp", "weft"), ""),
        (3, ("warp", "weft"), ""),
    ],
)
def test_a_name_is_told_by_spelling_or_by_what_others_call_it(word, allowed, hint):
    assert did_you_mean(word, allowed) == hint


def test_an_unknown_key_is_told_with_those_allowed():
    assert str(unknown_key("heigth", ("width", "height"), "key heigth")) == (
        "key heigth is unknown (did you mean height?); allowed are width, height"
    )
