"""Rules for numbers, and names that are not known."""

import math

import numpy as np
import pytest

from fabric_fenicsx.core import rules
from fabric_fenicsx.core.errors import InputError


@pytest.mark.parametrize(
    "wrong",
    ["0.5", None, True, 0.5 + 0j, math.nan, math.inf, [0.5], np.array([1.0, 2.0]), np.array("1")],
    ids=repr,
)
def test_a_rule_refuses_what_is_no_finite_number(wrong):
    for rule in (rules.FINITE, rules.POSITIVE, rules.COUNT):
        with pytest.raises(InputError, match=r"^`size` is .*; allowed is "):
            rule.check("`size`", wrong)


def test_a_rule_takes_numbers_of_numpy_and_gives_those_of_python():
    for given in (2, 2.0, np.float64(2), np.float32(2), np.int64(2), np.array(2.0)):
        assert type(rules.FINITE.check("size", given)) is float
        assert type(rules.COUNT.check("nx", given)) is int
    assert math.copysign(1, rules.FINITE.check("size", -0.0)) == 1


@pytest.mark.parametrize(
    "rule, least, most, beyond",
    [
        (rules.POSITIVE, 1e-9, 1e300, (0, -1)),
        (rules.ABOVE_ZERO_OR_INF, 1e-9, math.inf, (0, -math.inf)),
        (rules.FROM_ZERO, 0, 1e300, (-1e-9,)),
        (rules.COUNT, 1, 10**9, (0, 1.5)),
        (rules.SHARE, 1e-9, 1, (0, 1 + 1e-9)),
        (rules.fraction(), 0, 1, (-1e-9, 1 + 1e-9)),
        (rules.BELOW_180, 1e-9, 180 - 1e-9, (0, 180)),
    ],
)
def test_a_rule_allows_its_ends_and_nothing_beyond(rule, least, most, beyond):
    assert (rule.check("x", least), rule.check("x", most)) == (least, most)
    for wrong in beyond:
        with pytest.raises(InputError):
            rule.check("x", wrong)


def test_a_name_is_told_by_spelling_or_by_what_others_call_it():
    for word, allowed, hint in (
        ("thiknes", ("thickness", "width"), " (did you mean thickness?)"),
        ("mpa", ("MPa", "kPa"), " (did you mean MPa?)"),
        ("material", ("fabric", "metal"), " (did you mean fabric?)"),
        ("material", ("warp", "weft"), ""),
        (3, ("warp", "weft"), ""),
    ):
        assert rules.did_you_mean(word, allowed) == hint
    assert str(rules.unknown_key("heigth", ("width", "height"), "key heigth")) == (
        "key heigth is unknown (did you mean height?); allowed are width, height"
    )
