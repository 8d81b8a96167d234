"""Laws of tables and LAW58."""

import numpy as np
import pytest
from fabrics import LAW58, TABLE
from scipy.integrate import quad

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.material.laws.tabulated import Curve
from fabric_fenicsx.material.presets import load


def test_curve_keeps_points_monotony_and_a_twice_continuous_energy():
    e = np.array([-0.2, -0.05, 0.0, 0.004, 0.01, 0.02, 0.03])
    curve = Curve(tuple(e), tuple(np.where(e > 0, 12390 * e**2 + 1335 * e, 1.3 * e)), "linear")
    assert curve(curve.x) == pytest.approx(curve.y, abs=1e-12)
    e = np.linspace(-0.3, 0.05, 5001)
    energy, stress, tangent = curve.derivatives(e)
    assert np.all(np.diff(stress) > 0)
    for x in curve.x:
        below, at = (np.array(curve.derivatives(v)) for v in (x - 1e-12, x))
        assert at == pytest.approx(below, rel=1e-6, abs=1e-8)
    for k in (0, 1700, 4200, 5000):
        exact = quad(curve, 0, e[k], epsabs=1e-13, limit=200)[0]
        assert energy[k] == pytest.approx(exact, rel=1e-8)
    assert curve.derivatives(0.0)[0] == 0 and energy.min() >= 0
    beyond = curve.derivatives([0.04, 0.05, 0.08])[1:]
    assert np.ptp(beyond[1]) < 1e-9
    assert beyond[0][1] - beyond[0][0] == pytest.approx(0.01 * beyond[1][0])


def test_tables_of_tension_alone_and_of_stresses_that_fall():
    """Give no compression, and never turn over, of which a run is told."""
    for extrapolation in ("constant", "linear"):
        curve = Curve((0.0, 0.01, 0.03), (0.0, 35.0, 135.0), extrapolation)
        energy, stress, tangent = curve.derivatives([-0.1, -1e-12])
        assert not energy.any() and not stress.any() and not tangent.any()
        assert curve.derivatives(0.0)[2] == pytest.approx(2500, rel=0.5)
    falling = Curve((0.0, 0.5, 1.0), (0.0, 0.022, 0.004), "linear")
    assert falling(np.array([1.0, 1.2, 3.0])) == pytest.approx(0.004)
    pulled = Curve(TABLE.weft.x[1:], TABLE.weft.y[1:])
    lacks, falls = TABLE.replace(shear=falling, weft=pulled).plausibility_warnings()
    assert "the table of weft of material table begins at 0: yarns have no stiffness" in lacks
    assert "the table of shear of material table decreases from 28.65 deg on" in falls


@pytest.mark.parametrize(
    "end, angle, told", [(5.1e-4, 1.61, 0), (4.9e-4, 1.59, 1), (0.49, 84.9, 0), (0.51, 85.1, 1)]
)
def test_tables_in_a_wrong_unit_are_doubted(end, angle, told):
    warp = Curve((-end, 0.0, end), (-1.0, 0.0, 1e3 * end))
    shear = Curve((0.0, 0.01, np.radians(angle)), (0.0, 0.001, 0.1))
    doubts = " ".join(TABLE.replace(warp=warp, shear=shear).plausibility_warnings())
    for table in (
        f"warp of material table reaches {100 * end:g} %; is the unit",
        f"{angle} deg; i",
    ):
        assert doubts.count(table) == told


WARP = "eps [%], sigma [MPa]\n-1, -0.1\n0, 0\n1, 10\n2, 30\n"


def read(folder, more="", warp=WARP):
    (folder / "warp.csv").write_text(warp)
    (folder / "weft.csv").write_text("sigma [kPa], eps [-]\n-100, -0.01\n0, 0\n10e3, 0.01\n")
    (folder / "shear.csv").write_text("# by nobody\ngamma [deg], tau [N/mm]\n0, 0\n9, 1\n18, 3\n")
    (folder / "m.toml").write_text(
        'model = "fabric"\nthickness_mm = 0.5\ndensity_g_per_cm3 = 1\nweft = "weft.csv"\n'
        f'shear = "shear.csv"\n{more}' + ('warp = "warp.csv"\n' if "warp" not in more else "")
    )
    return load(str(folder / "m.toml"))


@pytest.mark.parametrize("how, stress", [("constant", 30.0), ("linear", 55.0)])
def test_tables_from_files(tmp_path, how, stress):
    fabric = read(tmp_path, f'extrapolation = "{how}"\n')
    assert fabric.warp == Curve((-0.01, 0.0, 0.01, 0.02), (-0.1, 0.0, 10.0, 30.0), how)
    assert fabric.warp(0.03) == pytest.approx(stress)
    assert (fabric.weft.x, fabric.weft.y) == ((-0.01, 0.0, 0.01), (-0.1, 0.0, 10.0))
    assert fabric.shear.x == pytest.approx(np.radians([0, 9, 18]), rel=1e-9)
    assert fabric.shear.y == pytest.approx([0, 2, 6])
    assert fabric.decoupled() is fabric.without("biaxial") is fabric


@pytest.mark.parametrize(
    "more, warp, words",
    [
        ("", WARP + "1.5, 40\n", r"warp.csv.* row 6 is \(0.015, 40\); expected increasing strains"),
        ("", WARP + "".join(f"{e}, {e}\n" for e in range(31, 68)), "41 points; expected up"),
        ("", "eps [%], sigma [MPa]\n0, 1\n1, 2\n2, 3\n", r"warp.csv.*\(0, 0\)"),
        ("", WARP + "3, -1\n", r"row 6 is \(0.03, -1\); expected"),
        ("warp = 3\n", WARP, "m.toml: warp is 3; expected the name of a CSV file"),
        ('extrapolation = ["linear"]\n', WARP, r"extrapolation is \['linear'\]; expected const"),
        ("at = 3\n", WARP, r"m.toml: at is \[3\]; expected a table \[\[at\]\] for each"),
        ("assumed = 3\n", WARP, "m.toml: assumed is 3; expected a list of parameters"),
    ],
)
def test_bad_tables_are_named(tmp_path, more, warp, words):
    with pytest.raises(InputError, match=words):
        read(tmp_path, more, warp)


def test_stresses_as_the_guide_lists_them():
    e, g = np.array([-0.1, 0.0, 0.01, 0.05]), np.array([0.0, 0.4, 0.8, 1.2])
    sigma_a, sigma_b, tau = LAW58.derivatives(e, e, -g).first
    pull = np.where(e > 0, 1335 * e - 2000 * e**2, 1.335 * e)
    assert sigma_a == pytest.approx(pull, rel=1e-13)
    assert sigma_b == pytest.approx(np.where(e > 0, 900 * e, 0.9 * e), rel=1e-13)
    G = 0.6 * np.cos(0.8) ** 2
    beyond = G * np.tan(g) + (0.025 - G) * np.tan(0.8)
    assert tau == pytest.approx(-np.where(g > 0.8, beyond, 0.025 * np.tan(g)), rel=1e-13)


def test_beyond_their_softening_yarns_hold_their_stress():
    """As in OpenRadioss, E^2 / 2B."""
    fabric = LAW58.replace(E_a=100.0, E_b=100.0, B_a=2000.0)
    e, none = np.array([0.04, 0.05, 0.08, 0.12, 0.5]), np.zeros(5)
    parts, (sigma_a, sigma_b, _), tangent = fabric.derivatives(e, e, none)
    assert sigma_a == pytest.approx([2.4, 2.5, 2.5, 2.5, 2.5], rel=1e-14)
    assert sigma_b == pytest.approx(100 * e, rel=1e-14)
    assert parts[1:, 0] == pytest.approx(1 / 12 + 2.5 * (e[1:] - 0.05), rel=1e-14)
    assert tangent[0, 2:] == pytest.approx(0, abs=1e-12)
