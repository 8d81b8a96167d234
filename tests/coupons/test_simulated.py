"""Forces of simulated bias tests and their derivatives."""

import numpy as np
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.coupons.simulated import simulated_bias
from fabric_fenicsx.identification.curves import Curve, bias_displacement
from fabric_fenicsx.identification.curves.forces import response

FABRIC = ff.load("komeili").replace(s1=0.05, s2=-0.11, s3=0.13, thickness=1.2)
GAMMA = np.radians(np.arange(10.0, 46, 5))


def raw(force, height, width):
    """A bias test of force over displacement."""
    keys, strains = {"height": height, "width": width}, np.outer(GAMMA, [0, 0, 1])
    responses = (response("F", force, GAMMA, "bias_extension", keys, 1.2),)
    d = bias_displacement(GAMMA, height, width)
    more = {"noise": ("value", 0.02), "keys": keys, "displacement": d}
    return Curve("bias.csv", "bias_extension", strains, responses, np.arange(8), 2, **more)


def test_derivatives_of_the_force():
    curve = raw(0 * GAMMA, 230.0, 115.0)
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
    force, _ = simulated_bias(FABRIC, raw(0 * GAMMA, height, width))
    assert force[-1] == pytest.approx(finer, rel=0.01)
