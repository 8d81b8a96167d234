"""Fits to raw bias tests with a function in place of a simulation: no DOLFINx."""

import numpy as np
import pytest
from synthetic_curves import bias_test

from fabric_fenicsx.core.errors import SolverFailure
from fabric_fenicsx.identification import identify, identify_simulated
from fabric_fenicsx.identification.curves import Sheet
from fabric_fenicsx.material.presets import load

SHEET = Sheet("glass", 1.2, 0.619, True)
GAMMA = np.radians(np.arange(5.0, 50, 5))
TRUE = [0.06, -0.12, 0.18]
FABRIC = load("komeili").replace(**dict(zip(("s1", "s2", "s3"), TRUE)))


def raw(force):
    return bias_test(force, GAMMA, 300.0, 100.0, 0.01)


def specimen(fabric, curve, curved=0.1):
    """Forces that are not linear in the parameters, and their derivatives."""
    by = GAMMA[:, None] ** np.arange(1, 4) * 300
    x = by @ [fabric.s1, fabric.s2, fabric.s3]
    return x - curved * x**2 / 10, by * (1 - curved * x[:, None] / 5)


@pytest.mark.parametrize("why", ["could not be simulated: no", "did not settle"])
def test_a_specimen_that_tells_nothing_leaves_the_first_fit(why):
    count = iter(range(100))

    def simulate(fabric, curve):
        if "settle" not in why:
            raise SolverFailure("no")
        force, slopes = specimen(fabric, curve)
        return force * (1 + 0.5 * (next(count) % 2)), slopes

    curve = raw(specimen(FABRIC, None)[0])
    found, start = identify_simulated(SHEET, [curve], simulate), identify(SHEET, [curve])
    assert found.fabric == start.fabric and found.simulated is None
    assert why in found.warnings[-1] and "homogeneous shear" in found.warnings[-1]


def test_specimens_give_their_fabric_back():
    noisy = specimen(FABRIC, None)[0] * (1 + 0.01 * np.random.default_rng(0).normal(size=9))
    for force, rel in ((specimen(FABRIC, None)[0], 1e-3), (noisy, 0.2)):
        found = identify_simulated(SHEET, [raw(force)], specimen)
        start, fit = identify(SHEET, [raw(force)]), found.simulated
        values = [getattr(found.fabric, name) for name in ("s1", "s2", "s3")]
        assert values == pytest.approx(TRUE, rel=rel)
        assert fit.homogeneous == {name: getattr(start.fabric, name) for name in ("s1", "s2", "s3")}
        for told, fabric in ((fit.off_homogeneous, start.fabric), (fit.off, found.fabric)):
            off = np.sqrt(np.mean((specimen(fabric, None)[0] - force) ** 2)) / force.max()
            assert told == {"bias.csv": pytest.approx(off, rel=1e-6)}
