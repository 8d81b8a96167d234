"""The bias-extension study as a user runs it, on the paper's specimen."""

from pathlib import Path

import numpy as np
import pytest
from bench.strips import curve_distance

from fabric_fenicsx.coupons.pin_jointed import PinJointedStrip
from fabric_fenicsx.results.states import read_state

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "studies" / "reference"

PLAIN = "--no-pictures", "--no-error"
FULL = ("--element", "P1", "--nx", 60, "--ny", 15, "--pattern", "crossed", "--steps", 10)


def test_three_zones_and_both_models(launch):
    found = {}
    for model in ("hyperelastic", "fabric"):
        # pictures are looked at of the last
        pictures = () if model == "fabric" else ("--no-pictures",)
        done = launch("bias_extension", *FULL, "--model", model, "--no-error", *pictures)
        assert done.status == 0, done.err
        found[model] = s = done.summary
        q = s["quantities"]
        assert max(map(abs, q["eps_a"] + q["eps_b"])) < 5e-4
        assert abs(q["centre_shear_angle_deg"] - q["theory_shear_angle_deg"]) <= 1.2
        assert q["theory_shear_angle_deg"] == pytest.approx(16.53, abs=0.01)
        assert s["kernel_mismatch"] <= 1e-10
        assert abs(s["energy"]["external_work"] / s["energy"]["strain"] - 1) < 2e-3
        for zone, theory in (("clamped", 0.0), ("half", 16.53 / 2), ("free", 16.53)):
            assert q[f"{zone}_zone_shear_angle_deg"] == pytest.approx(theory, abs=0.6)
    profile = np.loadtxt(done.folder / "axis.csv", delimiter=",", skiprows=1)
    assert (np.diff(profile[:, 0]) >= 0).all()
    assert (done.folder / "axis.png").stat().st_size > 10_000
    deep = (profile[:, 0] > 30) & (profile[:, 0] < 170)
    assert profile[deep, 1].mean() == pytest.approx(16.53, abs=0.6)
    assert profile[(profile[:, 0] < 20) | (profile[:, 0] > 180), 1].max() < 0.1
    forces = [each["reaction_N"] for each in found.values()]
    assert forces[1] == pytest.approx(forces[0], rel=1e-3)
    grid = read_state(done.folder, 1.0)
    x, gamma = grid.cell_centers().points, np.degrees(np.abs(grid.cell_data["shear_angle"]))
    for place, theory in (((5, 25), 0.0), ((25, 5), 16.53 / 2), ((100, 25), 16.53)):
        near = np.linalg.norm(x[:, :2] - place, axis=1) < 4
        assert gamma[near].mean() == pytest.approx(theory, abs=1.2), place


@pytest.mark.parametrize("options", [("--pattern", "left"), ("--element", "Q1")])
def test_the_axis_of_a_mesh_without_cells_near_it(launch, options):
    """The nearest ones stand for it, in each column one of both sides."""
    mesh = "--element", "P1", "--nx", 8, "--ny", 2, "--steps", 2, *options
    done = launch("bias_extension", *mesh, "--strain", 0.02, "--no-error")
    assert done.status == 0, done.err
    x, gamma = np.loadtxt(done.folder / "axis.csv", delimiter=",", skiprows=1).T
    assert (np.histogram(x, 8, (0, 200))[0] == 2).all() and gamma.max() > 1
    assert (done.folder / "axis.png").stat().st_size > 10_000


@pytest.mark.parametrize("study, scene", [("tensile", "tensile"), ("bias_extension", "bias10")])
def test_the_defaults_give_the_curve_to_a_permille(launch, study, scene):
    done = launch(study, *PLAIN)
    assert done.status == 0, done.err
    curve = np.loadtxt(done.folder / "history.csv", delimiter=",", skiprows=1, usecols=(1, 3)).T
    reference = np.loadtxt(REFERENCE / f"{scene}.csv", delimiter=",", skiprows=1, usecols=(0, 2)).T
    assert curve_distance(curve, reference) <= 0.001


@pytest.mark.parametrize(
    "element, integration, nx, pattern, cells, oscillation",
    [
        pytest.param("P3", "full", 30, "unstructured", 1, 2e-3, marks=pytest.mark.long),
        pytest.param("P3", "full", 30, "yarns", 1, 1e-3, marks=pytest.mark.long),
        pytest.param(None, "inner", 68, "unstructured", 4, 1e-4, marks=pytest.mark.long),
        (None, "inner", 76, "left", 4, 1e-3),
    ],
)
def test_cells_that_do_not_follow_the_yarns_do_not_lock(
    launch, element, integration, nx, pattern, cells, oscillation
):
    """At most 12 000 unknowns against studies/reference; yarn strains more than some cells off the
    corners' yarns, near which the reference's own are not bounded."""
    how = ("--element", element, "--integration", integration) if element else ()
    # the last state is what is looked at, not the work on the way
    how = *how, "--pattern", pattern, "--nx", nx, "--steps", 2, "--max-imbalance", 0.2
    done = launch("bias_extension", *how, *PLAIN)
    assert done.status == 0, done.err
    q = done.summary["quantities"]
    assert done.summary["dofs"] <= 12_000
    assert done.summary["reaction_N"] == pytest.approx(0.51809, rel=0.02)
    assert q["centre_shear_angle_deg"] == pytest.approx(15.662, abs=0.5)
    grid = read_state(done.folder, 1.0)
    x = np.asarray(grid.cell_centers().points)[:, :2]
    _, distance = PinJointedStrip(200, 50, np.pi / 4, 3 * np.pi / 4).held(*x.T)
    strain = np.maximum(np.abs(grid.cell_data["eps_a"]), np.abs(grid.cell_data["eps_b"]))
    assert strain[distance > cells * 200 / nx].max() <= oscillation
    assert done.summary["integration"] == integration


@pytest.mark.parametrize("degrees, theory", [(30, 11.09), (20, 28.19)])
def test_theory_at_other_angles(launch, degrees, theory):
    """Means over the zones; within them simulated angles differ, as moments on yarns of different
    lengths do."""
    options = ("--fibre-angle", degrees, "--pattern", "yarns", "--strain", 0.05, "--steps", 2)
    done = launch("bias_extension", "--nx", 24, *options, *PLAIN)
    assert done.status == 0, done.err
    q = done.summary["quantities"]
    assert q["theory_shear_angle_deg"] == pytest.approx(theory, abs=0.01)
    assert q["free_zone_shear_angle_deg"] == pytest.approx(theory, rel=0.07)
    assert q["centre_shear_angle_deg"] == pytest.approx(theory, rel=0.15)
    assert q["clamped_zone_shear_angle_deg"] < 0.5
    strip = PinJointedStrip(200, 50, *np.radians([degrees, degrees + 90]))
    turn_a, turn_b = np.degrees(np.abs(strip.turns(10)))
    # where a yarn a is held, yarns b keep their direction
    assert q["only_a_held_zone_shear_angle_deg"] == pytest.approx(turn_a, abs=0.6)
    if degrees == 30:  # at 20 deg that zone is too narrow
        assert q["only_b_held_zone_shear_angle_deg"] == pytest.approx(turn_b, rel=0.05)
    assert "half_zone_shear_angle_deg" not in q
    assert "normalised_shear_force_N_per_mm" not in q and "no_theory_because" not in q


def test_yarns_that_bend_in_the_ply_stiffen_it(launch):
    forces = []
    for stiffness in (0, 0.1):
        options = ("--element", "P1", "--pattern", "crossed", "--steps", 5, *PLAIN)
        done = launch("bias_extension", "--nx", 24, "--in-plane-bending", stiffness, *options)
        assert done.status == 0, done.err
        assert done.summary["terms"] == ["membrane", "bending"][: 1 + (stiffness > 0)]
        forces.append(done.summary["reaction_N"])
    assert forces[1] / forces[0] == pytest.approx(1.095, rel=0.01)
