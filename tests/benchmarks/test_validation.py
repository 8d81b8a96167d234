"""Measured bias tests that a law predicts which was fitted to another size."""

import csv

import numpy as np
import pytest
from bench.validation import bias_tests, fitted, frames, middle_angles, normalised, ratios


def test_a_size_that_the_fit_has_not_seen(launch):
    done = launch("validation", "--weaves", "unbalanced twill", "--no-pictures")
    assert done.status == 0, done.err
    with open(done.folder / "forces.csv", newline="") as file:
        rows = {
            row["test"]: [row[key] for key in row if "deg" in key] for row in csv.DictReader(file)
        }
    off = {test: np.array(values, float) for test, values in rows.items()}
    assert np.abs(off["UN 100x300"] - 1).max() < 0.03  # fitted
    assert np.abs(off["UN 100x250"] - 1).max() < 0.07
    assert np.abs(off["UN 100x200"][:-1] - 1).max() < 0.17
    assert off["INSA-NU 200x400"].min() > 4  # which no law can have beside the others
    assert "30 deg: frames 0.0439 to 0.0990 N/mm (1 to 2.3)" in done.out


@pytest.mark.long
def test_the_plain_weave():
    """The angle in the middle, which is less than the usual formula says, and the force of 115 x
    230 mm."""
    fabric = fitted("plain")
    assert middle_angles(fabric) == pytest.approx([6.2, 13.8, 23.4, 34.1], abs=0.1)
    off = {row["test"]: row for row in ratios("plain", fabric)}["INSA-NU 115x230"]
    assert 0.95 < off["10 deg"] < 1.05 < off["45 deg"] < 1.2
    angles, forces = frames("plain")
    assert forces.shape == (7, 5) and (forces.min(0)[1:] > normalised(fabric, angles)[1:]).all()
    assert len(bias_tests("plain")) == 9
