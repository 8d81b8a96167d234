"""Criteria of a converged step."""

import pytest

from fabric_fenicsx.solve.step_criteria import imbalance, missing_work, negative_bending


@pytest.mark.parametrize(
    "work, rise, contact, allowed, found",
    [
        (100.0, 97.0, 0.0, 0.02, "3 %"),
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


@pytest.mark.parametrize("bending, refused", [(-7.49, True), (-1e-12, False), (0.1, False)])
def test_bending_has_no_energy_below_0(bending, refused):
    reason = negative_bending({"strain": 100.0, "bending": bending, "friction": 3.0})
    assert reason == ("bending has an energy of -7.49 N mm, below 0" if refused else "")
    assert not negative_bending({"strain": 100.0})
