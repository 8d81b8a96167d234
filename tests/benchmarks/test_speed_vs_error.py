"""The study of cost against error on its few quick runs, and the reference values that it measures
errors by."""

import csv
import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import fabric_fenicsx as ff

REFERENCE = Path(__file__).parents[2] / "studies" / "reference"
SCENES = "tensile", "bias10", "bias30"


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


@pytest.fixture
def partly_here(monkeypatch):
    """Runs of the study in this process, which saves starts of others, but for those on ranks."""
    from bench import cost
    from mpi4py import MPI

    apart = cost.apart

    def run(c, command, limit):
        if c.ranks > 1:
            return apart(c, command, limit)
        row = cost.cost(MPI.COMM_SELF, ff.load("komeili"), c, REFERENCE)
        return asdict(c) | json.loads(json.dumps(row))

    monkeypatch.setattr(cost, "apart", run)
    monkeypatch.setattr(cost, "SHORT", 0.0)  # so that none is timed again


def test_quick_runs(partly_here, launch, hang):
    done = launch("speed_vs_error", "--quick", "--limit", hang)
    assert done.status == 0, done.err
    rows = read(done)
    assert [row["reason"] for row in rows] == [""] * 12
    assert len(done.out.splitlines()) == 12 + 9
    for scene in SCENES[:2]:
        runs = [r for r in rows if r["scene"] == scene]
        base, fine, p1, p2, iterative, two = runs
        assert abs(fine["error_reaction"]) < abs(base["error_reaction"])
        assert 0 < fine["error_energy"] < base["error_energy"]
        assert p1["dofs"] == pytest.approx(p2["dofs"], rel=0.05)
        assert (p1["mesh"], p2["mesh"]) == ("P1 unstructured 48", "P2 unstructured 24")
        assert abs(p1["error_energy"]) > 3 * abs(p2["error_energy"])
        assert p1["error_reaction"] > abs(p2["error_reaction"])
        for same in (iterative, two):
            assert same["reaction_N"] == pytest.approx(base["reaction_N"], rel=1e-6)
        assert two["ranks"] == 2 and two["memory_mib"] > 0
        assert abs(two["iterations"] - base["iterations"]) <= 1  # sums round otherwise
        for cost_of in ("wall_s", "tangent_ratio", "own_solves"):
            assert min(r[cost_of] for r in runs) > 0, cost_of
        assert all(r["error_curve"] >= abs(r["error_reaction"]) - 1e-12 for r in runs)
        for r in runs:
            better = (f for f in runs if f["resolved_error"] <= r["resolved_error"])
            beaten = any(f["cost"] <= r["cost"] and f is not r for f in better)
            assert (r["on_front"] == "True") == (not beaten)
        q = done.summary["quantities"][scene]
        assert len(q["front"]) == sum(r["on_front"] == "True" for r in runs)
        assert (q["runs"], q["failed"]) == (6, 0)
        good = [r["cost"] for r in runs if r["error_curve"] + r["error_bar"] <= 0.1]
        (best,) = done.summary["recommended"][scene]["0.1"]
        assert best["cost"] == pytest.approx(min(good))
    assert len(done.summary["recommended"]["all"]["0.1"]) == 2
    assert (done.folder / "front.png").stat().st_size > 10_000


def test_cost_of_forming(partly_here, launch, hang):
    done = launch("speed_vs_error", "--quick", "--forming", 0, "--limit", hang)
    assert done.status == 0, done.err
    coarse, finest = read(done)
    assert (coarse["cells"], finest["cells"]) == (72, 160)
    assert coarse["reason"] == finest["reason"] == ""
    assert 1e-3 < coarse["error_curve"] < 0.2 and finest["error_curve"] == 0
    apart = coarse["shear_max_deg"] - finest["shear_max_deg"]
    assert coarse["error_shear_max_deg"] == pytest.approx(apart)
    assert coarse["cpu_s"] > 0 and coarse["newton_iterations"] > 20
    assert (coarse["on_front"], finest["on_front"]) == ("True", "")
    assert done.summary["quantities"]["0 deg"]["finest"].startswith("0 deg P1 crossed 8 ")
    assert (done.folder / "forming_front.png").stat().st_size > 10_000


def test_cost_over_sizes(launch, hang):
    done = launch("speed_vs_error", "--quick", "--sizes", "--limit", hang)
    assert done.status == 0, done.err
    small, large, two = rows = read(done)
    assert (small["cells"], large["cells"], two["ranks"]) == (576, 2304, 2)
    for row in rows:
        assert row["reason"] == "" and row["linear_error"] < 1e-10 and row["tangent_s"] > 0
    q, names = done.summary["quantities"], ("tangent_s", "dofs")
    time, unknowns = (np.log(large[name] / small[name]) for name in names)
    found = q["mumps-cholesky"]["exponent_of_tangent_s"]
    assert found == pytest.approx(time / unknowns, rel=1e-6)
    gain = q["2 ranks, 2304 cells"]["gain_of_tangent_s"]
    assert gain == pytest.approx(large["tangent_s"] / two["tangent_s"])


@pytest.mark.parametrize(
    "options, words",
    [
        (("--scenes", "wrinkle"), ["--scenes", "wrinkle", "bias10"]),
        (("--limit", "0"), ["--limit", "above 0"]),
        (
            ("--reference", "nowhere"),
            ["--reference nowhere", "tensile.json", "benchmarks/reference.py"],
        ),
        (("--without", "biaxial"), ["--material komeili", "reference"]),
    ],
)
def test_bad_input(launch, options, words):
    done = launch("speed_vs_error", "--quick", *options)
    assert done.status == 2 and not done.folder.exists()
    for word in words:
        assert word in done.err


@pytest.mark.parametrize(
    "file, text",
    [("bias10_grid.csv", None), ("bias10.csv", "load\n0\n"), ("bias10_grid.csv", "x\n")],
)
def test_a_reference_that_lacks_a_file(launch, tmp_path, file, text):
    shutil.copytree(REFERENCE, tmp_path / "kept")
    (tmp_path / "kept" / file).unlink()
    if text:
        (tmp_path / "kept" / file).write_text(text)
    done = launch("speed_vs_error", "--quick", "--reference", tmp_path / "kept")
    assert done.status == 2 and not done.folder.exists()
    assert f"holds no readable {file}; allowed is" in done.err and "Traceback" not in done.err


def test_a_run_past_the_limit_is_told(launch):
    done = launch("speed_vs_error", "--quick", "--scenes", "tensile", "--limit", 0.1)
    assert done.status == 3 and "not done within 0.1 s" in done.err


@pytest.mark.parametrize("scene", SCENES)
def test_the_reference_tells_value_error_and_command(scene):
    found = committed(scene)
    assert found["command"] == f".venv/bin/python benchmarks/reference.py --scenes {scene}"
    for name in ("reaction_N", "energy_Nmm", "centre_eps_a", "centre_eps_b", "centre_shear_deg"):
        quantity = found["quantities"][name]
        value, error = quantity["value"], quantity["error"]
        others = [
            found["members"][how]["values"][name] for how in (found["series"][-1], *found["checks"])
        ]
        assert error > 0 and all(abs(value - other) <= error * (1 + 1e-9) for other in others)
    with open(REFERENCE / f"{scene}.csv") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["load"]) for row in rows] == pytest.approx([k / 20 for k in range(21)])
    for key, name in (("value", "reaction_N"), ("error", "error_N")):
        assert float(rows[-1][name]) == pytest.approx(
            found["quantities"]["reaction_N"][key], rel=1e-6
        )


@pytest.mark.versions
def test_the_reference_is_made_again(launch):
    done = launch("reference", "--quick")
    assert done.status == 0, done.err
    for scene in SCENES[:2]:
        again, before = json.loads((done.folder / f"{scene}.json").read_text()), committed(scene)
        assert again["series"] == before["series"][:2] and again["material"] == before["material"]
        for how in again["series"]:
            values, expected = (found["members"][how]["values"] for found in (again, before))
            for name in (
                "reaction_N",
                "energy_Nmm",
                "centre_eps_a",
                "centre_eps_b",
                "eps_a_max",
                "shear_deg_max",
            ):
                assert values[name] == pytest.approx(expected[name], rel=1e-5), (how, name)
