"""Studies of validation, hard cases, errors and speed."""

import csv
from types import SimpleNamespace

import numpy as np
import pytest
from bench.error_cases import judge
from bench.hard import Case, Setting, near
from bench.hard_table import CASES
from bench.validation import bias_tests, fitted, frames, middle_angles, normalised, ratios
from builders import COMM

import fabric_fenicsx as ff


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


ON_RANKS = pytest.param("mixed order", marks=[pytest.mark.mpi, pytest.mark.versions])


@pytest.mark.parametrize("name", [ON_RANKS, *(n for n, case in CASES.items() if case.quick)])
def test_hard_cases(name):
    """Load, number and iterations of a third of them."""
    row = CASES[name].judge(Setting(COMM, ff.load("komeili")))
    assert row["holds"], row["flaws"]


def test_a_hard_case_fails_by_load_number_iterations_energy_or_a_stop_that_is_not_named():
    def judged(reached=1.0, value=1.0, iterations=10, imbalance=0.0, reason="", **options):
        outcome = SimpleNamespace(iterations=iterations, accepted=1, rejected=0)
        outcome.reached, outcome.reason = reached, reason
        run = SimpleNamespace(outcome=outcome, imbalance=imbalance, faults=[])
        made = lambda setting: ([run], [near("force", value, 1.0, 0.1)])  # noqa: E731
        return Case("own", made, 8, **options).judge(Setting(COMM, ff.load("komeili")))["holds"]

    assert judged() and judged(imbalance=0.1, snaps=True)
    assert not (judged(0.9) or judged(value=0.8) or judged(iterations=11) or judged(imbalance=0.1))
    unstable = {"reason": "where the law is unstable", "stops": 0.8}
    assert judged(0.9, **unstable) and not judged(0.7, **unstable)
    assert not (judged(0.9, reason="no convergence", stops=0.8) or judged(float("nan")))


def test_the_table_of_hard_cases(launch):
    done = launch("hard_cases", "--quick", "--only", "single elements", "slack net")
    assert done.status == 0, done.err
    with open(done.folder / "cases.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["case"] for row in rows] == ["single elements", "slack net"]
    assert "single elements            100 %    64          0 " in done.out


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
