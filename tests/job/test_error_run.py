"""Runs on coarser cells for errors, and what a job measures."""

import csv
import json

import numpy as np
import pytest
from builders import COARSE, COMM, Elastic, said, sheet
from mpi4py import MPI

import fabric_fenicsx as ff


@pytest.mark.versions
@pytest.mark.mpi
def test_a_strips_errors_are_told_by_other_cells(folder):
    """1.75 times the difference to P2 cells along the yarns on one rank; in summary.json,
    history.csv and the fields."""
    result = ff.Tensile(**COARSE).job(steps=4, error=True).run(folder, pictures=False)
    other = ff.Tensile(nx=2, element="P2", pattern="yarns").build(MPI.COMM_SELF).job(steps=2).run()
    apart, error = result.number("reaction_N") - other.number("reaction_N"), told(result)
    assert error["reaction_N"] == pytest.approx(1.75 * abs(apart), rel=1e-4)
    assert result.summary["error_run"]["cells"] == other.summary["cells"]
    assert (folder / "coarse" / "history.csv").exists()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["error"] == result.summary["error"]
    with open(folder / "history.csv", newline="") as file:
        errors = [float(row["error_N"]) for row in csv.DictReader(file)]
    assert len(errors) == 5 and max(errors) == pytest.approx(error["curve_N"])
    assert result.fields.units["error_shear_angle"] == "rad"
    if COMM.rank == 0:
        assert np.asarray(result.grid.cell_data["error_log_eps_22"]).max() > 0


def told(result):
    return {name: error for name, error in result.summary["error"].items() if error is not None}


def test_an_own_coarser_run_has_cells_of_the_same_kind():
    """Its difference counts once; at least is the root mean square of the curve's."""

    def strip(nx, **options):
        return ff.Tensile(nx=nx, element="P1").job(steps=2, **options)

    result, other = strip(8, error=True, coarser=lambda: strip(4)).run(), strip(4).run()
    forces, others = ([row["reaction_N"] for row in each.rows[1:]] for each in (result, other))
    least = np.sqrt(np.mean((np.divide(others, forces) - 1) ** 2)) * forces[-1]
    expected = max(abs(forces[-1] - others[-1]), least)
    assert told(result)["reaction_N"] == pytest.approx(expected, rel=1e-3)


def test_errors_come_after_the_run_too(folder):
    """A run that has ended gets its errors by going on, once."""
    at_once = ff.Tensile(**COARSE).job(steps=2, error=True).run()
    ff.Tensile(**COARSE).job(steps=2).run(folder, pictures=False)
    again = ff.Tensile(**COARSE).job(steps=2, error=True)
    later = again.run(folder, resume=True, pictures=False)
    assert told(later) == pytest.approx(told(at_once), rel=1e-6)
    written = (folder / "summary.json").stat().st_mtime_ns
    ff.Tensile(**COARSE).job(steps=2, error=True).run(folder, resume=True, pictures=False)
    assert (folder / "summary.json").stat().st_mtime_ns == written


def test_a_coarser_run_that_fails_costs_the_errors_alone():
    def refused():
        raise ff.InputError("no such mesh; allowed is another")

    job = ff.Tensile(**COARSE).job(steps=2, coarser=refused, error=True)
    summary = job.run().summary
    assert summary["converged"] and "error" not in summary
    assert any("no error is known" in text and "no such mesh" in text for text in said(summary))


def test_only_errors_of_forces_are_told_where_cells_crumple(monkeypatch):
    monkeypatch.setattr("fabric_fenicsx.results.error.mesh_decides", lambda _: "cells crumple")
    result = ff.Tensile(**COARSE).job(steps=2, error=True).run()
    assert {*told(result)} == {"reaction_N", "strain_energy_Nmm", "curve_N", "curve_steps_N"}
    assert any("cells crumple" in text for text in said(result.summary))


@pytest.mark.parametrize("nx, told", [(32, True), (31, False)])
def test_strips_of_1000_cells_tell_their_errors_unasked(launch, nx, told):
    pictures = () if told else ("--no-pictures",)
    done = launch("tensile", "--nx", nx, "--element", "P1", "--steps", 2, *pictures)
    assert done.status == 0, done.err
    assert (done.folder / "error.png").exists() == told
    page = (done.folder / "report.html").read_text()
    assert ("estimated absolute errors" in page) == told
    assert ("error" in done.summary) == told == (" +- " in done.out)


def test_a_tool_is_measured_along_its_motion(monkeypatch):
    """The first one that moves, by 5 mm along (3, 0, 4); a support that moves, too, is not."""
    ways = {"a": (0, 0, 0), "b": lambda load: (3 * load + 1, 2, 4 * load)}
    tools = [ff.Tool(ff.Sphere(5, (0, 0, -20)), way, name=k) for k, way in ways.items()]
    terms = [Elastic(), *(ff.Contact(tool, 1.0, 100.0) for tool in tools)]
    scene = ff.Scene(sheet(20, 10, 2, 1, spatial=True), terms, ff.clamped_ends(1.0))
    forces = {"a": (9.0, 9.0, 9.0), "b": (1.0, 2.0, 3.0)}
    monkeypatch.setattr("fabric_fenicsx.scene.output.tool_force", lambda _, tool: forces[tool.name])
    assert ff.Setup(scene).measure(scene, 0.5) == pytest.approx((2.5, 3.0))


def test_of_supports_the_one_that_moves_furthest_is_measured(monkeypatch):
    """Along the mean motion of its nodes, which goes to 3 and 4 mm at y = 5 mm."""
    pulled = lambda x, load: load * np.array([0.6 * x[1], 4 + 0 * x[1]])  # noqa: E731
    supports = [
        ff.Support("small", lambda x: x[0] < 1e-6, (0, 1), (-1.0, 0.0)),
        ff.Support("large", lambda x: x[0] > 20 - 1e-6, (0, 1), pulled),
    ]
    scene = ff.Scene(sheet(20, 10, 2, 2), [Elastic()], supports)
    monkeypatch.setattr(ff.Scene, "reaction", lambda _, name: {"large": [1.0, 2.0]}[name])
    assert ff.Setup(scene).measure(scene, 0.5) == pytest.approx((2.5, 0.6 + 1.6))
    still = ff.Scene(sheet(20, 10, 2, 2), [Elastic()])
    assert ff.Setup(still).measure(still, 1.0) == (0.0, 0.0)
