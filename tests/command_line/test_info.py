"""`python -m fabric_fenicsx info` tells what is installed and what does not work."""

import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest
from mpi4py import MPI

from fabric_fenicsx import __version__
from fabric_fenicsx.command_line import info, main
from fabric_fenicsx.material.presets import PRESETS
from fabric_fenicsx.runtime.ranks import RANKS_ENVIRONMENT, on_ranks

SERIAL = MPI.COMM_SELF
# as the command, but for the picture, of which most of the time is
PICTURELESS = """
import sys
from fabric_fenicsx.command_line import info, main
info.DRAWING = ""
sys.exit(main.main())
"""


@pytest.fixture
def run(hang):
    def run(*arguments, ranks=1, draws=False, **environment):
        start = ("-m", "fabric_fenicsx") if draws else ("-c", PICTURELESS)
        command = [sys.executable, *start, *arguments]
        if ranks > 1:
            command = [*on_ranks(ranks), *command]
        environment = os.environ | RANKS_ENVIRONMENT | environment
        return subprocess.run(
            command, capture_output=True, text=True, env=environment, timeout=hang
        )

    return run


def results(text):
    """{check: "ok" or "fails"} and {check: what is said}."""
    found = re.findall(r"^(\S+) +(ok|fails) +[\d.]+ s *(.*)$", text, re.M)
    return {name: result for name, result, _ in found}, {name: words for name, _, words in found}


@pytest.mark.versions
def test_it_tells_versions_presets_and_that_all_works(run):
    done = run("info", draws=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert results(done.stdout)[0] == dict.fromkeys(info.CHECKS, "ok")
    assert "blas" in results(done.stdout)[1]["BLAS"].lower()
    assert re.search(rf"^fabric_fenicsx +{re.escape(__version__)}$", done.stdout, re.M)
    for name in info.VERSIONS:
        assert re.search(rf"^{name} +(Open MPI v|MPICH Version: +)?\d+\.\d+", done.stdout, re.M), (
            name
        )
    assert re.search(rf"^presets +{', '.join(PRESETS)}$", done.stdout, re.M)


@pytest.mark.versions
def test_on_two_ranks_one_speaks(run):
    done = run("info", ranks=2)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("MUMPS") == 1 and "2 ranks" in results(done.stdout)[1]["MPI"]


def test_a_compiler_that_is_missing_is_told(run):
    done = run("info", CC="/nowhere/cc")
    assert done.returncode == 1 and "Traceback" not in done.stdout + done.stderr
    assert results(done.stdout)[0] == dict.fromkeys(info.CHECKS, "ok") | {"JIT": "fails"}
    assert "/nowhere/cc" in results(done.stdout)[1]["JIT"]


@pytest.mark.versions
def test_packages_that_are_missing_are_told(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "gmsh", None)
    monkeypatch.setattr(info, "DRAWING", "")
    assert info.show(SERIAL) == 1
    out = capsys.readouterr().out
    assert re.search(r"^gmsh +missing \(.*gmsh", out, re.M)
    checks, words = results(out)
    assert checks == dict.fromkeys(info.CHECKS, "ok") | {"gmsh": "fails"}
    assert "gmsh" in words["gmsh"]


@pytest.mark.parametrize(
    "draws, words",
    [
        ("import os; os.kill(os.getpid(), 11)", "SIGSEGV"),
        ("raise SystemExit(7)", "it crashed .7."),
        (
            "from fabric_fenicsx.runtime.errors import InputError; raise InputError('no screen')",
            "no screen",
        ),
        ("import time; time.sleep(3600)", "within 1 s"),
    ],
)
def test_drawing_that_fails_is_told_and_takes_nothing_down(monkeypatch, draws, words, hang):
    monkeypatch.setattr(info, "PATIENCE", 1 if "sleep" in draws else hang)
    monkeypatch.setattr(info, "DRAWING", draws)
    with pytest.raises(RuntimeError, match=words):
        info.CHECKS["pyvista"][0](SERIAL)


@pytest.mark.versions
def test_a_blank_picture_is_told(monkeypatch):
    monkeypatch.setattr("pyvista.Plotter.add_mesh", lambda *_, **__: None)
    with pytest.raises(RuntimeError, match="blank"):
        info.draw_triangle()


@pytest.mark.parametrize(
    "file, words",
    [
        ("/usr/lib/x86_64-linux-gnu/openblas-serial/libblas.so.3", "OpenBLAS"),
        ("/usr/lib/x86_64-linux-gnu/blas/libblas.so.3.11.0", "libopenblas0-serial"),
        ("/opt/mkl/libmkl_blas.so.2", "libmkl_blas"),
    ],
)
def test_the_blas_is_named(file, words):
    assert words in info.describe_blas([file])


@pytest.mark.parametrize("arguments", [("inform",), ("info", "--fast"), ("info", "more")])
def test_bad_arguments_end_with_2_and_one_sentence(arguments, capsys):
    assert main.main(list(arguments)) == 2
    out, err = capsys.readouterr()
    assert not out
    assert err.count("\n") == 1
    assert err.startswith("fabric: error: ")


def test_without_mpi_the_rest_is_told(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mpi4py", None)
    monkeypatch.setattr(info, "DRAWING", "")
    assert info.world() is None and info.show(None) == 1
    assert results(capsys.readouterr().out)[0]["MPI"] == "fails"


def test_a_rank_on_which_something_fails_fails_all(monkeypatch):
    def broken(comm):
        raise RuntimeError("on this rank")

    monkeypatch.setattr(info, "CHECKS", {"MPI": (broken, True)})
    everywhere = SimpleNamespace(rank=1, size=2, allgather=lambda well: [True, well])
    assert info.show(everywhere) == 1


def test_the_world_is_that_of_mpi():
    assert info.world() is MPI.COMM_WORLD
