"""Forces of simulated bias tests and their derivatives."""

import numpy as np
import pytest
from synthetic_curves import bias_test

import fabric_fenicsx as ff
from fabric_fenicsx.coupons.simulated import simulated_bias

FABRIC = ff.load("komeili").replace(s1=0.05, s2=-0.11, s3=0.13, thickness=1.2)
GAMMA = np.radians(np.arange(10.0, 46, 5))


def test_derivatives_of_the_force():
    curve = bias_test(0 * GAMMA, GAMMA, 230.0, 115.0, 0.02)
    _, slopes = simulated_bias(FABRIC, curve)
    for k, (name, step) in enumerate({"s1": 1e-3, "s2": 2e-3, "s3": 4e-3}.items()):
        more, less = (
            simulated_bias(FABRIC.replace(**{name: getattr(FABRIC, name) + h}), curve)[0]
            for h in (step, -step)
        )
        assert (more - less) / (2 * step) == pytest.approx(slopes[:, k], rel=2e-3)


# and the force [N] at 45 deg of `nx` 48, `crossed`
@pytest.mark.parametrize("height, width, finer", [(230.0, 115.0, 10.7045), (250.0, 100.0, 11.0546)])
def test_few_cells_are_enough(height, width, finer):
    force, _ = simulated_bias(FABRIC, bias_test(0 * GAMMA, GAMMA, height, width, 0.02))
    assert force[-1] == pytest.approx(finer, rel=0.01)
