"""`python -m fabric_fenicsx info` tells what is installed and what does not work."""

import os
import re
import subprocess
import sys
from functools import partial

import pytest
from mpi4py import MPI

from fabric_fenicsx import __version__
from fabric_fenicsx.command_line import info
from fabric_fenicsx.runtime.ranks import RANKS_ENVIRONMENT, on_ranks


def checks(text):
    """{check: "ok" or "fails"} and {check: what is said}."""
    found = re.findall(r"^(\S+) +(ok|fails) [\d.]+ s *(.*)$", text, re.M)
    return {name: result for name, result, _ in found}, {name: words for name, _, words in found}


@pytest.mark.versions
def test_it_tells_versions_and_a_compiler_that_is_missing_once_for_all_ranks(hang):
    command = [*on_ranks(2), sys.executable, "-m", "fabric_fenicsx", "info"]
    environment = os.environ | RANKS_ENVIRONMENT | {"CC": "/nowhere/cc"}
    how = {"capture_output": True, "text": True, "env": environment, "timeout": hang}
    done = subprocess.run(command, **how)
    assert done.returncode == 1 and "Traceback" not in done.stdout + done.stderr
    results, words = checks(done.stdout)
    assert results == dict.fromkeys(info.CHECKS, "ok") | {"JIT": "fails"}
    assert "/nowhere/cc" in words["JIT"] and "blas" in words["BLAS"].lower()
    assert done.stdout.count("MUMPS") == 1 and words["MPI"].startswith("2 rank")
    assert re.search(rf"^fabric_fenicsx +{re.escape(__version__)}$", done.stdout, re.M)
    for name in [*info.VERSIONS][2:]:
        version = rf"^{name} +(Open MPI v|MPICH Version: +)?\d+\.\d+"
        assert re.search(version, done.stdout, re.M), name


@pytest.mark.versions
def test_all_works(capsys):
    assert info.show(MPI.COMM_SELF) == 0
    out = capsys.readouterr().out
    assert checks(out)[0] == dict.fromkeys(info.CHECKS, "ok")
    assert "area of a unit square 1" in out and re.search(r"(1[6-9]|[2-9]\d) cells in a sq", out)


def test_drawing_that_fails_is_told_and_takes_nothing_down(monkeypatch):
    monkeypatch.setattr(info, "draw_triangle", partial(exec, "import os; os.abort()"))
    with pytest.raises(RuntimeError, match="SIGABRT"):
        info.CHECKS["pyvista"]()
