"""Rules of single numbers and fields, and how numbers are told."""

import json
import math
from dataclasses import dataclass

import numpy as np
import pytest

from fabric_fenicsx.core import formatting, rules
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.core.fields import check_fields, choice, flag, quantity
from fabric_fenicsx.core.files import failure_reason
from fabric_fenicsx.core.rules import COUNT, POSITIVE


@pytest.mark.parametrize(
    "wrong",
    ["0.5", None, True, 0.5 + 0j, math.nan, math.inf, [0.5], np.array([1.0, 2.0]), np.array("1")],
    ids=repr,
)
def test_a_rule_refuses_what_is_no_finite_number(wrong):
    for rule in (rules.FINITE, rules.POSITIVE, rules.COUNT):
        with pytest.raises(InputError, match=r"^`size` is .*; expected "):
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
    told = "key heigth is unknown (did you mean height?); expected width, height"
    assert str(rules.unknown_key("heigth", ("width", "height"), "key heigth")) == told


@dataclass
class Made:
    size: float = quantity(2, POSITIVE, "of it [mm]", doubt=(5.0, "is it in um?"))
    nx: int = quantity(None, COUNT, "cells")
    kind: str = choice("a", ("a", "b"), "which")
    fast: bool = flag("quickly")


def test_fields_are_checked_and_doubted_above_their_bound():
    made = Made(size=5, nx=2.0)
    assert check_fields(made) == [] and (made.nx, type(made.size)) == (2, float)
    assert check_fields(Made(5.1)) == ["`size` is 5.1, which is large: is it in um?"]
    for wrong in ({"size": None}, {"nx": 0}, {"kind": "c"}, {"fast": 1}):
        with pytest.raises(InputError, match=f"`{[*wrong][0]}` is .*; expected"):
            check_fields(Made(**wrong))


def test_the_reason_of_a_run_that_failed(tmp_path):
    file = tmp_path / "summary.json"
    assert failure_reason(file) == ""
    for summary, reason in (
        ({}, ""),
        ({"converged": True, "reason": "full load"}, ""),
        ({"converged": False, "reason": "gave up"}, "gave up"),
        ({"converged": False}, "no reason given"),
    ):
        file.write_text(json.dumps(summary))
        assert failure_reason(file) == reason


@pytest.mark.parametrize(
    "number, digits, text",
    [
        (1234.5, 3, "1230"),
        (123456.0, 3, "123000"),
        (999999.0, 3, "1e6"),
        (1.2e-7, 3, "1.2e-7"),
        (0.00012, 3, "0.00012"),
        (-0.0, 3, "0"),
        (math.inf, 3, "inf"),
    ],
)
def test_numbers_are_told_without_an_exponent_that_is_not_needed(number, digits, text):
    assert formatting.rounded(number, digits) == text


def test_errors_shares_and_places():
    """An error is rounding up to 1e-12 of the number, at least of 1."""
    error, share = formatting.with_error, formatting.share
    assert error("5", 5.0, 4e-12) == error("5", 0.5, 0.9e-12) == "5 +- 0"
    assert error("5", 0.5, 1.1e-12) == "5 +- 1.1e-12"
    told = (error("5", 5.0, 6e-12), error("x", 2.0, 0.123), error("x", 2.0, None))
    assert told == ("5 +- 6e-12", "x +- 0.12", "x +- unknown")
    assert (share(3, -2), share(0, 0)) == (1.5, 0) and share(1, 0) > 1e99
    told = [formatting.percent(each) for each in (0.123, 0.00003, 9.9, 10.1)]
    assert told == ["12 %", "0.003 %", "990 %", "more than 1000 %"]
    assert formatting.coordinates([1e-12, -1e-12, 1234.56]) == "(0, 0, 1235)"
    assert formatting.of_sheet([1, 2]) == "(1, 2) mm of the flat sheet"
    assert formatting.of_sheet([1, 2, 3]) == "(1, 2, 3) mm of the undeformed sheet"
