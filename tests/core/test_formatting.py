"""Numbers in sentences."""

import math

import pytest

from fabric_fenicsx.core import formatting


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
