"""The study of cost against error on its few quick runs."""

import csv

import pytest

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
