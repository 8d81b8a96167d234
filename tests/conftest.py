"""What tests of several folders share."""

import faulthandler
import gc
import io
import json
import logging
import os
import re
import runpy
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from fabric_fenicsx.core.processes import RANKS_ENVIRONMENT, on_ranks

ROOT = Path(__file__).parents[1]
# Seconds after which what a test started counts as hung: far more than the slowest takes on a
# machine with other work.
HANG = 3600
# Folders and files whose tests take longest, these first.
LONGEST = "studies", "sweep", "benchmarks", "test_docs.py", "forming", "identification"
# lines that tell of a step, and of what takes long
PROGRESS = re.compile(r": step \d+, .* iterations|; next: |, \d\d:\d\d$", re.M)


@pytest.hookimpl(trylast=True)
def pytest_configure(config):
    """A worker that crashes writes its traceback to a file, which `make test` shows last: what it
    writes to the screen is far above the list of failures."""
    if worker := os.getenv("PYTEST_XDIST_WORKER"):
        file = ROOT / ".pytest_cache" / f"crash_{worker}.txt"
        file.parent.mkdir(exist_ok=True)
        faulthandler.enable(open(file, "w"))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Of the parameters of a test on ranks the first run there, the others on one. The longest
    tests first: what is left in the end, when a worker has nothing more to take over, is short."""
    for item in items:
        call = getattr(item, "callspec", None)
        if call and any(call.indices.values()) and "mpi" not in [m.name for m in call.marks]:
            item.own_markers[:] = [m for m in item.own_markers if m.name != "mpi"]

    def place(item):
        folders = [k for k, name in enumerate(LONGEST) if name in item.path.parts]
        return not item.get_closest_marker("long"), min(folders, default=len(LONGEST))

    items.sort(key=place)


def pytest_collection_finish():
    """Garbage is looked for among what tests make, in 1 ms instead of 0.3 s after each study."""
    gc.collect()
    gc.freeze()


def world():
    """MPI's communicator. MPI begins when it is asked for first, in the process that runs tests:
    were it to begin in pytest-xdist's own, workers would inherit its environment, and no mpirun of
    theirs would start."""
    from mpi4py import MPI

    return MPI.COMM_WORLD


def run_here(patch, script):
    """Run a study in this process: status, standard output and standard error. What a process's
    end would undo is undone; an exception that a study does not expect is raised."""
    from matplotlib.figure import Figure

    from fabric_fenicsx.cli import study
    from fabric_fenicsx.core import timing
    from fabric_fenicsx.press.forming_scene import FormingScene

    made, log = [], logging.getLogger("fabric_fenicsx")

    class Noted(study.Output):  # of studies of any kind
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            made.append(self)

    def unexpected():
        raise

    draw = Figure.savefig

    def savefig(figure, path, **options):
        figure.set_layout_engine("none")  # which takes half of a picture's time
        draw(figure, path, **options | {"bbox_inches": None})

    patch.setattr(Figure, "savefig", savefig)
    if "--dry-run" not in sys.argv:  # which is looked at there
        patch.setattr(FormingScene, "begin", lambda *_: None)
    patch.setattr(study, "Output", Noted)
    patch.setattr(study, "traceback", SimpleNamespace(print_exc=unexpected))
    for name in ("level", "propagate"):
        patch.setattr(log, name, getattr(log, name))
    patch.setattr(log, "handlers", [])
    signals = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    timing.seconds.clear()
    out, err, status = io.StringIO(), io.StringIO(), 0
    try:
        with redirect_stdout(out), redirect_stderr(err):
            runpy.run_path(str(script), run_name="__main__")
    except SystemExit as end:
        status = end.code or 0
    finally:
        for each in made:
            each.close()
        for each, handler in signals.items():
            signal.signal(each, handler)
        if world().size == 1:  # PETSc's objects are in circles; ranks would free them out of order
            made.clear()
            gc.collect()
    return status, out.getvalue(), err.getvalue()


@pytest.fixture(autouse=True)
def messages_as_before():
    """A study keeps messages from handlers of other programs, pytest's among them."""
    log = logging.getLogger("fabric_fenicsx")
    before = log.level, log.propagate, log.handlers[:]
    yield
    log.propagate, log.handlers[:] = before[1:]
    log.setLevel(before[0])


@pytest.fixture(scope="session")
def hang():
    """Time limit [s] for whatever a test starts, for hangs alone."""
    return HANG


@pytest.fixture(scope="session")
def by_position():
    """Function that gathers rows of owned nodes or cells on all ranks, in the order of their
    places: by_position(comm, places, *rows). Ranks share meshes of the same sheet differently."""

    def gather(comm, *parts):
        parts = [np.concatenate(comm.allgather(np.asarray(part))) for part in parts]
        order = np.lexsort((parts[0].round(6) + 0.0).T)
        return [part[order] for part in parts]

    return gather


@pytest.fixture(scope="session")
def unbalanced():
    """A fabric whose directions differ in every parameter."""
    from fabric_fenicsx.material.laws.coupled import WovenFabric, Yarn

    warp = Yarn(a=4130.0, b=667.5, d=0.65, p_min=0.75, c=23.67, s_T=1467.6, s_C=100.0)
    weft = Yarn(a=2100.0, b=410.0, d=1.9, p_min=0.6, c=17.0, s_T=900.0, s_C=140.0)
    shear = {"s1": 0.02506, "s2": -0.18679, "s3": 0.56239}
    return WovenFabric(warp, weft, **shear, thickness=0.8, name="unbalanced")


@pytest.fixture(scope="session")
def random_states():
    """Function of n: C (n, 2, 2) and unit fibres a0, b0 (n, 2) over all four quadrants of strain,
    gamma to +-80 deg, initial angles from 50 to 130 deg."""

    def make(n, seed=1):
        rng = np.random.default_rng(seed)
        angle = rng.uniform(np.radians(50), np.radians(130), n)
        gamma = rng.uniform(-np.radians(80), np.radians(80), n)
        # at least 10 deg, so that gamma of 80 deg is reached from 90 deg on either side
        now = np.clip(angle - gamma, np.radians(10), np.radians(170))
        la, lb = 1 + rng.uniform(-0.2, 0.06, (2, n))
        turn = rng.uniform(0, 2 * np.pi, n)
        a0 = np.stack([np.cos(turn), np.sin(turn)], -1)
        b0 = np.stack([np.cos(turn + angle), np.sin(turn + angle)], -1)
        G = np.linalg.inv(np.stack([a0, b0], -1))
        I6 = la * lb * np.cos(now)
        metric = np.stack([la**2, I6, I6, lb**2], -1).reshape(-1, 2, 2)
        C = np.einsum("nki,nkl,nlj->nij", G, metric, G)
        return (C + C.swapaxes(1, 2)) / 2, a0, b0

    return make


@pytest.fixture
def shared_path(tmp_path):
    """`tmp_path`, one for all ranks of a test."""
    return world().bcast(tmp_path)


@pytest.fixture
def folder(shared_path):
    """A folder for a run, one for all ranks of a test."""
    return shared_path / "run"


@pytest.fixture(scope="session")
def run_script():
    """Function that runs a study in this process and a folder: run_script(folder, script, *words)
    to its status, standard output and standard error. It saves the start of another process."""

    def run(folder, *words):
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            patch.setattr(sys, "argv", [str(word) for word in words])
            return run_here(patch, words[0])

    return run


@pytest.fixture
def launch(shared_path, run_script):
    """Function that runs a study as a user would: launch(name, *options, ranks=1) to its status,
    output without `progress`, that, results. By default it runs in this process, on the ranks of
    the test, which saves the start of another, and overwrites what an earlier one left."""

    def run(name, *options, ranks=1, out=True, overwrite=True):
        script, folder = ROOT / "studies" / f"{name}.py", shared_path / "out"
        script = script if script.exists() else ROOT / "benchmarks" / script.name
        words = [str(script), *map(str, options)]
        if out:
            words += ["--out", str(folder)]
            words += ["--overwrite"] if overwrite and "--resume" not in options else []
        if ranks > 1:
            how = {"capture_output": True, "text": True, "env": os.environ | RANKS_ENVIRONMENT}
            command = [*on_ranks(ranks), sys.executable, *words]
            done = subprocess.run(command, cwd=shared_path, timeout=HANG, **how)
            status, out_text, err_text = done.returncode, done.stdout, done.stderr
        else:
            status, *texts = run_script(shared_path, *words)
            # and all have written
            out_text, err_text = map("".join, zip(*world().allgather(texts)))
        summary, lines = folder / "summary.json", out_text.splitlines(keepends=True)
        progress = [line for line in lines if PROGRESS.search(line)]
        return SimpleNamespace(
            status=status,
            out="".join(line for line in lines if line not in progress),
            progress=progress,
            err=err_text,
            folder=folder,
            summary=json.loads(summary.read_text()) if summary.is_file() else None,
        )

    return run
