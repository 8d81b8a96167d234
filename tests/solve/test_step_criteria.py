"""Criteria of a converged step."""

import pytest

from fabric_fenicsx.solve.step_criteria import imbalance, missing_work, off_path


@pytest.mark.parametrize(
    "accuracy, deviation, rejected", [(1e-2, 0.021, True), (1e-2, 0.02, False), (None, 1e9, False)]
)
def test_a_state_may_be_twice_the_accuracy_off_the_straight_path(accuracy, deviation, rejected):
    assert bool(off_path(deviation, accuracy)) == rejected


@pytest.mark.parametrize(
    "work, rise, contact, allowed, found",
    [
        (100.0, 97.0, 0.0, 0.02, "3 %"),
        (100.0, 99.0, 0.0, 0.02, ""),
        (100.0, 0.0, 0.0, None, ""),
        (0.1, 0.0, 0.0, 0.02, ""),  # little of what was stored
        (16.0, 0.0, 500.0, 0.02, "3.2 %"),
        (8.0, 0.0, 500.0, 0.02, ""),  # little of what contact stores
    ],
)
def test_work_must_be_in_the_energies_unless_it_is_little(work, rise, contact, allowed, found):
    reason = imbalance(missing_work(work, rise, 1e3, contact), allowed)
    text = f"{found} of the step's work is not in the energies; allowed is 2 %"
    assert reason == (text if found else "")
