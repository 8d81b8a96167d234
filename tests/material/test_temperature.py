"""A fabric at a temperature: between the measured ones its numbers are interpolated."""

import numpy as np
import pytest
from fabrics import LAW58

import fabric_fenicsx as ff
from fabric_fenicsx.material.laws.base import numbers_of
from fabric_fenicsx.material.laws.tabulated import Curve

KOMEILI = ff.load("komeili").replace(name="glass")
YARN = Curve((-0.1, 0.0, 0.01, 0.03), (-0.1, 0.0, 9.0, 45.0))
TABLE = ff.TabulatedFabric(YARN, YARN, Curve((0.0, 0.4, 0.8), (0.0, 0.01, 0.09)))
FABRICS = {"coupled": KOMEILI, "tabulated": TABLE, "law58": LAW58}
NAMES = "shear_factor", "yarn_factor"
FACTORS = {20: dict(zip(NAMES, (8.0, 1.2))), 200: dict(zip(NAMES, (1.0, 1.0)))}
STATES = np.array([[0.01, -0.02, 0.0], [0.02, 0.0, 0.005], [0.0, 0.3, -0.6]])


@pytest.mark.parametrize("name", FABRICS)
def test_numbers_are_linear_between_temperatures(name):
    plain = FABRICS[name]
    fabric = plain.replace(at_temperatures=FACTORS)
    warm = fabric.at(110.0)
    if name != "coupled":  # without couplings the parts scale alone
        parts = plain.derivatives(*STATES).parts * [1.1, 1.1, 4.5]
        assert warm.derivatives(*STATES).parts == pytest.approx(parts, rel=1e-12)
    assert warm.shear_stiffness == pytest.approx(4.5 * plain.shear_stiffness, rel=1e-12)
    assert fabric.at(200.0).replace(name=plain.name) == plain
    temperatures = np.array([20.0, 110.0, 200.0])
    numbers = fabric.numbers_at(temperatures)
    assert numbers[1] == pytest.approx(numbers_of(warm), rel=1e-14)
    # laws of points, each with its own numbers
    found = fabric.by_points(numbers).derivatives(*STATES)
    for k, temperature in enumerate(temperatures):
        alone = fabric.at(temperature).derivatives(*STATES[:, k : k + 1])
        assert found.parts[k] == pytest.approx(alone.parts[0], rel=1e-12, abs=1e-18)
        assert found.second[:, k] == pytest.approx(alone.second[:, 0], rel=1e-12, abs=1e-15)


def test_a_temperature_is_given_where_it_is_of_use_and_nowhere_else():
    fabric = KOMEILI.replace(at_temperatures={20: {"s1": 0.1}, 200: {"s1": 0.01}})
    with pytest.raises(ff.InputError, match="`temperature` is missing; expected from 20 to 200"):
        ff.Membrane(fabric)
    with pytest.raises(ff.InputError, match="`temperature` is 250; expected from 20 to 200"):
        ff.Membrane(fabric, temperature=250)
    with pytest.raises(ff.InputError, match="is 100; expected none, .* no parameters at temp"):
        ff.Membrane(KOMEILI, temperature=100.0)
    with pytest.raises(ff.InputError, match="s1 is changed, and material glass has its own"):
        fabric.changed({"s1": 0.05})
    assert fabric.changed({"b": 600.0}).at(200.0).warp.b == 600.0
