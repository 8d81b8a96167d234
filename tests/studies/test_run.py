"""What a user lives with: runs that end early and go on, results that are not lost, the log and the
report."""

import csv
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
import pyvista
from mpi4py import MPI

from fabric_fenicsx.cli.study import Study, parser
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.core.files import lock_folder
from fabric_fenicsx.core.processes import RANKS_ENVIRONMENT, on_ranks
from fabric_fenicsx.coupons.tensile import Tensile
from fabric_fenicsx.results.states import read_state

COMM = MPI.COMM_WORLD
ROOT = Path(__file__).parents[2]
OPTIONS = "--quick", "--steps", 60, "--no-pictures"
KEPT = "load displacement_mm reaction_N strain_energy_Nmm external_work_Nmm min_stability".split()
KILLS = int(os.environ.get("KILLS", 2))
PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}


def history(folder):
    with open(folder / "history.csv") as file:
        return list(csv.DictReader(file))


def same_curve(folder, other, rel=1e-9):
    rows, others = history(folder), history(other)
    for name in ("load", "reaction_N", "strain_energy_Nmm", "external_work_Nmm", "iterations"):
        values, known = (np.array([float(row[name]) for row in table]) for table in (rows, others))
        assert values == pytest.approx(known, rel=rel, abs=1e-9 * abs(known).max()), name


@pytest.fixture(scope="module")
def whole(tmp_path_factory, run_script):
    """Folder of an uninterrupted run."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    status, *_ = run_script(folder.parent, *command("--out", folder)[1:])
    assert status == 0
    return folder


def command(*options):
    return [sys.executable, str(ROOT / "studies" / "tensile.py"), *map(str, (*OPTIONS, *options))]


def begun(folder, *options):
    return subprocess.Popen(command("--out", folder, *options), **PIPES)


def rows_written(folder):
    file = folder / "history.csv"
    return file.read_text().count("\n") - 1 if file.exists() else 0


def wait_for_rows(process, folder, rows=5):
    while rows_written(folder) < rows:
        assert process.poll() is None
        time.sleep(0.002)


def everything(folder):
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_results_are_lost_only_if_that_is_asked(launch):
    done = launch("tensile", "--quick")
    assert done.status == 0
    before = everything(done.folder)
    for part in ((), ("--compare",)):  # whose results are in subfolders
        again = launch("tensile", "--quick", "--strain", 0.01, *part, overwrite=False)
        assert again.status == 2 and again.err.count("\n") == 1
        assert "--overwrite" in again.err and "--resume" in again.err
        assert everything(done.folder) == before
    both = launch("tensile", "--quick", "--resume", "--overwrite")
    assert both.status == 2 and "one of them" in both.err


@pytest.mark.mpi
@pytest.mark.parametrize("option", ["--resume", "--overwrite"])
def test_a_folder_in_use_is_refused(launch, option):
    """However a second run would take it, on any number of ranks."""
    done = launch("tensile", *OPTIONS, "--steps", 3)
    before = everything(done.folder)
    with lock_folder(done.folder) if COMM.rank == 0 else nullcontext():
        again = launch("tensile", *OPTIONS, option, overwrite=False)
        assert again.status == 2 and again.err.count("error: --out ") == 1, again.err
        assert "is in use by another run; expected" in again.err
        assert everything(done.folder) == before


def test_a_run_holds_its_folder_from_before_it_writes(tmp_path):
    def study(*options):
        return Study("tensile", parser(Tensile, ""), ["--out", str(tmp_path / "out"), *options])

    first = study()
    first.folder()
    assert not lock_folder(tmp_path / "out")
    for options in ((), ("--overwrite",)):  # nothing is written yet
        with pytest.raises(InputError, match="`out` .*out is in use by another run"):
            study(*options).folder()
    first.folder("part")  # its own
    del first
    study().folder()


def test_ends_after_its_step_if_asked_and_goes_on(launch, tmp_path, whole, hang):
    process = begun(tmp_path / "out")
    wait_for_rows(process, tmp_path / "out")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=hang)
    assert process.returncode == 3
    told = r"stopped by SIGINT at load factor [\d.]+; --resume continues from there"
    assert re.fullmatch(rf"studies/tensile.py: {told}\n", err)
    assert 5 <= rows_written(tmp_path / "out") < 61
    assert launch("tensile", *OPTIONS, "--resume").status == 0
    same_curve(tmp_path / "out", whole)


@pytest.mark.versions
def test_ranks_end_together_if_asked_and_one_goes_on(launch, tmp_path, whole, hang):
    folder, words = tmp_path / "out", [*on_ranks(2), *command("--out", tmp_path / "out")]
    process = subprocess.Popen(words, **PIPES, env=os.environ | RANKS_ENVIRONMENT)
    wait_for_rows(process, folder)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=hang)
    assert process.returncode != 0
    done = launch("tensile", *OPTIONS, "--resume")
    assert done.status == 0 and done.summary["steps_accepted"] == 60
    same_curve(folder, whole)
    times = pyvista.PVDReader(folder / "fields.pvd").time_values
    assert times == pyvista.PVDReader(whole / "fields.pvd").time_values


def test_a_finished_run_stays_and_gets_the_pictures_that_it_lacks(launch):
    done = launch("bias_extension", "--quick", "--no-pictures")
    for pictures in (("--no-pictures",), ()):
        again = launch("bias_extension", "--quick", "--resume", *pictures)
        assert again.status == 0 and "nothing to do" in again.err
        assert again.summary == done.summary and again.out == done.out
    drawn = {file.name for file in done.folder.glob("*.png")}
    assert {"maps.png", "curve.png", "axis.png"} <= drawn


def test_killed_at_any_moment_it_goes_on(launch, tmp_path, whole):
    """Killed again and again, in a step, between steps or before the first; what is left is gone on
    from."""
    chance, folder, killed = random.Random(1), tmp_path / "out", 0

    def more():
        return "--resume" if (folder / "checkpoint.npz").exists() else "--overwrite"

    while killed < KILLS:
        process, before = begun(folder, more()), rows_written(folder)
        further, patience = chance.choice([0, 1, 5, 20]), time.monotonic() + chance.uniform(0.2, 1)
        while process.poll() is None and (
            rows_written(folder) < before + further if further else time.monotonic() < patience
        ):
            time.sleep(0.001)
        time.sleep(chance.uniform(0, 0.03))  # about a step
        ended = process.poll()
        process.kill()
        _, err = process.communicate()
        assert ended in (None, 0), err
        if (folder / "fields.pvd").exists():  # what ParaView would open
            series = pyvista.PVDReader(folder / "fields.pvd")
            for at in series.time_values:
                series.set_active_time_value(at)
                assert series.read().combine().n_cells
        killed += ended is None
        if ended == 0:
            same_curve(folder, whole)
            shutil.rmtree(folder)
    assert launch("tensile", *OPTIONS, more(), overwrite=False).status == 0
    same_curve(folder, whole)


SMALL_DISK = """
import resource, runpy, sys
from mpi4py import MPI  # whose own files may be larger
sys.path.insert(0, sys.argv[1].rpartition("/")[0])
limit, sys.argv = int(sys.argv[2]), sys.argv[1:2] + sys.argv[3:]
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.mark.parametrize("limit", [1_000, 62_000])
def test_full_disk(launch, tmp_path, whole, limit):
    """As far as files of a limited size tell: one sentence, and what was there goes on once there
    is space."""
    folder = tmp_path / "out"
    python, script, *options = command("--out", folder)
    words = [python, "-c", SMALL_DISK, script, str(limit), *options]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    told = r"studies/tensile.py: error: \S+ can't be .*\(File too large\); expected .*\n"
    assert re.fullmatch(told, done.stderr)
    assert not list(folder.glob("*.part"))
    if (folder / "checkpoint.npz").exists():
        assert launch("tensile", *OPTIONS, "--resume").status == 0
        same_curve(folder, whole)


def flat(values, name=""):
    """{path: number} of nested summaries."""
    if isinstance(values, list):
        values = dict(enumerate(values))
    if isinstance(values, dict):
        parts = (flat(each, f"{name}/{key}") for key, each in values.items())
        return {key: number for part in parts for key, number in part.items()}
    return {name: values} if isinstance(values, (int, float)) else {}


# on two ranks numbers are known: test_tensile.py, test_numbers_are_the_same_on_every_debian
def test_every_output_is_that_of_any_number_of_ranks(launch):
    outputs = []
    # to the solver's tolerance along the whole path, as that is what is compared
    exact = "--path-tolerance", 1e-10, "--tolerance", 1e-10, "--no-pictures"
    for ranks in (1, 3):
        done = launch("bias_extension", "--nx", 12, "--steps", 2, *exact, ranks=ranks)
        assert done.status == 0, done.err
        names = "dofs", "cells", "steps_accepted", "energy", "reaction_N", "quantities"
        summary = {k: done.summary[k] for k in names}
        rows = [{k: float(v) for k, v in row.items() if k in KEPT} for row in history(done.folder)]
        grid = read_state(done.folder)
        order = np.lexsort(np.round(grid.cell_centers().points.T, 6))
        fields = {k: np.asarray(v)[order] for k, v in grid.cell_data.items() if k != "rank"}
        x = np.round(grid.points[:, :2], 6) + 0.0
        x, once = np.unique(x, axis=0, return_index=True)  # nodes that ranks share are there twice
        nodes = np.column_stack([x, grid.point_data["u"][once, :2]])
        axis = np.loadtxt(done.folder / "axis.csv", delimiter=",", skiprows=1)
        arrays = fields | {"axis": axis, "nodes": nodes}
        outputs.append((flat(summary) | flat(rows, "row"), arrays))
    (numbers, arrays), (mine, others) = outputs
    assert mine == pytest.approx(numbers, rel=1e-6, abs=1e-9)
    for name in ("/reaction_N", "/energy/strain"):
        assert mine[name] == pytest.approx(numbers[name], rel=1e-8)
    assert others.keys() == arrays.keys()
    for name, values in others.items():
        assert values == pytest.approx(arrays[name], rel=1e-6, abs=1e-6), name


@pytest.mark.versions
def test_report(launch):
    done = launch("bias_extension", "--quick", "--strain", 0.05)
    text = (done.folder / "report.html").read_text()
    assert "Verdict: " in text and f"{done.summary['reaction_N']:.5g}" in text
    for word in ("--strain 0.05", "s_T = 1467.6", "petsc4py", "centre shear angle [deg]"):
        assert word in text, word
    assert text.count("data:image/png;base64,") == len(list(done.folder.glob("*.png"))) >= 3
    assert set(re.findall(r"(?:src|href)=\"(\w+):", text)) == {"data"} and "<script" not in text
