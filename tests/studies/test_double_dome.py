"""Forming studies, run as a user would."""

import csv
import json

import numpy as np
import pytest
from builders import said

from fabric_fenicsx.results.states import read_state
from fabric_fenicsx.studies.lib import compression_parameters

EXACT = "--tolerance", 1e-9, "--path-tolerance", 1e-8, "--viscosity", "off", "--no-pictures"


def placed(folder):
    """Undeformed places and displacements of the nodes [mm], once each and in an order of their
    own."""
    grid = read_state(folder)
    x = np.round(np.asarray(grid.points), 6) + 0.0
    _, first = np.unique(x, axis=0, return_index=True)
    return x[first], np.asarray(grid.point_data["u"])[first]


@pytest.mark.parametrize(
    "angle",
    [
        pytest.param(0, marks=[pytest.mark.mpi, pytest.mark.versions]),
        pytest.param(45, marks=pytest.mark.long),
    ],
)
def test_a_ply_is_formed(launch, angle):
    """Strain energy and shear angles are those of Table 1 and of the nodes' places, by an own
    integration over flat triangles."""
    done = launch("double_dome", "--nx", 8, "--steps", 8, "--fibre-angle", angle, "--no-error")
    assert done.status == 0, done.err
    s = done.summary
    q, energy = s["quantities"], s["energy"]
    assert s["converged"]
    assert s["kernel_mismatch"] < 1e-12
    assert {"membrane", "bending", "contact", "blank holder"} == set(s["terms"])
    assert s["energy_imbalance"] < 0.02
    assert energy["viscous"] <= 0.01 * energy["strain"]
    assert q["penetration_of_thickness"] < 0.02
    assert q["unbalanced_force_N"] < 1e-4 * q["contact_forces_N"]["die"]
    assert q["wrinkles"]["height_mm"] < 1
    (warning,) = [w for w in said(s) if "mm long where" in w]
    # edges at 43 deg do not follow yarns at 45
    assert (s["element"], s["integration"]) == ("P2" if angle else "P1", "full")
    assert not any("linear cells" in w for w in said(s))
    size = "halves of quadratic cells are 14.1" if angle else "cells are 28.2"
    assert f"{size} mm long where the die has a radius of 7.45 mm" in warning
    assert done.err.count(warning) == 1
    for name in ("formed", "states", "paths", "curve"):
        assert (done.folder / f"{name}.png").stat().st_size > 10_000
    grid = read_state(done.folder)
    assert grid.point_data["contact_pressure"].max() > 1.0
    assert (done.folder / "paths.csv").read_text().count("\n") > 50
    if angle:
        return
    x, u = np.asarray(grid.points), np.asarray(grid.point_data["u"])
    stored, gamma, areas = energy_of_table_1(x, x + u, grid.cells_dict[5])
    assert energy["strain"] == pytest.approx(stored, rel=1e-6)
    assert np.degrees(gamma.max()) == pytest.approx(q["shear_angle_max_deg"], abs=1e-4)
    low, high = q["shear_angle_99_percent_deg"] + np.array([-1e-4, 1e-4])
    below = [areas[np.degrees(gamma) < at].sum() / areas.sum() for at in (low, high)]
    assert below[0] < 0.99 <= below[1] + areas.max() / areas.sum()
    edge = x[(x[:, 0] > 234.9) | (x[:, 1] > 134.9)]
    drawn = -u[(x[:, 0] > 234.9) | (x[:, 1] > 134.9)] / 1.0
    inwards = np.where(edge[:, 0] > 234.9, drawn[:, 0], drawn[:, 1])
    assert q["draw_in"]["largest_mm"] == pytest.approx(inwards.max(), rel=0.02)


def energy_of_table_1(X, x, cells):
    """Strain energy [N mm] of a ply 1 mm thick, yarns along x and y, on flat triangles; its shear
    angles [rad] and their areas: equation (30) with the numbers of Table 1 of Schaefer et al."""
    edges, moved = (np.moveaxis(p[cells[:, 1:]] - p[cells[:, :1]], 1, 2) for p in (X, x))
    areas = abs(np.linalg.det(edges[:, :2])) / 2
    f, g = np.moveaxis(moved @ np.linalg.inv(edges[:, :2]), 2, 0)
    la, lb = np.linalg.norm(f, axis=1), np.linalg.norm(g, axis=1)
    gamma = abs(np.arcsin((f * g).sum(1) / la / lb))
    density, coupled = 0.0, 1.0
    shear = 25.06e-3 * gamma**2 / 2 - 186.79e-3 * gamma**3 / 3 + 562.39e-3 * gamma**4 / 4
    for mine, other in ((la, lb), (lb, la)):
        e, more = mine - 1, mine**2 - 1
        tension = (4130.0 * e + 667.5) * e**2 * (0.25 * np.exp(23.67 * (other - 1)) + 0.75)
        density = density + np.where(e > 0, tension, 0.65 * e**2)
        shear = shear + np.where(more > 0, 1467.6 * gamma**3 * more**2 / 3, 0.0)
        coupled = coupled * np.exp(100.0 * np.minimum(more, 0) ** 3)
    return float(areas @ (density + shear * coupled)), gamma, areas


def test_the_whole_ply_is_four_quarters(launch):
    same = "--ny", 5, "--steps", 3, *EXACT, "--no-error"
    same += "--set", "contact.lag=1e-4", "--set", "stage.1.moves.punch=12"
    quarter = launch("double_dome", "--nx", 8, *same)
    x, u = placed(quarter.folder)
    whole = launch("double_dome", "--set", "blank.symmetry=none", "--nx", 16, "--ny", 10, *same[2:])
    assert quarter.status == whole.status == 0, whole.err
    assert not any("only locate the sheet" in w for w in said(whole.summary))
    full_x, full_u = placed(whole.folder)
    at = {tuple(place): k for k, place in enumerate(full_x)}
    for mirror in np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [-1, -1, 1]]):
        there = full_u[[at[tuple(place + 0.0)] for place in x * mirror]]
        assert abs(there * mirror - u).max() < 1e-6 * abs(u).max()
    force = quarter.summary["quantities"]["force_of_whole_blank_N"]
    assert whole.summary["reaction_N"] == pytest.approx(force, rel=1e-6)
    assert force == pytest.approx(4 * quarter.summary["reaction_N"], rel=1e-12)


@pytest.mark.long
def test_plies_that_end_early_are_told_with_the_reason(launch, monkeypatch):
    """Without a floor of the biaxial coupling yarns have no stiffness left beside squeezed ones."""
    monkeypatch.setitem(compression_parameters.VARIED, "p_min", (0.0, 0.75))
    coarse = "--nx", 7, "--steps", 10, "--balance", 9, "--no-pictures"
    done = launch("compression_parameters", *coarse, "--vary", "p_min")
    assert done.status == 3 and "1 of 2 plies were not formed to the end" in done.err
    with open(done.folder / "parameters.csv") as file:
        ended, formed = csv.DictReader(file)
    words, load = "yarns are stretched by more than 10 % in ", float(ended["stroke_reached"])
    assert words in ended["reason"] and "(--max-strain)" in ended["reason"]
    assert 0.2 < load < 0.5 and not formed["reason"] and float(formed["stroke_reached"]) == 1
    names = json.loads((done.folder / "summary.json").read_text())["quantities"]
    assert {*names} == {"p_min = 0", "p_min = 0.75"}
