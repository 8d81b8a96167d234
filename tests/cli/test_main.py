"""The command `fabric`: studies from any folder, example data, and what works."""

import re
import shlex
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.cli import info, main, prepare
from fabric_fenicsx.cli.options import STUDIES
from fabric_fenicsx.cli.study import parser

ROOT = Path(__file__).parents[2]


@pytest.fixture
def fabric(tmp_path, hang):
    def run(*words):
        command = [sys.executable, "-m", "fabric_fenicsx", *words]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=hang)

    return run


@pytest.mark.versions
def test_a_study_runs_and_its_command_repeats_it(fabric, tmp_path):
    done = fabric("single_element", "--points", "3", "--no-pictures")
    assert done.returncode == 0, done.stderr
    summary = (tmp_path / "results/single_element/summary.json").read_text()
    (command,) = [line for line in summary.splitlines() if '"command"' in line]
    words = shlex.split(command.split('"')[3])
    assert words[1:4] == ["-m", "fabric_fenicsx", "single_element"]
    assert words[4:] == ["--points", "3", "--no-pictures"]
    again = fabric(*words[3:])
    assert again.returncode == 2
    assert again.stderr.startswith("fabric single_element: error: --out")


def test_example_data_are_found_from_any_folder(fabric):
    done = fabric("identify", "--data", "studies/data/komeili_paper", "--no-pictures")
    assert done.returncode == 0, done.stderr


@pytest.mark.versions
def test_studies_and_data_are_listed_on_a_terminal_of_few_letters(fabric, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    done = fabric("list")
    assert done.returncode == 0 and "Sch\\xe4fer" in done.stdout and not done.stderr
    words = done.stdout.split()
    assert {path.stem for path in (ROOT / "studies").glob("*.py")} <= set(words)
    data = [word for word in words if word.startswith("studies/") and word != "studies/reference,"]
    assert len(data) > 3 and all((STUDIES.parent / word).exists() for word in data)


def test_usual_runs_are_prepared(caplog, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(prepare, "PRESSES", ("hemisphere",))
    assert main.main(["prepare"]) == 0
    assert not caplog.records and not list(tmp_path.iterdir())


@pytest.mark.versions
def test_all_works(capsys):
    assert info.show(MPI.COMM_SELF) == 0
    out = capsys.readouterr().out
    assert re.findall(r"^(\S+) +ok [\d.]+ s", out, re.M) == [*info.CHECKS]
    assert "area of a unit square 1" in out and re.search(r"(1[6-9]|[2-9]\d) cells in a sq", out)


def test_drawing_that_fails_is_told_and_takes_nothing_down(monkeypatch):
    monkeypatch.setattr(info, "draw_triangle", partial(exec, "import os; os.abort()"))
    with pytest.raises(RuntimeError, match="SIGABRT"):
        info.CHECKS["pyvista"]()


@pytest.mark.versions
def test_parameters_become_options():
    told = parser(ff.Tensile, "").translated("`max_step` or 5 % (`Limits.strain`); `resume=True`")
    assert told == "--max-step or 5 % (--max-strain); --resume"
