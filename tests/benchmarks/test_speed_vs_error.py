"""The study of cost against error on its few quick runs, and the reference values that it measures
errors by."""

import csv
import json
from pathlib import Path

import pytest

REFERENCE = Path(__file__).parents[2] / "studies" / "reference"


def committed(scene):
    return json.loads((REFERENCE / f"{scene}.json").read_text())


def read(done):
    """Rows of table.csv, numbers where they are."""
    with open(done.folder / "table.csv") as file:
        return [{k: number(v) for k, v in row.items()} for row in csv.DictReader(file)]


def number(word):
    try:
        return float(word)
    except ValueError:
        return word


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


@pytest.mark.long
def test_cost_of_forming(launch):
    done = launch("speed_vs_error", "--quick", "--forming", 0)
    assert done.status == 0, done.err
    coarse, finest = read(done)
    assert (coarse["cells"], finest["cells"]) == (72, 160)
    assert coarse["reason"] == finest["reason"] == ""
    assert 1e-3 < coarse["error_curve"] < 0.2 and finest["error_curve"] == 0
    apart = coarse["shear_max_deg"] - finest["shear_max_deg"]
    assert coarse["error_shear_max_deg"] == pytest.approx(apart)
    assert (coarse["on_front"], finest["on_front"]) == ("True", "")
    assert done.summary["quantities"]["0 deg"]["finest"].startswith("0 deg P1 crossed 8 ")
    assert (done.folder / "forming_front.png").stat().st_size > 10_000


@pytest.mark.versions
def test_the_reference_is_made_again(launch):
    done = launch("reference", "--quick", "--scenes", "bias10")
    assert done.status == 0, done.err
    again, before = json.loads((done.folder / "bias10.json").read_text()), committed("bias10")
    assert again["series"] == before["series"][:2] and again["material"] == before["material"]
    for mesh in again["series"]:
        values, expected = (found["members"][mesh]["values"] for found in (again, before))
        for name in ("reaction_N", "energy_Nmm", "centre_eps_b", "eps_a_max", "shear_deg_max"):
            assert values[name] == pytest.approx(expected[name], rel=1e-5), (mesh, name)
