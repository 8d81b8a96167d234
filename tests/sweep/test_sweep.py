"""Sweeps over a press file, with a stand-in for the runs."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fabric_fenicsx.cli import sweep
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.core.files import lock_folder
from fabric_fenicsx.sweep import folder
from fabric_fenicsx.sweep.runner import SweepRun

FAKE = Path(__file__).with_name("fake_form.py")
PRESS = '[tools.punch]\nfile = "punch.stl"\nfriction = 0.2\n[ring]\npressure = 0.1\n'


class Fake(SweepRun):
    def command(self, values, folder):
        settings = [word for pair in values.items() for word in ("--set", "=".join(pair))]
        return [sys.executable, str(FAKE), *settings, "--out", str(folder), *self.options]

    def read(self, values):
        if values.get("ring.pressure") == "0":
            raise InputError("ring.pressure is 0; expected another number")

    def scatter(self):
        return [folder.Range("fabric.factor", 0.5, 1.5)]


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a sweep with these words: status, output, errors; `out` is its folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "press.toml").write_text(PRESS)
    (tmp_path / "punch.stl").write_text("a punch")

    def run(*words):
        own = [] if "--pictures" in words else ["--no-pictures"]
        words = [word for word in words if word != "--pictures"]
        status = sweep.main(["press.toml", "--out", "out", *own, *words], Fake)
        return status, *capsys.readouterr()

    return run


def pressures(texts):
    return "--vary", f"ring.pressure={texts}"


def table():
    with open("out/table.csv", newline="") as file:
        return list(csv.DictReader(file))


def starts():
    return {path.parent.name: path.read_text().split() for path in Path("out").glob("*/starts.txt")}


def test_all_combinations_are_run_and_in_the_table(run):
    status, *_ = run(*pressures("0.1,0.3"), "--vary", "tools.punch.friction=0.1,0.3")
    rows = table()
    assert status == 0
    assert [(row["ring.pressure"], row["tools.punch.friction"]) for row in rows] == [
        ("0.1", "0.1"), ("0.1", "0.3"), ("0.3", "0.1"), ("0.3", "0.3")
    ]  # fmt: skip
    assert rows[3]["run"] == "pressure=0.3_friction=0.3" and rows[3]["converged"] == "True"
    assert float(rows[3]["shortening_mean"]) == pytest.approx(0.02 * 0.3**-0.5 + 0.027 - 0.04)
    assert float(rows[3]["reaction_N"]) == 300 and "wrinkles.at_mm" not in rows[3]
    status, out, _ = run(*pressures("0.30,0.5"), "--vary", "tools.punch.friction=0.3")
    assert status == 0 and "2 runs, 1 done before" in out and len(table()) == 5
    assert set(map(tuple, starts().values())) == {("begin",)}


def test_a_dry_run_tells_costs_and_leaves_nothing_that_counts_as_done(run):
    status, out, _ = run(*pressures("0.1,0.3"), "--", "--dry-run")
    assert status == 0 and out.count(": the run takes 1 to 2 s\n") == 2 and not starts()
    status, out, _ = run(*pressures("0.1,0.3"))
    assert status == 0 and "0 done before" in out and len(starts()) == 2


def test_a_run_that_gave_up_stays_with_its_reason_until_options_change(run):
    status, out, err = run(*pressures("0.1,2"))
    assert status == 3 and "1 of 2 runs are not valid" in err
    assert "pressure=2: gave up at load 0.5: no step is small enough" in out
    assert table()[1]["reason"] == "no step is small enough"
    run(*pressures("0.1,2"))
    assert starts()["pressure=2"] == ["begin"]
    _, _, err = run(*pressures("0.1,2"), "--", "--slow", "0.01")
    assert starts() == {"pressure=2": ["begin", "resume"], "pressure=0.1": ["begin"]}
    assert "warning: some were made with other options: none" in err


def test_bad_input_of_a_run_ends_the_sweep_with_its_sentence(run):
    status, _, err = run(*pressures("0.1,-1"), "--", "--slow", "600")
    words = "error: run pressure=-1: ring.pressure is -1; expected a number from 0\n"
    assert status == 2 and err.endswith(words)


BAD_WORDS = """
--vary ring.pressure=1,0 | ring.pressure is 0; expected another number
--scatter 8 --vary a=1..2 --vary b=1..2 --vary c=1..2 | expected 16 or more for 4 numbers
--vary a=1 -- --out x | option --out is after --; expected options
--vary a=1,2 --only 3 | --only is 3; expected 1 to 2
--vary a=1 --slurm press.toml | --slurm press.toml exists already
"""


@pytest.mark.parametrize("line", BAD_WORDS.strip().splitlines())
def test_bad_words_are_told_before_anything_is_run(run, line):
    words, message = line.split(" | ")
    status, _, err = run(*words.split())
    assert status == 2 and message in err and Path("press.toml").read_text() == PRESS
    assert not Path("out").exists() or "slurm" in words


def test_a_folder_of_another_sweep_or_press_is_refused_or_lost(run):
    run(*pressures("0.1"))
    _, _, err = run(*pressures("0.1"), "--vary", "tools.punch.friction=0.2")
    assert "has a sweep over ring.pressure, now it is ring.pressure, tools.punch.friction" in err
    with lock_folder(Path("out")):
        assert "out is in use by another sweep" in run(*pressures("0.1"))[2]
    Path("out/pressure=0.1/notes.txt").write_text("mine")
    for file in ("punch.stl", "press.toml"):
        Path(file).write_text(Path(file).read_text() + "\n")
        status, _, err = run(*pressures("0.2"))
        assert status == 2 and f"another press ({file} has changed since); expected" in err
        assert run(*pressures("0.2"), "--overwrite")[0] == 0
        assert [row["run"] for row in table()] == [*starts()] == ["pressure=0.2"]
    assert Path("out/pressure=0.1/notes.txt").read_text() == "mine"
    Path("out/sweep.json").rename("out/other.json")
    assert "out holds files that no sweep wrote" in run(*pressures("0.2"), "--overwrite")[2]


SCRIPT = "import sys; from test_sweep import Fake, sweep; sys.exit(sweep.main(sys.argv[1:], Fake))"


def test_a_signal_ends_all_runs_which_then_go_on(run):
    words = ["press.toml", "--out", "out", *pressures("0.1,0.2,0.3"), "--jobs", "2"]
    words += ["--no-pictures", "--", "--slow", "60"]
    path = f"{FAKE.parents[2]}:{FAKE.parent}"
    command, env = [sys.executable, "-c", SCRIPT, *words], os.environ | {"PYTHONPATH": path}
    process = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True)
    while len(starts()) < 2:
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 3
    assert "fabric sweep: stopped by SIGTERM; the same command continues" in err
    assert run(*pressures("0.1,0.2,0.3"))[0] == 0
    twice = ["begin", "resume"]
    assert starts() == {"pressure=0.1": twice, "pressure=0.2": twice, "pressure=0.3": ["begin"]}


def test_a_killed_run_is_told_and_others_go_on(run):
    """The stand-in kills itself at 0.25, unless it resumes."""
    status, out, _ = run(*pressures("0.1,0.25,0.3"))
    assert status == 3 and "pressure=0.25: gave up at load 0: ended by SIGKILL (as the sys" in out
    assert [row["converged"] for row in table()] == ["True", "False", "True"]
    assert run(*pressures("0.1,0.25,0.3"))[0] == 0


def test_a_limit_is_looked_for_between_runs(run):
    """By the formula 0.02 p^-0.5 + 0.2 p^2 - 0.04 of the stand-in, linear between runs, by hand. A
    name that the first run does not have ends the sweep, which then goes on."""
    vary, below = pressures("0.05,0.1,0.15"), "shortening_mean=0.02"
    status, _, err = run(*vary, "--jobs", "1", "--below", "wrinkle.count=2")
    assert status == 2 and "(did you mean wrinkles.count?); expected " in err
    assert [*starts()] == ["pressure=0.05"]
    _, out, _ = run(*vary, "--below", below)
    assert "from pressure = 0.1288 on" in out and "1 done before" in out
    assert "--below is given for a=x; expected" in run("--vary", "a=x", "--below", below)[2]


def test_scatter_tells_of_runs_that_are_believed(run):
    """The force is 1000 x pressure x factor, which is from 0.5 to 1.5."""
    words = *pressures("0.3..1.1"), "--below", "reaction_N=10"
    assert run("--scatter", "8", *words)[0] == 3
    found = json.loads(Path("out/sweep.json").read_text())["scatter"]["reaction_N"]
    rows = [row for row in table() if row["converged"] == "True"]
    forces = [1000 * float(row["ring.pressure"]) * float(row["fabric.factor"]) for row in rows]
    assert found["runs"] == len(rows) and found["mean"] == pytest.approx(sum(forces) / len(rows))


def test_a_job_array_does_the_runs_and_the_same_command_their_table(run):
    """A run that gave up in the array is not tried again, nor is any other."""
    vary, passed = pressures("0.1,0.4,2"), ("--", "--slow", "0.01")
    status, *_ = run(*vary, "--slurm", "array.sh", "--ranks", "4", *passed)
    script = Path("array.sh").read_text()
    subprocess.run(["bash", "-n", "array.sh"], check=True)
    assert status == 0 and not starts() and "#SBATCH --array=1-3\n" in script
    assert "#SBATCH --ntasks=4\n" in script
    assert '--ranks 4 --only "$SLURM_ARRAY_TASK_ID" -- --slow 0.01\n' in script
    told = [run(*vary, "--only", str(k), *passed)[0] for k in (3, 1, 2)]
    assert told == [3, 0, 0] and not Path("out/table.csv").exists()
    status, out, _ = run(*vary, *passed)
    assert status == 3 and "3 runs, 3 done before" in out
    assert starts() == {f"pressure={p}": ["begin"] for p in ("0.1", "0.4", "2")}


def test_pictures_and_a_page_with_doubts_and_links(run):
    words = "--pictures", *pressures("0.01,0.1,0.4,2"), "--below", "wrinkles.count=1"
    assert "left out (doubtful, see the table): pressure = 0.4" in run(*words)[1]
    page = Path("out/report.html").read_text()
    assert Path("out/curves.png").exists() and Path("out/trends.png").exists()
    assert page.count("data:image/png") == 2 and not Path("out/maps.png").exists()
    assert "4 runs, 3 of them valid" in page and "<th>punch force [N]</th>" in page
    assert "ended at load 0.5: no step is small enough" in page
    assert page.count("<li>wrinkles are inaccurate</li>") == 1


def test_folders_have_readable_names_that_file_systems_take():
    assert folder.folder_name({"holder.pressure": "0.05"}) == "pressure=0.05"
    both = folder.folder_name({"tools.punch.friction": "0.1", "tools.die.friction": "0.2"})
    assert both == "punch.friction=0.1_die.friction=0.2"
    files = [folder.folder_name({"tools.punch.file": f"'{f}'"}) for f in ("a/b.stl", "a b.stl")]
    assert files[0] != files[1] and not any(set("/' ") & set(name) for name in files)


def test_values_may_be_texts_lists_and_tables():
    found = folder.lists(["a.b=komeili,[1, 2],{punch = 40, die = 1},'x,y',5e-2"])
    assert found == {"a.b": ["komeili", "[1, 2]", "{punch = 40, die = 1}", "'x,y'", "0.05"]}
