"""What files and the report say of a result."""

import json
import math

import numpy as np
import pytest
from builders import COMM, Elastic, sheet
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.core.files import write_json
from fabric_fenicsx.results.fields import FieldSeries
from fabric_fenicsx.results.output import Output
from fabric_fenicsx.results.report import page
from fabric_fenicsx.results.result import Result
from fabric_fenicsx.results.verdict import Reason
from fabric_fenicsx.solve.checkpoint import Checkpoint
from fabric_fenicsx.solve.progress import Progress
from fabric_fenicsx.sweep.folder import Run

GIVEN = {
    **{"real": np.float32(0.5), "whole": np.uint8(3), "bool": np.bool_(True), "text": np.str_("a")},
    **{"array": np.array([[1, 2], [3, 4]]), "nested": ({np.int64(7): [np.bool_(False)]},)},
}
PLAIN = {"real": 0.5, "whole": 3, "bool": True, "text": "a", "array": [[1, 2], [3, 4]]}
PLAIN |= {"nested": [{"7": [False]}]}


def summary(folder):
    output = Output("a run", folder, COMM)
    output.folder()
    written = output.summarise(folder, **GIVEN)
    json.dumps(output.amend(folder, written, amended=GIVEN))
    output.close()
    kept = json.loads((folder / "summary.json").read_text())
    assert kept["amended"] == PLAIN
    return {name: kept[name] for name in PLAIN}


def checkpoint(folder):
    blank = sheet(2, 1, 2, 1, comm=MPI.COMM_SELF)
    still = [compat.petsc_vector(blank.u).duplicate() for _ in range(2)]
    state = Progress(*still, step=np.float32(0.5), load=np.float32(0.5))
    problem = {"numbers": GIVEN}
    Checkpoint(folder / "c.npz", blank, problem).save(state, {"notes": GIVEN})
    read, notes = Checkpoint(folder / "c.npz", blank, {"numbers": PLAIN}).load()
    assert read.load == 0.5
    return notes["notes"]


def variant(folder):
    """Of a sweep."""
    run = Run(GIVEN, folder)
    run.save()
    return json.loads((folder / "run.json").read_text())["values"]


@pytest.mark.parametrize("write", [summary, checkpoint, variant])
def test_what_is_kept_is_plain(tmp_path, write):
    assert write(tmp_path) == PLAIN
    numbers = {"a": [1.0, math.nan, {"b": (math.inf, "c", 2)}]}
    write_json(tmp_path / "a.json", numbers)
    kept = json.loads((tmp_path / "a.json").read_text())
    assert kept == {"a": [1.0, None, {"b": [None, "c", 2]}]}


def test_a_run_owns_what_is_on_its_list(tmp_path):
    """All else in its folder stays, and is refused where it has the name of a result."""

    def run(folder, *pictures, ends=True, part="", **how):
        output = Output("run", tmp_path / folder, MPI.COMM_SELF, **how)
        for name in ("history.csv", *pictures):
            (output.folder(part) / name).write_text("the run's")
        output.summarise(output.path / part)
        output.report("", "done") if ends else output._open.close()

    def contents():
        return {f.relative_to(tmp_path): f.read_bytes() for f in tmp_path.rglob("*.*")}

    def refused(folder, words, **how):
        before = contents()
        with pytest.raises(ff.InputError, match=words):
            run(folder, "curve.png", **how)
        assert before == contents()

    (tmp_path / "report.html").write_text("mine")
    refused("", "holds inputs, or files that no run of it wrote: report.html; expected")
    for folder, ends in ("all/A", True), ("all/B", False):  # which was killed
        run(folder, "formed.png", part="unloaded", ends=ends)
        for name in ("photo.png", "unloaded/notes.txt"):
            (tmp_path / folder / name).write_text("mine")
        refused(folder, "holds results")
        refused("all", "wrote: A, B; expected" if folder == "all/B" else ": A;", overwrite=True)
        run(folder, overwrite=True)
        own = "history.csv summary.json report.html log.txt .files.json .lock".split()
        names = {str(f.relative_to(tmp_path / folder)) for f in (tmp_path / folder).rglob("*.*")}
        assert names == {"photo.png", "unloaded/notes.txt", *own}
        (tmp_path / folder / "curve.png").write_text("mine")
        refused(folder, "wrote: curve.png; expected", overwrite=True)


def test_what_is_invalid_is_before_doubts_and_both_stay(tmp_path):
    output = Output("run", tmp_path, MPI.COMM_SELF)
    doubt, worse = Reason("a doubt", "wrinkles"), Reason("wrong", verdict="invalid")
    assert output.summarise(None)["verdict"] == "ok"
    output.doubt(doubt)
    output.warn("first")
    summary = output.summarise(tmp_path, own=1.5)
    assert summary["verdict"] == "doubtful" and summary["warnings"] == ["first"]
    output.doubt(worse)
    output.doubt(worse)
    output.warn("second")
    output.amend(tmp_path, summary, error={"own": 0.1})
    written = json.loads((tmp_path / "summary.json").read_text())
    assert written["verdict"] == "invalid" and written["warnings"] == ["first", "second"]
    assert [each["text"] for each in written["reasons"]] == ["wrong", "a doubt"]
    assert (written["own"], written["error"]) == (1.5, {"own": 0.1})


def test_a_number_is_told_with_its_error_in_its_unit():
    summary = {"reaction_N": 2.5, "energy": {"strain": 4.0}, "error": {"a.b": 0.125, "c": None}}
    result = Result(summary | {"quantities": {"a": {"b": -0.5}, "c": 3.0}}, [], {}, None, None)
    assert [result.number(k) for k in ("strain_energy_Nmm", "reaction_N", "a.b")] == [4, 2.5, -0.5]
    assert result.number("a") is None and result.formatted("a.d") == "-"
    assert result.formatted("a.b", ".3g", scale=-4.0) == "2 +- 0.5"
    assert result.formatted("c") == "3 +- unknown" and result.formatted("reaction_N") == "2.5"


def test_the_verdict_is_first_then_the_part_and_six_numbers(tmp_path):
    """Of a stack with the draw-in of each ply and its place; all other numbers, with units, errors
    and places, are folded."""
    file = tmp_path / "summary.json"
    draw_in = {"largest_mm": 12.5, "largest_at_mm": [0.0, 60.0]}
    found = {"shear_angle_deg": [-1.5, 47.12345], "shear_angle_max_at_mm": [3.0, 4.5]}
    found |= {"draw_in": {"largest_mm": 12.5}, "own_N_per_mm": 1234.5678}
    errors = {"draw_in.largest_mm": 0.25, "own_N_per_mm": None, "reaction_N": 0.5}
    reason = {"verdict": "invalid", "text": "a cell is sheared by 89 deg", "of": ""}
    facts = {"verdict": "invalid", "reasons": [reason], "reaction_N": 5.0, "reaction_is": "force"}
    facts |= {"quantities": found | {"plies": {"lower": {"draw_in": draw_in}}}, "error": errors}
    file.write_text(json.dumps({"wall_s": {}, "energy": {"strain": 4.0}, **facts}))
    (picture := tmp_path / "formed.png").touch()
    text = page("dome", {"": (file, [picture])}, "what it is", "not valid: sheared")
    order = ["Verdict: invalid", "sheared by 89 deg", "The formed ply", "5 +- 0.5"]
    order += ["draw-in [mm]</th><td>12.5 +- 0.25</td><td>12.5 at (0, 60) mm", "<details>"]
    order += ["angle [deg]</th><td>-1.5 to 47.123</td>", "max at [mm]</th><td>(3, 4.5)</td>"]
    order += ["<th>own [N/mm]</th><td>1234.6 +- unknown</td>", "<th>largest [mm]</th><td>12.5 +- "]
    places = [text.index(words) for words in [*order, "what it is"]]
    assert places == sorted(places) and "not valid: sheared" not in text


SIZES = np.array([45.0, 40.0, 0.0])
SHRINK = np.array([0.02, 0.1, 0.0])  # along x and y
QUARTER = [ff.Support(f"x{i} = 0", lambda x, i=i: x[i] < 1e-6, (i,)) for i in (0, 1)]


@pytest.mark.mpi
@pytest.mark.parametrize(
    "supports, share, about",
    [
        (QUARTER, 1.0, 0 * SIZES),
        (ff.clamped_ends(), 0.5, SIZES / 2),
        (QUARTER[:1], np.array([1.0, 0.5]), SIZES * [0, 0.5, 0]),
    ],
)
def test_draw_in_of_a_scene_of_ones_own(folder, supports, share, about):
    """That shrinks about a place, of a whole sheet that lies anywhere, a half or a quarter: clamps
    at x = 0 are no plane of symmetry, whose edge does not count."""
    blank = ff.Blank.rectangle(*SIZES[:2], nx=6, ny=6, spatial=True)
    scene = ff.Scene(blank, [Elastic()], supports)
    blank.u.x.array[:] = (-SHRINK * (blank.coordinates() - about)).ravel()
    folder.mkdir(exist_ok=True)
    FieldSeries(folder, scene).write(1.0)
    found = ff.Result({}, [], {}, folder, scene).draw_in()
    assert len(found.pop("largest_at_mm")) == 2
    x, y = share * (SHRINK * SIZES)[:2]
    long, short = (y, x) if (share * SIZES[:2]).argmax() == 0 else (x, y)
    corner = (x + y) / np.sqrt(2)
    both = [(axis, way) for axis, way, part in zip("xy", (x, y), share * np.ones(2)) if part == 0.5]
    assert found == pytest.approx(
        {
            "middle_of_long_side_mm": long,
            "middle_of_short_side_mm": short,
            "corner_mm": corner,
            "largest_mm": max(x, y, corner),
            **{f"middle_at_{end}_{axis}_mm": way for axis, way in both for end in ("low", "high")},
        },
        abs=1e-5,  # files have single precision
    )
