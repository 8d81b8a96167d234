"""What a summary says of a result."""

import json
import math

from mpi4py import MPI

from fabric_fenicsx.results.output import Output, finite
from fabric_fenicsx.results.result import Result
from fabric_fenicsx.results.verdict import Reason


def test_numbers_that_json_does_not_know_are_null():
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
