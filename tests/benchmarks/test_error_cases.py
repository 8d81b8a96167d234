"""How estimated errors are held against true ones."""

import csv

import pytest
from bench.error_cases import judge


def row(quantity, true, estimated, bar=0.0):
    covered = estimated is not None and estimated + bar >= true
    errors = {"true": true, "estimated": estimated, "known_to": bar, "covered": covered}
    return {"case": "a", "test": "tensile", "quantity": quantity} | errors


def test_coverage_and_sharpness():
    """A true error that is hardly known says nothing of sharpness."""
    rows = [row("a", 1.0, 2.0), row("a", 1.0, 0.5), row("b", 1.0, 0.9, 0.8), row("b", 2.0, 8.0)]
    every, a, b, unknown = judge([*rows, row("c", 3.0, None)])
    assert (every["quantity"], every["cases"], every["covered"]) == ("all", 5, 0.75)
    assert every["unknown"] == pytest.approx(0.2) and unknown["covered"] is None
    assert (a["covered"], a["estimated_over_true"]) == (0.5, 1.25)
    assert (b["covered"], b["estimated_over_true"]) == (1.0, 4.0)


def test_the_study(launch):
    """Two coarse strips; of the second, whose yarns are sheared, the errors are true ones."""
    done = launch("error_estimates", "--quick")
    assert done.status == 0, done.err
    every, reaction, *_ = done.summary["quantities"]["coverage"]
    assert every["cases"] == 16 and reaction["covered"] == 0.5
    assert f"{100 * every['covered']:.1f} % of the others covered" in done.out
    with open(done.folder / "errors.csv") as file:
        rows = [row for row in csv.DictReader(file) if row["quantity"] == "reaction_N"]
    true, estimated, bar = (float(rows[1][k]) for k in ("true", "estimated", "known_to"))
    assert bar < true < estimated < 10 * true and true == pytest.approx(0.00337, rel=0.1)
