"""`python -m fabric_fenicsx info` tells what is installed and what does not work."""

import re
from functools import partial

import pytest
from mpi4py import MPI

from fabric_fenicsx.cli import info


def checks(text):
    """{check: "ok" or "fails"} and {check: what is said}."""
    found = re.findall(r"^(\S+) +(ok|fails) [\d.]+ s *(.*)$", text, re.M)
    return {name: result for name, result, _ in found}, {name: words for name, _, words in found}


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
