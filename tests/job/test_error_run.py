"""Estimated errors of a run, from the same run on a coarser mesh."""

import csv
import json

import meshio
import numpy as np
import pytest
from builders import COARSE, COMM, said
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.coupons.tensile import TensileSetup as Strip
from fabric_fenicsx.job.error_run import FOLDER
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.results.error import (
    ENERGY,
    MIN_SHARE,
    OTHER_CELLS,
    Rule,
    curve_errors,
    lag_of,
    rule,
)


@pytest.mark.versions
def test_a_strips_error_is_told_by_other_cells(folder):
    """OTHER_CELLS times the difference to P2 cells along the yarns; in summary.json."""
    result = ff.Tensile(**COARSE).job(steps=4, error=True).run(folder, pictures=False)
    other = ff.Tensile(nx=2, element="P2", pattern="yarns").job(steps=2).run()
    apart = result.summary["reaction_N"] - other.summary["reaction_N"]
    error = result.summary["error"]["reaction_N"]
    assert error == pytest.approx(OTHER_CELLS * abs(apart), rel=1e-4)
    assert result.summary["error_run"]["cells"] == other.summary["cells"]
    assert (folder / FOLDER / "history.csv").exists()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["error"] == result.summary["error"]


def test_other_errors_are_no_smaller_than_those_of_the_late_force(folder):
    """Of cells of the same kind, twice as large: runs may agree in one number by chance."""
    frame = dict(fibre_angle=30.0, pattern="yarns", element="P1", strain=0.02)
    result = ff.BiasExtension(**frame, nx=16).job(steps=4, error=True).run()
    other = ff.BiasExtension(**frame, nx=8).job(steps=2).run()
    forces = {row["load"]: row["reaction_N"] for row in result.rows}
    shares = [abs(row["reaction_N"] / forces[row["load"]] - 1) for row in other.rows[1:]]
    errors = result.summary["error"]
    share = np.sqrt(np.mean(np.square(shares)))
    for name, factor in (("strain_energy_Nmm", ENERGY), ("reaction_N", 1.0)):
        value = result.number(name)
        told = max(factor * abs(value - other.number(name)), share * abs(value))
        assert errors[name] == pytest.approx(told, rel=1e-3)


def test_curve_and_fields_have_errors(folder):
    result = ff.Tensile(**COARSE).job(steps=4, error=True).run(folder, pictures=False)
    with open(folder / "history.csv", newline="") as file:
        errors = [float(row["error_N"]) for row in csv.DictReader(file)]
    assert len(errors) == 5 and errors[-1] > 0
    assert max(errors) == pytest.approx(result.summary["error"]["curve_N"])
    assert result.fields["error_shear_angle"].shape == result.fields["shear_angle"].shape
    assert result.fields.units["error_shear_angle"] == "rad"
    if COMM.rank == 0:
        assert np.asarray(result.grid.cell_data["error_log_eps_22"]).max() > 0


@pytest.mark.mpi
def test_errors_do_not_depend_on_ranks():
    def errors(comm):
        strip = ff.BiasExtension(nx=16, strain=0.05).build(comm)
        return told(strip.job(steps=6, error=True).run())

    one, two = errors(MPI.COMM_SELF), errors(COMM)
    assert one.keys() == two.keys()
    for name, value in one.items():
        assert two[name] == pytest.approx(value, rel=1e-3, abs=1e-9), name


def told(result):
    return {name: error for name, error in result.summary["error"].items() if error is not None}


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


def test_a_coarser_run_that_was_stopped_goes_on(folder):
    """Its own checkpoint is gone on from."""
    test = ff.Tensile(**COARSE)
    whole = told(test.job(steps=4, error=True).run(folder, pictures=False))
    summary = json.loads((folder / "summary.json").read_text())
    del summary["error"]
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / FOLDER / "summary.json").unlink()
    again = ff.Tensile(**COARSE).job(steps=4, error=True).run(folder, resume=True, pictures=False)
    assert told(again) == pytest.approx(whole, rel=1e-6)


def test_an_own_mesh_has_no_coarser_one(tmp_path):
    points, cells, kind = specimen(nx=8, ny=2)
    meshio.write_points_cells(tmp_path / "strip.msh", points, [(kind, cells)])
    job = ff.Tensile(mesh=str(tmp_path / "strip.msh")).job(error=True)
    with pytest.raises(ff.InputError, match="none is known; allowed is a rectangle .* `coarser`"):
        job.run()


def test_a_coarser_run_that_fails_costs_the_errors_alone():
    def refused():
        raise ff.InputError("no such mesh; allowed is another")

    job = ff.Tensile(**COARSE).job(steps=2, coarser=refused, error=True)
    summary = job.run().summary
    assert summary["converged"] and "error" not in summary
    assert any("no error is known" in text and "no such mesh" in text for text in said(summary))


def test_a_homogeneous_state_has_no_error():
    frame = ff.PictureFrame(nx=4, angle=20.0).job(steps=8, error=True).run()
    error, force = frame.summary["error"], frame.number("normalised_shear_force_N_per_mm")
    assert error["normalised_shear_force_N_per_mm"] <= 1e-8 * force
    assert error["shear_angle_rms_deg"] < 1e-6


@pytest.mark.parametrize("order", [1.0, 3.0])
def test_the_errors_of_a_curve_are_covered(order):
    """A parabola that a mesh of size h puts off by h^order, and the lines that join its points."""
    loads = [np.linspace(0, 1, n) for n in (11, 6)]
    rows, others = (
        [{"load": x, "reaction_N": 5 * x**2 + x * h**order} for x in load]
        for load, h in zip(loads, (0.1, 0.2))
    )
    of_mesh, of_lines = curve_errors(rows, others, Rule(1.0, 1.0, 0.0))
    errors = of_mesh + of_lines
    fine = np.linspace(0, 1, 201)
    joined = np.interp(fine, loads[0], [row["reaction_N"] for row in rows])
    off = np.abs(joined - 5 * fine**2)
    assert (np.interp(fine, loads[0], errors) >= off - 1e-12).all()
    assert errors.max() < 3 * off.max()
    assert of_lines == pytest.approx(np.full(11, 5 * 0.1**2 / 4))


def test_a_chance_agreement_tells_nothing():
    """Two curves that cross at full load are 20 % apart before."""
    run, other = (
        [{"load": x, "reaction_N": 10 * x + s * x * (1 - x)} for x in (0, 0.5, 1)] for s in (0, 4)
    )
    share = 0.2 / np.sqrt(2)  # root mean square with the end's 0
    by = rule(run, other, of_other_kind=False)
    assert by == pytest.approx((1.0, ENERGY, share))
    assert by.error(10.0, 0.0) == pytest.approx(10 * share)
    assert by.error(10.0, 4.0) == pytest.approx(2 * by.error(10.0, 4.0, is_energy=True))
    assert rule(run, other, of_other_kind=True) == pytest.approx((OTHER_CELLS,) * 2 + (0.2,))


def test_two_runs_know_no_error_below_a_thousandth():
    runs = [
        [{"load": x, "reaction_N": f * x} for x in (0, 0.5, 1)] for f in (10, 10.001, 10 + 1e-7)
    ]
    assert rule(runs[0], runs[1], of_other_kind=True).share == MIN_SHARE
    assert rule(runs[0], runs[2], of_other_kind=True).share == pytest.approx(1e-8)


def test_no_error_is_below_that_of_lagging_contact():
    press = ff.Press.read("hemisphere", ["blank.nx=4", "contact.lag=0.004"])
    lag = lag_of(press.build().job().scene)
    runs = [[{"load": x, "reaction_N": f * x} for x in (0, 0.5, 1)] for f in (10, 10.001)]
    assert rule(*runs, of_other_kind=True, lag=lag).share == 2 * 0.004


def test_a_tool_that_has_gone_back_tells_no_share():
    run, other = (
        [{"load": x, "reaction_N": f} for x, f in zip((0, 0.5, 1), forces)]
        for forces in ((0, 10.0, 0.0), (0, 9.0, 0.01))
    )
    assert rule(run, other, of_other_kind=False).share == pytest.approx(
        np.hypot(0.1, 0.02) / np.sqrt(2)
    )


def test_an_error_above_half_of_the_number_is_unknown():
    by = Rule(1.5, 1.5, 0.0)
    assert by.error(-1.0, 0.33) == pytest.approx(0.495)
    assert by.error(-1.0, 0.34) is None
    assert by.error(1e-9, 1e-3) is None  # of a number near zero


def test_only_errors_of_forces_are_told_where_cells_crumple(monkeypatch):
    quantities = Strip.quantities

    def crumpled(self, result):
        return quantities(self, result) | {"shortening_at_shear_angle_max": 0.06}

    monkeypatch.setattr(Strip, "quantities", crumpled)
    result = ff.Tensile(**COARSE).job(steps=2, error=True).run()
    assert {name for name, error in result.summary["error"].items() if error is not None} == {
        "reaction_N",
        "strain_energy_Nmm",
        "curve_N",
        "curve_steps_N",
    }
    assert any("cells crumple" in text for text in said(result.summary))


@pytest.mark.parametrize("options, told", [(("--nx", 32), True), (("--nx", 31), False)])
def test_strips_of_1000_cells_tell_their_errors_unasked(launch, options, told):
    pictures = () if told else ("--no-pictures",)
    done = launch("tensile", *options, "--element", "P1", "--steps", 2, *pictures)
    assert done.status == 0, done.err
    assert (done.folder / "error.png").exists() == told
    page = (done.folder / "report.html").read_text()
    assert ("estimated absolute errors" in page) == told
    assert ("error" in done.summary) == told == (" +- " in done.out)
