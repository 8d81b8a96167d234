"""Criteria of a converged step."""

import pytest

from fabric_fenicsx.solve.step_criteria import (
    imbalance,
    missing_work,
    negative_bending,
    off_path,
    total_imbalance,
)


@pytest.mark.parametrize(
    "work, rise, stored, contact, share",
    [
        (100.0, 97.0, 5.0, 1.0, 0.03),
        (97.0, -100.0, 5.0, 1.0, 1.97),
        (16.0, 0.0, 1e3, 50.0, 0.16),  # little of what was stored
        (16.0, 0.0, 1e3, -500.0, 0.032),  # or of what contact stores
        (0.0, 0.0, 0.0, 0.0, 0.0),
    ],
)
def test_work_that_is_missing_is_compared_with_the_largest(work, rise, stored, contact, share):
    assert missing_work(work, rise, stored, contact) == pytest.approx(share)


def test_work_must_be_in_the_energies_if_asked_for():
    told = "3 % of the step's work is not in the energies; allowed is 2 %"
    assert imbalance(0.03, 0.02) == told
    assert not imbalance(0.03, None) and not imbalance(0.02, 0.02)


@pytest.mark.parametrize(
    "work, energy, load, told",
    [(10, 9.01, 1, ""), (10, 8.99, 1, "10.1 %"), (8.99, 10, 1, "10.1 %"), (10, 8.1, 0.5, "")],
)
def test_all_work_may_miss_a_tenth_at_full_load(work, energy, load, told):
    found = total_imbalance(work, energy, load)
    assert found == (told and f"{told} of all work is not in the energies")


def test_a_state_may_leave_the_path_by_twice_the_accuracy():
    assert "by more than the accuracy of 0.01 allows" in off_path(0.0201, 0.01)
    assert not off_path(0.0199, 0.01) and not off_path(9.0, None)


@pytest.mark.parametrize("bending, refused", [(-7.49, 1), (-2e-7, 1), (-5e-8, 0), (0.1, 0)])
def test_bending_has_no_energy_below_0(bending, refused):
    """But for rounding, 1e-9 of all."""
    reason = negative_bending({"strain": 100.0, "bending": bending, "friction": 3.0})
    assert reason == f"bending has an energy of {bending:.3g} N mm, below 0" * refused
    assert not negative_bending({"strain": 100.0})
