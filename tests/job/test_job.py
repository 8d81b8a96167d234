"""Jobs without options or studies: in a folder, without one, resumed, and what they measure."""

import csv
import json
import os
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from builders import COARSE, COMM, said
from dolfinx import fem

import fabric_fenicsx as ff
from fabric_fenicsx.core.processes import RANKS_ENVIRONMENT, on_ranks
from fabric_fenicsx.job import dry_run
from fabric_fenicsx.job.observers import ProgressLog
from fabric_fenicsx.job.setup import Observer
from fabric_fenicsx.results.output import Output
from fabric_fenicsx.results.states import states


@pytest.mark.mpi
def test_without_a_folder_nothing_is_kept_but_the_result(tmp_path, monkeypatch):
    monkeypatch.chdir(COMM.bcast(tmp_path))
    result = ff.Tensile(**COARSE).job(steps=3).run()
    COMM.barrier()
    assert result.folder is None and not any(COMM.bcast(tmp_path).iterdir())
    assert [row["load"] for row in result.rows] == pytest.approx([0, 1 / 3, 2 / 3, 1])
    assert result.summary["converged"] and result.summary["reaction_N"] > 1000
    edges = result.outline()
    if COMM.rank == 0:
        assert result.grid.n_cells == result.summary["cells"]
        (edge,) = edges
        assert np.ptp(edge.formed[:, 0]) > np.ptp(edge.undeformed[:, 0]) == pytest.approx(200)
    least, largest = result.summary["quantities"]["log_eps_11"]
    assert least <= result.at((100, 25), "log_eps_11") <= largest
    for place, name in (((300, 25), "log_eps_11"), ((100, 25), "nothing")):
        with pytest.raises(ff.InputError, match="not on the flat sheet|field nothing is unknown"):
            result.at(place, name)


@pytest.mark.versions
@pytest.mark.mpi
def test_a_folder_holds_what_the_result_tells(folder):
    result = ff.Tensile(**COARSE).job(steps=2, every=1).run(folder, pictures=False)
    summary = json.loads((folder / "summary.json").read_text())
    if COMM.rank == 0:  # each rank has its own wall time
        assert summary == json.loads(json.dumps(result.summary))
    with open(folder / "history.csv") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["reaction_N"]) for row in rows] == [r["reaction_N"] for r in result.rows]
    with pytest.raises(ff.InputError, match="holds results"):
        ff.Tensile(**COARSE).job(steps=2).run(folder)
    again = ff.Tensile(**COARSE).job(steps=2).run(folder, overwrite=True, pictures=False)
    assert again.summary["reaction_N"] == pytest.approx(result.summary["reaction_N"], rel=1e-12)


@pytest.mark.versions
@pytest.mark.mpi
def test_a_job_goes_on_from_its_checkpoint(folder):
    def pull(**limits):
        return ff.Tensile(**COARSE).job(steps=4, limits=ff.Limits(**limits))

    whole = pull().run()
    with pytest.raises(ff.SolverFailure, match="not valid") as failure:
        pull(strain=0.01).run(folder, pictures=False)
    reached = failure.value.result.summary["stroke_reached"]
    assert 0 < reached < 1
    rest = pull().run(folder, resume=True, pictures=False)
    assert rest.summary["reaction_N"] == pytest.approx(whole.summary["reaction_N"], rel=1e-9)
    assert len(rest.rows) == len(whole.rows)


def loaded(stroke=0.5, k=0.01, mu=0.25, height=-31.0, turn=0.0, fabric=None):
    """A sheet with an own term and terms of the package, in a few cells."""

    class Bedding(ff.Term):
        name = energy_kind = "bedding"

        def __init__(self, k):
            self.k = k

        def set_up(self, scene):
            u = scene.blank.u
            self.energy = fem.Constant(scene.blank.mesh, self.k) * ufl.inner(u, u) * self.part.dx(2)

    ply = ff.Blank.rectangle(20, 10, nx=4, spatial=True, fibre_angle=turn)
    ball = ff.Tool(ff.Sphere(30.0), path=lambda load: (10, 5, height + 0.01 * load))
    terms = [ff.Membrane(fabric or ff.load("komeili")), ff.Bending(modulus=100.0), Bedding(k)]
    terms += [ff.DeadPressure(1e-3, (0, 0, -1)), ff.Contact(ball, friction=mu)]
    return ff.Job(ff.Scene(ply, terms, ff.clamped_ends(stroke)), steps=2)


OTHER = {
    "k": (1.0, "k of term 3, bedding = 0.01, now it is 1.0"),
    "mu": (0.3, "coulomb.coefficient of term 5, contact = 0.25, now it is 0.3"),
    "height": (-32.0, "tool.path of term 5, contact = .*-30.99"),
    "stroke": (0.6, r"largest displacement of supports \[mm\] = 0.5, now it is 0.6"),
    "turn": (45.0, "directions of the yarns = "),
    "fabric": (ff.load("komeili").replace(b=600.0), "material.yarns.b = 667.5, now it is 600.0"),
}


@pytest.mark.mpi
def test_a_checkpoint_of_other_numbers_of_terms_is_refused(folder):
    first = loaded().run(folder, pictures=False)
    again = loaded().run(folder, resume=True, pictures=False)
    assert again.summary["energy"] == first.summary["energy"]
    last = first.rows[-1]  # also of bending, whose normals were taken anew after it
    assert first.summary["energy"]["bending"] == last["bending_energy_Nmm"] > 0
    for name, (value, words) in OTHER.items():
        with pytest.raises(ff.InputError, match=f"was made with {words}.*use the same"):
            loaded(**{name: value}).run(folder, resume=True, pictures=False)


def test_a_setup_of_ones_own_is_measured_and_written(folder):
    """Of a quarter, with every fourth state, that of a milestone and the last one in fields.pvd."""

    class Own(ff.Setup):
        modelled_share = 0.25

        def quantities(self, result):
            return {"mean_eps_a": float(np.mean(result.fields["eps_a"]))}

        def end(self, result, folder):
            (folder / "own.txt").write_text("own")

    class Loads(Observer):
        def begin(self, folder, pictures):
            self.seen = [(folder, pictures)]

        def accept(self, accepted):
            self.seen.append(accepted.load)

    scene, loads = ff.Tensile(**COARSE).build().scene, Loads()
    job = ff.Job(Own(scene), steps=4, every=4, milestones=(0.6,), observers=[loads])
    result = job.run(folder, pictures=False)
    assert loads.seen == [(folder, False), *(row["load"] for row in result.rows)]
    summary, last = result.summary, result.rows[-1]
    assert summary["quantities"]["mean_eps_a"] == pytest.approx(0.03, rel=0.1)
    assert (folder / "own.txt").read_text() == "own"
    measured = ff.Tensile(**COARSE).job(steps=1).run()
    assert last["reaction_N"] == pytest.approx(measured.number("reaction_N"))
    assert summary["reaction_N"] == last["reaction_N"]
    assert last["reaction_of_whole_N"] == pytest.approx(4 * last["reaction_N"])
    assert last["displacement_mm"] == pytest.approx(measured.rows[-1]["displacement_mm"])
    assert [row["load"] for row in result.rows] == pytest.approx([0, 0.25, 0.5, 0.6, 0.85, 1])
    assert [state.load for state in states(folder)] == pytest.approx([0, 0.6, 0.85, 1])


def test_the_time_that_is_left_is_told_by_the_mean_and_the_last_step():
    """From a quarter on in 20 s; the last tenth took so many, the one under way 12 s up to now."""
    told = ((10, 0, "00:40 to 01:15"), (10, 12, "00:40 to 01:30"), (2, 0, "00:10 to 01:00"))
    for seconds, since, left in told:
        times = {"began": 100.0, "step_began": 120.0, "seconds": float(seconds), "size": 0.1}
        run = SimpleNamespace(load=0.5, start=0.25, MAX_SLOWDOWN=ProgressLog.MAX_SLOWDOWN, **times)
        assert ProgressLog.left(run, since) == f", {left} left"
    run.load = run.start
    assert ProgressLog.left(run, since) == ""


def test_what_a_run_costs_is_told_by_its_first_step(monkeypatch, folder):
    """3 s of 4 steps, after 10 s: 0.6 to 1.5 times 12 s more; a quarter of the cells in the fewest
    steps, 2, takes an eighth."""
    times = iter((100.0, 110.0, 110.0, 113.0))
    monkeypatch.setattr(dry_run, "_first_step", lambda *_: (9, ""))
    monkeypatch.setattr(dry_run.time, "process_time", lambda: next(times))
    job = ff.Tensile(**COARSE).job(steps=4, error=True)
    lines = dry_run.checked(job, Output("run", folder), "", False)
    assert lines[1].startswith("the run takes 17 to 28 s, or several times")
    assert "9 iterations at the first of 4 steps took 3 s, setup took 10 s" in lines[1]
    assert lines[2] == "the error estimate on coarser cells takes 0.9 to 2.2 s more"


def test_a_last_state_that_is_not_valid_is_told_so():
    """There is no step after it that would not be taken."""
    with pytest.raises(ff.SolverFailure, match="stretched by more than 1 % in") as failure:
        ff.Tensile(**COARSE).job(steps=1, limits=ff.Limits(strain=0.01)).run()
    summary = failure.value.result.summary
    assert summary["stroke_reached"] == 1 and summary["verdict"] == "invalid"


def over_a_ball(start):
    """A job on a clamped sheet over a ball of 30 mm that rises by 5 mm, and the ball."""
    ply = ff.Blank.rectangle(100, 100, nx=8, spatial=True, centred=True)
    ball = ff.Tool(ff.Sphere(30), lambda load: (0, 0, start + 5 * load), name="ball")
    terms = [ff.Membrane(ff.load("komeili")), ff.Bending(modulus=100.0), ff.Contact(ball)]
    scene = ff.Scene(ply, terms, supports=ff.clamped_ends())
    return ff.Job(scene, steps=1, limits=ff.Limits(imbalance=9)), ball


def test_a_tool_that_the_sheet_is_in_is_told_before_anything_runs(folder):
    with pytest.raises(ff.InputError, match="ball penetrates the sheet by .* mm at"):
        over_a_ball(-28)[0].run(folder)
    assert not folder.exists()


@pytest.mark.mpi
@pytest.mark.parametrize("start", [-60, -30.5])
def test_a_tool_that_never_touches_the_sheet_is_told_of(shared_path, start):
    """Fields of nodes are drawn. A scene that was run is not run again: friction remembers."""
    job, ball = over_a_ball(start)
    words = "a tool never touched the sheet: ball moved by 5 mm, and is still 24.5 mm away"
    result = job.run()
    told = said(result.summary)
    assert any(text.startswith(words) for text in told) == (start == -60)
    assert not any("nothing moves" in text for text in told)
    assert (result.force(ball)[2] > 0) == (start != -60)
    assert (result.force("ball") == result.force(ball)).all()
    for other in ("bowl", ff.Tool(ball.surface, ball.path, name="ball")):
        with pytest.raises(ff.InputError, match="the scene has no tools 'b.*'; expected"):
            result.force(other)
    result.plot("contact_gap", shared_path / "gap.png")
    assert COMM.rank or (shared_path / "gap.png").stat().st_size > 1000
    with pytest.raises(ff.InputError, match="contact_gap is unknown.*, shear_angle.*; .*nodes"):
        result.fields["contact_gap"]
    with pytest.raises(ff.InputError, match="scene of .* was run before .* use a new scene"):
        replace(job, steps=2).run()


FAILS_ALONE = """
import fabric_fenicsx as ff

class Mine(ff.Term):
    name = energy_kind = "mine"

    def add_forces(self, f):
        if self.blank.mesh.comm.rank == 1:
            raise IndexError("on one rank alone")

blank = ff.Blank.rectangle(20, 10, nx=4)
scene = ff.Scene(blank, [ff.Membrane(ff.load("komeili")), Mine()], ff.clamped_ends(0.1))
ff.Job(scene, steps=1).run()
"""


@pytest.mark.versions
def test_a_rank_that_fails_alone_ends_the_others(hang):
    how = {"capture_output": True, "text": True, "env": os.environ | RANKS_ENVIRONMENT}
    done = subprocess.run([*on_ranks(2), sys.executable, "-c", FAILS_ALONE], timeout=hang, **how)
    assert done.returncode and "IndexError: on one rank alone" in done.stderr
