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
FACTORS = {
    20: {"shear_factor": 8.0, "yarn_factor": 1.2},
    200: dict.fromkeys(("shear_factor", "yarn_factor"), 1.0),
}
STATES = np.array([[0.01, -0.02, 0.0], [0.02, 0.0, 0.005], [0.0, 0.3, -0.6]])


@pytest.mark.parametrize("name", FABRICS)
def test_numbers_are_linear_between_temperatures(name):
    plain = FABRICS[name]
    fabric = plain.replace(at_temperatures=FACTORS)
    warm = fabric.at(110.0)
    shear, yarn = 4.5, 1.1
    parts = plain.derivatives(*STATES).parts
    if name != "coupled":  # without couplings the parts scale alone
        told = warm.derivatives(*STATES).parts
        assert told == pytest.approx(parts * [yarn, yarn, shear], rel=1e-12)
    assert warm.shear_stiffness == pytest.approx(shear * plain.shear_stiffness, rel=1e-12)
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


FILE = """
name = "glass"
thickness_mm = 1.0
density_kg_per_m3 = 750
[units]
stress = "MPa"
[yarns]
a = 4130.0
b = 667.5
d = 0.65
p_min = 0.75
c = 23.67
s_T = 1467.6
s_C = 100.0
[shear]
s1 = 25.06e-3
s2 = 0
s3 = 0
[[at]]
temperature = 200
s1_kPa = 10
[[at]]
temperature = 20
s1 = 0.08
"""


def test_a_file_has_tables_at_temperatures(tmp_path):
    (tmp_path / "f.toml").write_text(FILE)
    fabric = ff.load(tmp_path / "f.toml")
    assert fabric.at(65.0).s1 == pytest.approx(0.0625)
    fabric.to_toml(tmp_path / "again.toml")
    again = ff.load(tmp_path / "again.toml")
    assert again == fabric != fabric.replace(at_temperatures={20: {"s1": 0.1}, 200: {"s1": 0.01}})


@pytest.mark.parametrize(
    "before, after, said",
    [
        ("s1 = 0.08", "", "missing at temperature 200: s1|missing at temperature 20: s1"),
        ("s1 = 0.08", "thickness = 1", "at.2.thickness is unknown"),
        ("temperature = 20\n", "temperature = 200\n", "at.2.temperature is 200 again"),
        ("[[at]]\ntemperature = 20\ns1 = 0.08", "", "the temperature 200 alone; allowed are 2"),
    ],
)
def test_a_bad_table_is_told(tmp_path, before, after, said):
    assert before in FILE
    (tmp_path / "f.toml").write_text(FILE.replace(before, after))
    with pytest.raises(ff.InputError, match=said):
        ff.load(tmp_path / "f.toml")


def test_a_temperature_is_given_where_it_is_of_use_and_nowhere_else():
    fabric = KOMEILI.replace(at_temperatures={20: {"s1": 0.1}, 200: {"s1": 0.01}})
    with pytest.raises(ff.InputError, match="`temperature` is missing, as material glass"):
        ff.Membrane(fabric)
    with pytest.raises(ff.InputError, match="`temperature` is 250; allowed is from 20 to 200"):
        ff.Membrane(fabric, temperature=250)
    for wrong in (100.0, lambda x, y: 100.0 + x):
        with pytest.raises(ff.InputError, match="has no numbers at temperatures"):
            ff.Membrane(KOMEILI, temperature=wrong)
    with pytest.raises(ff.InputError, match="s1 is changed, and material glass has its own"):
        fabric.changed({"s1": 0.05})
    assert fabric.changed({"b": 600.0}).at(200.0).warp.b == 600.0
