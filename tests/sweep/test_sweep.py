"""Sweeps over a press file, with a stand-in for the runs."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fabric_fenicsx.command_line import sweep
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.runtime.files import lock_folder
from fabric_fenicsx.sweep import runner, varied
from fabric_fenicsx.sweep.folder import Run
from fabric_fenicsx.sweep.form import Form
from fabric_fenicsx.sweep.runner import Runner

FAKE = Path(__file__).with_name("fake_form.py")
PRESS = """
[tools.punch]
file = "punch.stl"
friction = 0.2
[holders.ring]
pressure = 0.05
[ring]
pressure = 0.1
"""


class Fake(Form):
    def command(self, values, folder):
        settings = [word for each in varied.changes(values) for word in ("--set", each)]
        return [sys.executable, str(FAKE), *settings, "--out", str(folder), *self.options]

    def check(self, values):
        if any(each.get("ring.pressure") == "0" for each in values):
            raise InputError("ring.pressure is 0; allowed is another number")

    def quantities(self, values):
        own = "shortening_mean", "shear_angle_max_deg", "wrinkles.count", "wrinkles.wavelength_mm"
        return ["reaction_N", "stroke_reached", *own]

    def finer(self, values):
        return {"blank.nx": "36"}

    def scatter(self):
        return [varied.Range("fabric.factor", 0.5, 1.5)]


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a sweep with these words: status, output, errors; `out` is its folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "press.toml").write_text(PRESS)
    (tmp_path / "punch.stl").write_text("a punch")

    def run(*words):
        own = [] if "--pictures" in words else ["--no-pictures"]
        own += [] if "--finer" in words else ["--no-finer"]
        words = [word for word in words if word not in ("--pictures", "--finer")]
        status = sweep.main(["press.toml", "--out", "out", *own, *words], Fake)
        return status, *capsys.readouterr()

    return run


def table():
    with open("out/table.csv", newline="") as file:
        return list(csv.DictReader(file))


def starts():
    return {path.parent.name: path.read_text().split() for path in Path("out").glob("*/starts.txt")}


def test_all_combinations_are_run_and_in_the_table(run):
    status, *_ = run("--vary", "ring.pressure=0.1,0.4", "--vary", "tools.punch.friction=0.1,0.3")
    rows = table()
    assert status == 0
    assert [(row["ring.pressure"], row["tools.punch.friction"]) for row in rows] == [
        ("0.1", "0.1"), ("0.1", "0.3"), ("0.4", "0.1"), ("0.4", "0.3")
    ]  # fmt: skip
    assert rows[3]["run"] == "pressure=0.4_friction=0.3" and rows[3]["converged"] == "True"
    assert float(rows[3]["shortening_mean"]) == pytest.approx(0.02 * 0.4**-0.5 + 0.048 - 0.04)
    assert float(rows[3]["reaction_N"]) == 400 and "wrinkles.at_mm" not in rows[3]
    more = "--vary", "ring.pressure=0.40,0.5", "--vary", "tools.punch.friction=0.3"
    status, out, _ = run(*more)
    assert status == 0 and "2 runs, 1 done before" in out and len(table()) == 5
    assert set(map(tuple, starts().values())) == {("begin",)}


def test_a_run_that_gave_up_stays_with_its_reason_until_options_change(run):
    status, out, err = run("--vary", "ring.pressure=0.1,2")
    assert status == 3 and "1 of 2 runs are not believed" in err
    assert "pressure=2: gave up at load 0.5: no step is small enough" in out
    assert table()[1]["reason"] == "no step is small enough"
    run("--vary", "ring.pressure=0.1,2")
    assert starts()["pressure=2"] == ["begin"]
    _, _, err = run("--vary", "ring.pressure=0.1,2", "--", "--slow", "0.01")
    assert starts() == {"pressure=2": ["begin", "resume"], "pressure=0.1": ["begin"]}
    assert "warning: some were made with other options: none" in err


def test_bad_input_of_a_run_ends_the_sweep_with_its_sentence(run):
    began = time.monotonic()
    status, out, err = run("--vary", "ring.pressure=0.1,-1", "--", "--slow", "600")
    assert status == 2 and time.monotonic() - began < 500
    assert err.endswith(
        "fabric sweep: error: run pressure=-1: ring.pressure is -1; allowed is a number from 0\n"
    )


BAD_WORDS = """
--vary ring | --vary ring is no key with values; allowed is KEY=VALUE,VALUE...
--vary ring.pressure=1, | has an empty value
--vary ring.pressure=1..2 | is a range; allowed is one with --scatter
--vary ring.pressure=1,0 | ring.pressure is 0; allowed is another number
--vary a=1 --below x | --below x is no quantity with a number
--vary a=b --below x=1 | a is b; allowed are numbers
--vary a=1 --vary b=1 --below x=1 | --below needs one --vary, and 2 are given
--vary ring.pressure=1 --below wrinkle.count=2 | none of press.toml (did you mean wrinkles.count?)
--scatter 8 --vary a=1..2 --vary b=1..2 --vary c=1..2 | allowed for 4 numbers is 16 or more
--scatter 8 --vary a=2..1 | --vary a=2..1 is no range; allowed with --scatter is KEY=LOW..HIGH
--vary a=1 -- --out x | option --out is behind --; allowed are options
--vary a=1 --only 2 --overwrite | --only and --overwrite are both given
--vary a=1,2 --only 3 | --only is 3; allowed is 1 to 2
"""


@pytest.mark.parametrize("line", BAD_WORDS.strip().splitlines())
def test_bad_words_are_told_before_anything_is_written(run, line):
    words, message = line.split(" | ")
    status, _, err = run(*words.split())
    assert status == 2 and message in err
    assert not Path("out").exists()


@pytest.mark.parametrize("file", ["press.toml", "punch.stl"])
def test_a_folder_of_another_press_is_refused_or_lost(run, file):
    run("--vary", "ring.pressure=0.1")
    with open(file, "a") as more:
        more.write("\n")
    status, _, err = run("--vary", "ring.pressure=0.2")
    assert status == 2 and f"another press ({file} has changed since); allowed is" in err
    assert run("--vary", "ring.pressure=0.2", "--overwrite")[0] == 0
    assert [row["run"] for row in table()] == [*starts()] == ["pressure=0.2"]


def test_a_folder_of_other_keys_or_of_no_sweep_is_refused(run):
    run("--vary", "ring.pressure=0.1")
    _, _, err = run("--vary", "ring.pressure=0.1", "--vary", "tools.punch.friction=0.2")
    assert "has a sweep over ring.pressure, now it is ring.pressure, tools.punch.friction" in err
    Path("out/sweep.json").rename("out/other.json")
    status, _, err = run("--vary", "ring.pressure=0.1", "--overwrite")
    assert status == 2 and "out holds files that no sweep wrote" in err


SCRIPT = "import sys; from test_sweep import Fake, sweep; sys.exit(sweep.main(sys.argv[1:], Fake))"


def test_a_signal_ends_all_runs_which_then_go_on(run):
    varied = ["--vary", "ring.pressure=0.1,0.2,0.3", "--jobs", "2"]
    words = ["press.toml", "--out", "out", *varied, "--no-pictures", "--", "--slow", "60"]
    path = f"{FAKE.parents[2]}:{FAKE.parent}"
    command, env = [sys.executable, "-c", SCRIPT, *words], os.environ | {"PYTHONPATH": path}
    process = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True)
    while len(starts()) < 2:
        time.sleep(0.02)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 3
    assert "fabric sweep: stopped by SIGTERM; the same command goes on" in err
    assert run(*varied)[0] == 0
    twice = ["begin", "resume"]
    assert starts() == {"pressure=0.1": twice, "pressure=0.2": twice, "pressure=0.3": ["begin"]}


def test_two_sweeps_in_one_folder_are_refused(run):
    run("--vary", "ring.pressure=0.1")
    with lock_folder(Path("out")):
        status, _, err = run("--vary", "ring.pressure=0.1")
    assert status == 2 and "out is in use by another sweep" in err


def test_a_killed_run_is_told_and_others_go_on(run, monkeypatch):
    text = FAKE.read_text().replace("pressure > 1 else 1.0", "pressure > 1 else 1.0\nimport os")
    text = text.replace("import os", "import os\nif pressure == 0.2: os.kill(os.getpid(), 9)")
    Path("killed.py").write_text(text)
    with monkeypatch.context() as patch:
        patch.setattr(sys.modules[__name__], "FAKE", Path("killed.py"))
        status, out, _ = run("--vary", "ring.pressure=0.1,0.2,0.3")
    assert status == 3 and "pressure=0.2: gave up at load 0: ended by SIGKILL (as the sys" in out
    assert [row["converged"] for row in table()] == ["True", "False", "True"]
    assert run("--vary", "ring.pressure=0.1,0.2,0.3")[0] == 0  # it is begun once more


def test_a_run_without_a_value_neither_meets_nor_breaks_a_limit(run):
    """The stand-in has no wavelength from 0.2 on, as where nothing wrinkles."""
    vary = "--vary", "ring.pressure=0.1,0.15,0.3"
    status, out, _ = run(*vary, "--below", "wrinkles.wavelength_mm=15")
    assert status == 0 and "left out, as without a value: pressure = 0.3; all on these" in out
    (found,) = re.findall(r"wavelength_mm below 15: from pressure = ([\d.]+) on", out)
    assert float(found) == pytest.approx(0.125)
    assert [row["wrinkles.wavelength_mm"] for row in table()][2] == "nan"
    assert "<td>no value</td>" in Path("out/report.html").read_text()


def test_where_a_quantity_is_below_a_limit_is_told(run):
    told = {
        "shear_angle_max_deg=40.15": "up to pressure = 0.1414 (between runs, interpolated)",
        "shear_angle_max_deg=42": "in all runs, from pressure = 0.1 on",
        "shear_angle_max_deg=3": "in no run; the least is 40.1 at pressure = 0.1",
        "shortening_mean=0.02": "it neither falls nor rises throughout",
    }
    below = [word for limit in told for word in ("--below", limit)]
    _, out, _ = run("--vary", "ring.pressure=0.1,0.2,0.3,1,2", *below)
    for limit, words in told.items():
        (line,) = (each for each in out.splitlines() if limit.replace("=", " below ") in each)
        assert words in line and "left out, as not believed: pressure = 2" in line


def shortening(pressure, friction=0.2):
    return 0.02 * pressure**-0.5 + friction * pressure**2 - 0.04


def test_where_a_quantity_is_below_a_limit_is_found_again_on_finer_cells(run):
    """The stand-in has half the shortening there: the limit is crossed two runs further."""
    values = [0.025, 0.05, 0.1, 0.15, 0.2]
    vary = "--vary", f"ring.pressure={','.join(map(str, values))}"
    _, out, _ = run(*vary, "--below", "shortening_mean=0.02", "--finer")
    coarse, fine = (
        a + (b - a) * (y(a) - 0.02) / (y(a) - y(b))
        for a, b, y in ((0.1, 0.15, shortening), (0.05, 0.1, lambda p: shortening(p) / 2))
    )
    (first,) = re.findall(r"below 0.02: from pressure = ([\d.]+) on", out)
    (again,) = re.findall(r"on finer cells \(nx=36\) from pressure = ([\d.]+) on", out)
    (apart,) = re.findall(r"a difference of ([\d.]+), about the error that is left", out)
    found = float(first), float(again), float(apart)
    assert found == pytest.approx((coarse, fine, coarse - fine), abs=6e-4)
    assert {name for name in starts() if "nx=36" in name} == {
        f"pressure={p}_nx=36" for p in (0.05, 0.1, 0.15)
    }
    rows = {row["run"]: row for row in table()}
    assert rows["pressure=0.1_nx=36"]["blank.nx"] == "36" and rows["pressure=0.1"]["blank.nx"] == ""


def test_scatter_tells_mean_bounds_and_what_matters(run):
    words = "--scatter", "16", "--vary", "ring.pressure=0.2..0.3"
    status, out, _ = run(*words, "--below", "reaction_N=250")
    found = json.loads(Path("out/sweep.json").read_text())["scatter"]["reaction_N"]
    # 1000 x pressure x factor, both even: known exactly
    mean, square = 250 * 1.0, 1e6 * (0.25**2 + 0.01 / 12) * (1 + 1 / 12)
    assert status == 0 and found["runs"] == 16
    assert found["mean"] == pytest.approx(mean, rel=0.01)
    assert found["deviation"] == pytest.approx((square - mean**2) ** 0.5, rel=0.05)
    first, second = found["effects"]
    assert (first["name"], second["name"]) == ("factor", "pressure")
    assert first["change"] == pytest.approx(250, rel=0.02)
    assert second["change"] == pytest.approx(100, rel=0.05)
    variance = square - mean**2
    shares = first["share"], second["share"], found["left"]
    both = 250**2 / 12 / variance, 100**2 / 12 / variance
    assert shares == pytest.approx((*both, 1 - sum(both)), abs=0.01)
    told = r"punch force \[N\]: mean 25\d\S*, standard dev.*, 90 % of 16 runs between "
    assert re.search(told, out)
    assert re.search(r"reaction_N below 250: in \d of 16 runs", out)


def test_scatter_leaves_out_runs_that_are_not_believed(run):
    status, out, err = run("--scatter", "8", "--vary", "ring.pressure=0.5..1.1")
    assert status == 3 and "are not believed and left out: what is told is of the others" in out
    assert "of 8 runs are not believed" in err


def test_a_job_array_does_the_runs_and_the_same_command_their_table(run):
    """A run that gave up in the array is not tried again, nor is any other."""
    vary = "--vary", "ring.pressure=0.1,0.4,2"
    status, *_ = run(*vary, "--slurm", "array.sh", "--ranks", "4", "--", "--slow", "0.01")
    script = Path("array.sh").read_text()
    subprocess.run(["bash", "-n", "array.sh"], check=True)
    assert status == 0 and not starts() and "#SBATCH --array=1-3\n" in script
    assert "#SBATCH --ntasks=4\n" in script
    assert '--ranks 4 --only "$SLURM_ARRAY_TASK_ID" -- --slow 0.01\n' in script
    told = [run(*vary, "--only", str(k), "--", "--slow", "0.01")[0] for k in (3, 1, 2)]
    assert told == [3, 0, 0] and not Path("out/table.csv").exists()
    status, out, _ = run(*vary, "--", "--slow", "0.01")
    assert status == 3 and "3 runs, 3 done before" in out
    assert starts() == {f"pressure={p}": ["begin"] for p in ("0.1", "0.4", "2")}
    array = Path("out/table.csv").read_text()
    run(*vary, "--overwrite")
    assert Path("out/table.csv").read_text() == array


def test_a_file_that_is_no_script_is_not_replaced(run):
    status, _, err = run("--vary", "ring.pressure=1", "--slurm", "press.toml")
    assert status == 2 and "--slurm press.toml is there and no script of a sweep" in err
    assert Path("press.toml").read_text() == PRESS


def test_cores_and_memory_are_for_so_many_runs(tmp_path, monkeypatch):
    """Those of a rank of 2 GiB before a run has ended, then of the most that one took."""
    monkeypatch.setattr(runner.os, "sched_getaffinity", lambda _: range(16))
    monkeypatch.setattr(runner, "free_memory", lambda: 20 * 1024)
    (tmp_path / "summary.json").write_text('{"peak_memory_mib": 1500, "ranks": 2}')
    ended, other = (Run({}, tmp_path / name) for name in ("", "other"))
    room = {
        (ranks, jobs): Runner(None, Form(Path("press.toml"), ranks=ranks), jobs).room
        for ranks, jobs in ((1, None), (2, None), (32, None), (1, 9))
    }
    assert [each([other]) for each in room.values()] == [10, 5, 1, 9]
    assert [each([other, ended]) for each in room.values()] == [6, 6, 1, 9]


def test_pictures_and_a_page_with_links(run):
    run("--pictures", "--vary", "ring.pressure=0.01,0.1,0.4,2")
    page = Path("out/report.html").read_text()
    assert Path("out/curves.png").exists() and Path("out/trends.png").exists()
    assert page.count("data:image/png") == 2 and not Path("out/maps.png").exists()
    assert "4 runs, 3 of them believed" in page and "<th>punch force [N]</th>" in page
    assert "ended at load 0.5: no step is small enough" in page


def test_folders_have_readable_names_that_file_systems_take():
    assert varied.folder_name({"holder.pressure": "0.05"}) == "pressure=0.05"
    both = varied.folder_name({"tools.punch.friction": "0.1", "tools.die.friction": "0.2"})
    assert both == "punch.friction=0.1_die.friction=0.2"
    files = [varied.folder_name({"tools.punch.file": f"'{f}'"}) for f in ("a/b.stl", "a b.stl")]
    assert files[0] != files[1] and not any(set("/' ") & set(name) for name in files)


def test_values_may_be_texts_lists_and_tables():
    found = varied.lists(["a.b=komeili,[1, 2],{punch = 40, die = 1},'x,y',5e-2"])
    assert found == {"a.b": ["komeili", "[1, 2]", "{punch = 40, die = 1}", "'x,y'", "0.05"]}


def test_a_press_is_named_and_short_forms_behind_two_dashes_are_its_runs():
    """So the finer cells are finer than those that the runs have."""
    file = sweep.parser().parse_args(["hemisphere"]).press
    assert Form(file, ["--nx", "4", "--fibre-angle=45"]).finer({}) == {"blank.nx": "6"}


def test_a_quantity_that_runs_doubt_gives_no_answer_and_the_page_repeats_the_doubt(run):
    """The stand-in doubts heights of wrinkles from a pressure of 0.4 on, and nothing else."""
    words = "--vary", "ring.pressure=0.1,0.4", "--below"
    status, out, _ = run(*words, "wrinkles.count=1", *words[-1:], "shortening_mean=0.02")
    assert (
        status == 0 and "wrinkles.count below 1: in all runs, from pressure = 0.1 on; left" in out
    )
    assert "left out, as doubted, see the table: pressure = 0.4" in out
    assert "shortening_mean below 0.02: in all runs" not in out
    rows = [(row["verdict"], row["reason"]) for row in table()]
    assert rows == [("ok", ""), ("doubtful", "heights of wrinkles are rough")]
    page = Path("out/report.html").read_text()
    assert page.count("<li>heights of wrinkles are rough</li>") == 1
    _, out, _ = run("--vary", "ring.pressure=0.4", "--below", "wrinkles.count=1")
    assert "wrinkles.count below 1: no run is believed and has a value; left out" in out


def test_numbers_of_refined_runs_are_those_of_their_finest_cells(run):
    words = "--vary", "ring.pressure=0.1,0.4", "--below", "shortening_mean=0.02", "--finer"
    status, out, _ = run(*words, "--", "--refine")
    coarse, refined = (0.02 * p**-0.5 + 0.2 * p**2 - 0.04 for p in (0.1, 0.4))
    assert status == 0 and "on finer cells" not in out and len(table()) == 2
    numbers = [float(row["shortening_mean"]) for row in table()]
    assert numbers == pytest.approx([coarse, refined / 2])
    assert [row["verdict"] for row in table()] == ["ok", "ok"]
    share = (0.02 - coarse) / (refined / 2 - coarse)
    assert f"from pressure = {0.1 + 0.3 * share:.4g} on" in out
    page = Path("out/report.html").read_text()
    assert "heights of wrinkles are rough" not in page


def test_a_run_that_was_stopped_behind_its_first_result_is_not_believed(run, monkeypatch):
    """As by a signal while finer cells of `--refine` are run; the next call goes on with it."""
    late = "fabric form: stopped: stopped by SIGTERM at load factor 0.5"
    end = f"if not given.resume:\n    print('{late}')\n    sys.exit(3)\nsys.exit(3 if"
    text = FAKE.read_text().replace("sys.exit(3 if", end)
    Path("late.py").write_text(text)
    monkeypatch.setattr(sys.modules[__name__], "FAKE", Path("late.py"))
    status, out, _ = run("--vary", "ring.pressure=0.1")
    assert status == 3 and "pressure=0.1: gave up: stopped by SIGTERM at load factor 0.5" in out
    assert [(row["verdict"], row["converged"]) for row in table()] == [("invalid", "False")]
    assert run("--vary", "ring.pressure=0.1")[0] == 0 and table()[0]["verdict"] == "ok"
    assert starts() == {"pressure=0.1": ["begin", "resume"]}
