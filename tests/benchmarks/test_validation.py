"""Studies of validation, hard cases, errors and speed."""

import csv

import numpy as np
import pytest
from bench.error_cases import judge
from bench.validation import bias_tests, fitted, frames, middle_angles, normalised, ratios


def test_a_size_that_the_fit_has_not_seen(launch):
    done = launch("validation", "--weaves", "unbalanced twill", "--no-pictures")
    assert done.status == 0, done.err
    with open(done.folder / "forces.csv", newline="") as file:
        rows = {
            row["test"]: [row[key] for key in row if "deg" in key] for row in csv.DictReader(file)
        }
    off = {test: np.array(values, float) for test, values in rows.items()}
    assert np.abs(off["UN 100x300"] - 1).max() < 0.03  # fitted
    assert np.abs(off["UN 100x250"] - 1).max() < 0.07
    assert np.abs(off["UN 100x200"][:-1] - 1).max() < 0.17
    assert off["INSA-NU 200x400"].min() > 4  # which no law can have beside the others
    assert "30 deg: frames 0.0439 to 0.0990 N/mm (1 to 2.3)" in done.out


@pytest.mark.long
def test_the_plain_weave():
    """The angle in the middle, which is less than the usual formula says, and the force of 115 x
    230 mm."""
    fabric = fitted("plain")
    assert middle_angles(fabric) == pytest.approx([6.2, 13.8, 23.4, 34.1], abs=0.1)
    off = {row["test"]: row for row in ratios("plain", fabric)}["INSA-NU 115x230"]
    assert 0.95 < off["10 deg"] < 1.05 < off["45 deg"] < 1.2
    angles, forces = frames("plain")
    assert forces.shape == (7, 5) and (forces.min(0)[1:] > normalised(fabric, angles)[1:]).all()
    assert len(bias_tests("plain")) == 9


FIRST = pytest.param("a", marks=[pytest.mark.mpi, pytest.mark.versions])
LONG = pytest.param("j", marks=pytest.mark.long)


@pytest.mark.parametrize("cases", [FIRST, "cl", "h", "fk", "i", LONG])
def test_hard_cases(launch, cases):
    done = launch("hard_cases", "--quick", "--only", cases)
    assert done.status == 0, done.out + done.err
    with open(done.folder / "cases.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["case"] for row in rows] == list(cases)
    for row in rows:
        assert row["holds"] == "True"
        assert row["faults"] == "[]"


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


WORDS = "run", "scene", "mesh", "integration", "linear_solver", "fibre_angle", "reason", "on_front"


def read(done):
    """Rows of table.csv, numbers where they are."""
    with open(done.folder / "table.csv") as file:
        rows = list(csv.DictReader(file))
    return [{k: v if k in WORDS else float(v) for k, v in row.items()} for row in rows]


def test_quick_runs(launch):
    done = launch("speed_vs_error", "--quick", "--scenes", "tensile")
    assert done.status == 0, done.err
    runs = base, fine, p1, p2, iterative = read(done)
    assert [row["reason"] for row in runs] == [""] * 5
    assert abs(fine["error_reaction"]) < abs(base["error_reaction"])
    assert 0 < fine["error_energy"] < base["error_energy"]
    assert p1["dofs"] == pytest.approx(p2["dofs"], rel=0.05)
    assert abs(p1["error_energy"]) > 3 * abs(p2["error_energy"])
    assert p1["error_reaction"] > abs(p2["error_reaction"])
    assert iterative["reaction_N"] == pytest.approx(base["reaction_N"], rel=1e-6)
    assert all(r["error_curve"] >= abs(r["error_reaction"]) - 1e-12 and r["cost"] > 0 for r in runs)
    for r in runs:
        better = (f for f in runs if f["resolved_error"] <= r["resolved_error"])
        beaten = any(f["cost"] <= r["cost"] and f is not r for f in better)
        assert (r["on_front"] == "True") == (not beaten)
    assert (done.folder / "front.png").stat().st_size > 10_000
