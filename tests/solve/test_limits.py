"""What is believed, and how a run ends that is not."""

import numpy as np
import pytest

import fabric_fenicsx as ff

LIMITS = {
    **{"imbalance": 0.05, "viscous": 0.05, "penetration": 0.1, "shortening": 0.05},
    **{"located": 0.05, "fibre_share": 0.907, "shear": 85.0, "shear_99_percent": 75.0},
}


@pytest.mark.parametrize("name", LIMITS)
def test_a_value_just_beyond_its_limit_has_the_digits_that_tell(name):
    limit, limits = LIMITS[name], ff.Limits()
    assert not limits.exceeded({name: limit, "cell_size": 1e9})
    (sentence,) = limits.exceeded({"imbalance": 0.0, name: limit * (1 + 4e-5)})
    unit, limit = (" deg", limit) if limit > 1 else (" %", 100 * limit)
    told = f"{limit * (1 + 4e-5):.6g}{unit}"
    assert told in sentence and sentence.endswith(f"is {limit:g}{unit} (`Limits.{name}`)")
    assert len(limits.exceeded({name: np.nan})) == len(limits.exceeded({name: np.inf})) == 1


def test_a_run_beyond_a_limit_ends_with_the_reason_and_may_go_on_with_another(launch):
    options = "tensile", "--nx", 8, "--steps", 4, "--no-pictures", "--element", "P1"
    done = launch(*options, "--max-strain", 0.02)
    assert done.status == 3
    assert "not to be believed" in done.err and "--max-strain" in done.err
    assert not done.summary["converged"] and done.summary["reason"] in done.err
    assert 0.5 < done.summary["stroke_reached"] < 1
    done = launch(*options, "--resume")
    assert done.status == 0, done.err
    assert done.summary["converged"] and done.summary["stroke_reached"] == 1
