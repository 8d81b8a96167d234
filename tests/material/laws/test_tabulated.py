"""The tabulated FABRIC baseline and the closed-form stresses."""

import numpy as np
import pytest
from scipy.integrate import quad

from fabric_fenicsx.material.laws.base import stresses_of_energy
from fabric_fenicsx.material.laws.tabulated import Curve, TabulatedFabric
from fabric_fenicsx.material.presets import load
from fabric_fenicsx.runtime.errors import InputError


@pytest.fixture
def tabulated():
    e = np.array([-0.2, -0.05, 0.0, 0.004, 0.01, 0.02, 0.03])
    yarn = Curve(tuple(e), tuple(np.where(e > 0, 12390 * e**2 + 1335 * e, 1.3 * e)))
    g = np.radians([0, 5, 10, 20, 30, 45, 60])
    return TabulatedFabric(
        yarn,
        Curve(tuple(e), tuple(0.7 * np.asarray(yarn.y))),
        Curve(tuple(g), tuple(0.02 * g + 0.3 * g**3)),
        name="table",
    )


def test_curve_keeps_points_monotony_and_a_twice_continuous_energy(tabulated):
    curve = Curve(tabulated.warp.x, tabulated.warp.y, "linear")
    assert curve(curve.x) == pytest.approx(curve.y, abs=1e-12)
    e = np.linspace(-0.3, 0.05, 5001)
    energy, stress, tangent = curve.derivatives(e)
    assert np.all(np.diff(stress) > 0)
    for x in curve.x:
        below, at = (np.array(curve.derivatives(v)) for v in (x - 1e-12, x))
        assert at == pytest.approx(below, rel=1e-6, abs=1e-8)
    for k in (0, 1700, 4200, 5000):
        assert energy[k] == pytest.approx(
            quad(curve, 0, e[k], epsabs=1e-13, limit=200)[0], rel=1e-8
        )
    assert curve.derivatives(0.0)[0] == 0 and energy.min() >= 0
    beyond = curve.derivatives([0.04, 0.05, 0.08])[1:]
    assert np.ptp(beyond[1]) < 1e-9
    assert beyond[0][1] - beyond[0][0] == pytest.approx(0.01 * beyond[1][0])


def test_tables_of_tension_alone_give_no_compression():
    for extrapolation in ("constant", "linear"):
        curve = Curve((0.0, 0.01, 0.03), (0.0, 35.0, 135.0), extrapolation)
        energy, stress, tangent = curve.derivatives([-0.1, -1e-12])
        assert not energy.any() and not stress.any() and not tangent.any()
        assert curve.derivatives(0.0)[2] == pytest.approx(2500, rel=0.5)


def test_a_stress_that_falls_never_turns_over():
    falling = Curve((0.0, 0.5, 1.0), (0.0, 0.022, 0.004), "linear")
    assert falling(np.array([1.0, 1.2, 3.0])) == pytest.approx(0.004)


def test_tables_from_files(tmp_path, tabulated):
    for name, curve, header, factor in (
        ("warp", tabulated.warp, "eps [%], sigma [MPa]", (100, 1)),
        ("weft", tabulated.weft, "sigma [kPa], eps [-]", (1, 1000)),
        ("shear", tabulated.shear, "gamma [deg], tau [N/mm]", (180 / np.pi, 0.5)),
    ):
        order = -1 if header.startswith("sigma") else 1
        lines = [
            ", ".join([repr(float(v * f)) for v, f in zip(point, factor)][::order])
            for point in zip(curve.x, curve.y)
        ]
        (tmp_path / f"{name}.csv").write_text("\n".join(["# measured by nobody", header, *lines]))
    text = (
        'model = "fabric"\nname = "table"\nthickness_mm = 0.5\ndensity_g_per_cm3 = 0.75\nwarp = '
        '"warp.csv"\nweft = "weft.csv"\nshear = "shear.csv"\n'
    )
    (tmp_path / "m.toml").write_text(text)
    fabric = load(str(tmp_path / "m.toml"))
    states = np.random.default_rng(4).uniform(-0.2, 0.06, (3, 50)) * [[1], [1], [-6]]
    both = (stresses_of_energy(each, *states) for each in (fabric, tabulated))
    assert np.allclose(*both, rtol=1e-9)
    assert fabric.decoupled() is fabric
    assert fabric.without("biaxial") is fabric
    assert fabric.couplings == frozenset()


def test_what_tables_lack_is_told_before_a_run(tabulated):
    assert tabulated.plausibility_warnings() == []
    falling = Curve((0.0, 0.5, 1.0), (0.0, 0.022, 0.004))
    pulled = Curve(tabulated.weft.x[2:], tabulated.weft.y[2:])
    lacks, falls = tabulated.replace(shear=falling, weft=pulled).plausibility_warnings()
    assert "the table of weft of material table begins at 0, so the yarns have no stress" in lacks
    assert "the table of shear of material table falls from 28.65 deg on" in falls


GOOD = "eps [%], sigma [MPa]\n-1, -0.1\n0, 0\n1, 10\n2, 30\n"
BAD = {
    "eps [%], sigma [bar]\n0, 0": "row 1 has the column",
    GOOD + "1.5, 40\n": "row 6 is (0.015, 40); allowed are rising strains",
    "eps [%], sigma [MPa]\n"
    + "".join(f"{e}, {e}\n" for e in range(41)): "41 points; allowed are 3 to 40",
    "eps [%], sigma [MPa]\n0, 1\n1, 2\n2, 3\n": "(0, 0)",
    GOOD + "3, -1\n": "row 6 is (0.03, -1); allowed",
}


def write_material(folder, more="", warp=GOOD):
    (folder / "warp.csv").write_text(warp)
    (folder / "weft.csv").write_text(GOOD)
    (folder / "shear.csv").write_text("gamma [deg], tau [MPa]\n0, 0\n10, 1\n20, 3\n")
    (folder / "m.toml").write_text(
        'model = "fabric"\nthickness_mm = 1\ndensity_g_per_cm3 = 1\nwarp = "warp.csv"\n'
        f'weft = "weft.csv"\nshear = "shear.csv"\n{more}'
    )


@pytest.mark.parametrize("extrapolation, stress", [("constant", 30.0), ("linear", 55.0)])
def test_a_material_file_says_how_its_tables_go_on(tmp_path, extrapolation, stress):
    write_material(tmp_path, f'extrapolation = "{extrapolation}"\n')
    assert load(str(tmp_path / "m.toml")).warp(0.03) == pytest.approx(stress)
    write_material(tmp_path, 'extrapolation = "cubic"\n')
    with pytest.raises(InputError, match="extrapolation is 'cubic'; allowed is constant or linear"):
        load(str(tmp_path / "m.toml"))


@pytest.mark.parametrize("text", BAD)
def test_bad_tables_are_named(tmp_path, text):
    write_material(tmp_path, warp=text)
    with pytest.raises(InputError) as error:
        load(str(tmp_path / "m.toml"))
    assert BAD[text] in str(error.value) and "warp.csv" in str(error.value)
