"""What speaks against a converged step."""

import pytest

from fabric_fenicsx.solve.step_criteria import EnergyBalance, StraightPath


@pytest.mark.parametrize("accuracy, deviation, objects", [(1e-2, 0.021, True), (1e-2, 0.02, False)])
def test_a_state_may_be_twice_the_accuracy_off_the_straight_path(accuracy, deviation, objects):
    assert bool(StraightPath(accuracy).objection(deviation)) == objects


def test_without_an_accuracy_any_state_is_on_the_path():
    assert StraightPath(None).objection(1e9) == ""


@pytest.mark.parametrize(
    "taken, work, rise, contact, words",
    [
        (0.1, 100.0, 97.0, 0.0, "3 % of the step's work is not in the energies; allowed is 2 %"),
        (0.1, 100.0, 99.0, 0.0, ""),
        (0.1, 0.1, 0.0, 0.0, ""),  # little of what was stored
        (0.1, 16.0, 0.0, 500.0, "3.2 % of the step's work is not in the energies; allowed is 2 %"),
        (0.1, 8.0, 0.0, 500.0, ""),  # little of what contact stores
        (0.0125, 100.0, 0.0, 0.0, ""),  # among the finest steps, as in a snap
    ],
)
def test_work_must_be_in_the_energies_unless_it_is_little_or_the_step_is_fine(
    taken, work, rise, contact, words
):
    balance = EnergyBalance(0.02, largest=0.1)
    assert balance.objection(taken, work, rise, stored=1e3, contact=contact) == words
