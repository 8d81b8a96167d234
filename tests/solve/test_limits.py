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
