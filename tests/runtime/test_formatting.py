"""Numbers in sentences."""

import math

import pytest

from fabric_fenicsx.runtime.formatting import coordinates, of_sheet, percent, rounded


@pytest.mark.parametrize(
    "number, digits, text",
    [
        (1234.5, 3, "1230"),
        (12345.6, 4, "12350"),
        (999999.0, 3, "1e6"),
        (1.2e-7, 3, "1.2e-7"),
        (0.00012, 3, "0.00012"),
        (-0.0, 3, "0"),
        (math.inf, 3, "inf"),
    ],
)
def test_numbers_are_told_without_an_exponent_that_is_not_needed(number, digits, text):
    assert rounded(number, digits) == text


@pytest.mark.parametrize(
    "share, text",
    [(0.996, "100 %"), (0.123, "12 %"), (0.00003, "0.003 %"), (6900.0, "more than 1000 %")],
)
def test_shares_are_told_in_per_cent(share, text):
    assert percent(share) == text


def test_places_have_no_negative_zero():
    assert coordinates([1e-12, -1e-12, 1234.56]) == "(0, 0, 1235)"


def test_a_place_of_a_sheet_that_is_not_flat_has_three_coordinates():
    assert of_sheet([1, 2]) == "(1, 2) mm of the flat sheet"
    assert of_sheet([1, 2, 3]) == "(1, 2, 3) mm of the undeformed sheet"
