"""What a user reads of a coupon, from made fields on cells of unequal area and made states."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import trapezoid

import fabric_fenicsx as ff

FABRIC = ff.load("komeili").replace(thickness=0.8)
NAMES = "log_eps_11", "log_eps_22", "eps_a", "eps_b", "shear_angle"


def cells(setup):
    """Middles (n, 2) and areas (n,) of cells, by their corners."""
    x = setup.blank.corners()[:, :, :2]
    (a, b), (c, d) = (x[:, 1] - x[:, 0]).T, (x[:, 2] - x[:, 0]).T
    return x.mean(1), abs(a * d - b * c) / 2


def result(rows, **fields):
    """Of rows (displacement [mm], force [N]), and fields of which the others are 0."""
    fields = dict.fromkeys(NAMES, 0 * next(iter(fields.values()))) | fields
    rows = [{"displacement_mm": d, "reaction_N": f, "load": k} for k, (d, f) in enumerate(rows)]
    return SimpleNamespace(rows=rows, fields=fields)


def test_tension():
    strip = {"length": 90.0, "width": 40.0, "nx": 25, "pattern": "unstructured"}
    setup = ff.Tensile(FABRIC, **strip).build()
    (x, area), random = cells(setup), np.random.default_rng(1)
    along, across = random.normal(size=(2, len(area)))
    setup.blank.u.interpolate(lambda x: (0 * x[0], 1e-3 * x[0] * x[1]))
    q = setup.quantities(result([(0, 7), (1, 90)], log_eps_11=along, log_eps_22=across))
    near = np.hypot(*(x - [45, 20]).T) <= 40 / 8
    middle = across[near] @ area[near] / area[near].sum()
    assert q["log_eps_22_middle"] == pytest.approx(middle, rel=1e-12)
    assert (q["log_eps_11_max"], q["log_eps_22_min"]) == (along.max(), across.min())
    assert q["nominal_stress_MPa"] == pytest.approx(90 / (40 * 0.8))
    assert q["width_at_middle_mm"] == pytest.approx(40 * (1 + 1e-3 * 45), rel=1e-12)


def test_shear_and_98_percent_of_the_area():
    setup = ff.BiasExtension(FABRIC, nx=20).build()
    x, area = cells(setup)
    assert area.max() > 3 * area.min()
    gamma = 0.3 - area / area.max()  # on small cells larger
    q = setup.quantities(result([(0, 0), (10, 3)], shear_angle=gamma, eps_a=gamma))
    all_values = {"shear_angle_98_percent_deg": np.degrees(gamma), "eps_a_98_percent": gamma}
    for name, values in all_values.items():
        for bound, share in zip(q[name], (0.01, 0.99)):
            below = area[values < bound].sum() / area.sum()
            assert below == pytest.approx(share, abs=area.max() / area.sum())
    assert q["shear_angle_deg"] == pytest.approx(np.degrees([gamma.min(), gamma.max()]))
    assert q["shear_angle_max_deg"] == pytest.approx(np.degrees(0.7))


def test_a_bias_test(tmp_path):
    """Zones of yarns at +-45 deg that end in the clamps, and the formula of Cao et al."""
    setup = ff.BiasExtension(FABRIC, nx=20).build()
    (x, y), area = cells(setup)[0].T, cells(setup)[1]
    gamma = -0.1 - 1e-5 * (x - 70) ** 2 - 1e-4 * (y - 20) ** 2
    found = result([(0, 0), (10, 3)], shear_angle=gamma)
    q = setup.quantities(found)
    end = np.minimum(x, 200 - x)
    held = np.array([y >= end, y <= 50 - end]).sum(0)
    inside = np.minimum(abs(y - end), abs(50 - y - end)) / np.sqrt(2) > 50 / 10

    def mean(where):
        return np.degrees(-gamma[where] @ area[where] / area[where].sum())

    for zone, count in (("free", 0), ("half", 1), ("clamped", 2)):
        angle = mean((held == count) & inside)
        assert q[f"{zone}_zone_shear_angle_deg"] == pytest.approx(angle, rel=1e-9), zone
    centre = np.hypot(x - 100, y - 25) <= 50 / 8
    assert q["centre_shear_angle_deg"] == pytest.approx(mean(centre), rel=1e-9)
    g = np.arcsin(10 / 150 * (2 + 10 / 150))
    assert q["theory_shear_angle_deg"] == pytest.approx(np.degrees(g), rel=1e-9)
    # F_sh at half the angle is half of it, by lines between the rows
    share = (2 * 200 - 3 * 50) * np.cos(g) + 50 * np.cos(g / 2) / 2
    force = (200 / 50 - 1) * 3 * (np.cos(g / 2) - np.sin(g / 2)) / share
    assert q["normalised_shear_force_N_per_mm"] == pytest.approx(force, rel=1e-9)
    setup.end(found, tmp_path)
    told = np.loadtxt(tmp_path / "axis.csv", delimiter=",", skiprows=1)
    axis = abs(y - 25) <= 50 / 20
    expected = np.column_stack([x, np.degrees(-gamma)])[axis]
    assert told[np.lexsort(told.T)] == pytest.approx(expected[np.lexsort(expected.T)], rel=1e-6)


def test_zones_of_yarns_of_different_lengths():
    setup = ff.BiasExtension(FABRIC, nx=24, fibre_angle=30, pattern="crossed", element="P1").build()
    x, y = cells(setup)[0].T
    ends = [(y - x * t, y + (200 - x) * t) for t in np.tan(np.radians([30, 120]))]
    a, b = (np.any([(e >= 0) & (e <= 50) for e in yarn], 0) for yarn in ends)
    q = setup.quantities(result([(0, 0), (10, 3)], shear_angle=0.1 + 0.2 * a + 0.4 * b))
    names = "free", "only_a_held", "only_b_held", "clamped"
    told = [q.get(f"{name}_zone_shear_angle_deg") for name in names]
    assert told == pytest.approx(np.degrees([0.1, 0.3, 0.5, 0.7]), rel=1e-9)
    assert "half_zone_shear_angle_deg" not in q


def test_theory_counts_from_the_weave_s_own_angle():
    setup = ff.BiasExtension(FABRIC, nx=8, pattern="crossed", element="P1", weave_angle=70).build()
    q = setup.quantities(result([(0, 0), (10, 3)], shear_angle=cells(setup)[1]))
    g = np.degrees(np.arcsin(10 / 150 * (2 + 10 / 150)))  # yarns open from 90 deg
    assert q["theory_shear_angle_deg"] == pytest.approx(g + 20, rel=1e-9)
    assert "normalised_shear_force_N_per_mm" not in q


def test_both_grips_hold_the_direction_of_yarns_that_bend():
    """Nothing else resists the sheet's rotation, which is the same if it is turned by 180 deg."""
    mesh = {"nx": 8, "ny": 2, "pattern": "crossed", "element": "P1"}
    setup = ff.BiasExtension(FABRIC, in_plane_bending=0.1, **mesh).build()
    x, c, s = setup.blank.coordinates()[:, :2] - [100, 25], np.cos(1e-3), np.sin(1e-3)
    setup.blank.u.x.array[:] = (x @ [[c - 1, s], [-s, c - 1]]).ravel()
    setup.scene.residual(setup.scene.u.duplicate())
    force = setup.scene.forces.array.reshape(-1, 2)
    other = np.linalg.norm(x[:, None] + x, axis=2).argmin(1)
    largest = abs(force).max()
    assert largest > 1e-6 and force[other] == pytest.approx(-force, abs=1e-6 * largest)


@pytest.mark.parametrize("tension, weave, friction", [(0, 90, 0), (0.02, 70, 0.02)])
def test_the_frame_does_the_work_that_the_fabric_stores(tension, weave, friction):
    """While it shears, with what friction takes; its diagonal is that of the corners."""
    fabric, t, side, end = FABRIC, 0.8, 100.0, np.radians(50)
    if friction:
        fabric = fabric.replace(shear_friction=ff.ShearFriction(0.3, friction))
    options = {"side": side, "angle": 50.0, "pre_tension": tension, "weave_angle": weave}
    setup = ff.PictureFrame(fabric, nx=1, **options).build()
    begin, mounted = 0.1 * (tension > 0), np.radians(weave - 90)
    loads, rows, moved = np.linspace(begin, 1, 101), [], []
    x, pulled = setup.blank.coordinates()[:, :2], 2 * 1467.6 * ((1 + tension) ** 2 - 1) ** 2
    for load in loads:
        half = end * (load - begin) / (1 - begin) / 2
        c, s = (1 + tension) * np.array([np.cos(half), np.sin(half)])
        setup.blank.u.x.array[:] = (x @ ([[c, s], [s, c]] - np.eye(2))).ravel()
        setup.scene.residual(setup.scene.u.duplicate())
        rows.append(setup.measure(setup.scene, load))
        moved.append(np.sqrt(2) * side * (c + s - 1))
    d, force = np.array(rows).T
    assert d == pytest.approx(moved, abs=1e-9)

    def energy(g):
        """Eqs (25) to (27), of both yarns."""
        return 0.02506 * g**2 / 2 + (pulled - 0.18679) * abs(g) ** 3 / 3 + 0.56239 * g**4 / 4

    rubbed = friction * (end - friction / 0.3 / 2)
    work = t * side**2 * (energy(mounted + end) - energy(mounted) + rubbed)
    assert trapezoid(force, d) == pytest.approx(work, rel=1e-3)
    state = result(rows[-1:], shear_angle=x[:, 0])
    state.rows[-1]["load"] = 1.0
    q, g = setup.quantities(state), mounted + end
    tau = ((0.56239 * g + pulled - 0.18679) * g + 0.02506) * g + friction
    for name in ("normalised_shear_force_N_per_mm", "closed_form_N_per_mm"):
        assert q[name] == pytest.approx(tau * t / ((1 + tension) * np.cos(end)), rel=1e-9), name
    assert q["shear_angle_deg"] == pytest.approx(50)
