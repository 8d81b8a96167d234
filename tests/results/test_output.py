"""What files of a run say of a result, in plain numbers whatever NumPy gave."""

import json
import math

import numpy as np
import pytest
from builders import COMM, sheet
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.results.output import Output, finite
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
    assert finite(numbers) == {"a": [1.0, None, {"b": [None, "c", 2]}]}


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
