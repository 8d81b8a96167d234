"""The study of cost against error on its few quick runs, and the reference values that it measures
errors by."""

import csv
import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

REFERENCE = Path(__file__).parents[2] / "studies" / "reference"
SCENES = "tensile", "bias10", "bias30"
APART = "baseline", "ranks"  # sweeps whose runs the tests start in processes of their own
WORDS = "scene", "sweep", "element", "pattern", "integration", "linear_solver", "on_front", "reason"


def committed(scene):
    return json.loads((REFERENCE / f"{scene}.json").read_text())


@pytest.fixture
def partly_here(monkeypatch):
    """Runs of the study in this process, which saves starts of others, but for those of which
    ranks or memory count."""
    from bench import cost, own_process
    from mpi4py import MPI

    from fabric_fenicsx.material.presets import load

    apart = own_process.run_apart

    def run(c, command, limit):
        if c.sweep in APART:
            return apart(c, command, limit)
        row = cost.cost(MPI.COMM_SELF, load("komeili"), c, REFERENCE)
        return asdict(c) | json.loads(json.dumps(row))

    monkeypatch.setattr(own_process, "run_apart", run)


def test_quick_runs(partly_here, launch, hang):
    done = launch("speed_vs_error", "--quick", "--limit", hang)
    assert done.status == 0, done.err
    with open(done.folder / "table.csv") as file:
        rows = [
            {k: v if k in WORDS or v == "" else float(v) for k, v in row.items()}
            for row in csv.DictReader(file)
        ]
    assert len(rows) == 12
    assert [row["reason"] for row in rows] == [""] * 12
    assert len(done.out.splitlines()) == 1 + 12 + 9
    for scene in SCENES[:2]:
        runs = [r for r in rows if r["scene"] == scene]
        base, fine, p1, p2, iterative, two = runs
        assert abs(fine["error_reaction"]) < abs(base["error_reaction"])
        assert 0 < fine["error_energy"] < base["error_energy"]
        assert p1["dofs"] == pytest.approx(p2["dofs"], rel=0.05)
        assert p1["pattern"] == p2["pattern"] == "unstructured"
        assert abs(p1["error_energy"]) > 3 * abs(p2["error_energy"])
        assert p1["error_reaction"] > abs(p2["error_reaction"])
        for same in (iterative, two):
            assert same["reaction_N"] == pytest.approx(base["reaction_N"], rel=1e-6)
        assert two["ranks"] == 2
        assert abs(two["iterations"] - base["iterations"]) <= 1  # sums round otherwise
        for cost_of in ("wall_s", "tangent_ratio", "own_solves"):
            assert min(r[cost_of] for r in runs) > 0, cost_of
        assert min(r["memory_mib"] for r in runs if r["sweep"] in APART) > 0
        front = [r for r in runs if r["on_front"] == "True"]
        assert all(r["error_curve"] >= abs(r["error_reaction"]) - 1e-12 for r in runs)
        error = {id(r): max(r["error_curve"], r["error_bar"]) for r in runs}
        for r in runs:
            beaten = [
                f
                for f in runs
                if f["cost"] <= r["cost"] and error[id(f)] <= error[id(r)] and f is not r
            ]
            assert (r in front) == (not beaten)
        q = done.summary["quantities"][scene]
        assert len(q["front"]) == len(front)
        assert q["failed"] == 0
        assert q["runs"] == len(runs)
        cheapest = min(
            runs, key=lambda r: r["cost"] if r["error_curve"] + r["error_bar"] <= 0.1 else 1e9
        )
        assert q["recommended"]["0.1"]["cost"] == pytest.approx(cheapest["cost"])
    assert (done.folder / "front.png").stat().st_size > 10_000


def test_cost_of_forming(partly_here, launch, hang):
    done = launch("speed_vs_error", "--quick", "--forming", 0, "--limit", hang)
    assert done.status == 0, done.err
    with open(done.folder / "table.csv") as file:
        coarse, finest = csv.DictReader(file)
    assert (coarse["cells"], finest["cells"]) == ("72", "160")
    assert coarse["reason"] == finest["reason"] == ""
    assert 1e-3 < float(coarse["error_curve"]) < 0.2 and float(finest["error_curve"]) == 0
    mine, known = (float(r["shear_max_deg"]) for r in (coarse, finest))
    assert float(coarse["error_shear_max_deg"]) == pytest.approx(mine - known)
    assert float(coarse["cpu_s"]) > 0 and int(coarse["iterations"]) > 20
    assert (coarse["on_front"], finest["on_front"]) == ("True", "False")
    assert done.summary["quantities"]["0 deg"]["finest"].startswith("0 deg P1 crossed 8 ")
    assert (done.folder / "forming_front.png").stat().st_size > 10_000


def test_cost_over_sizes(launch, hang):
    done = launch("speed_vs_error", "--quick", "--sizes", "--limit", hang, apart=True)
    assert done.status == 0, done.err
    with open(done.folder / "table.csv") as file:
        small, large, two = csv.DictReader(file)
    assert (small["cells"], large["cells"], two["ranks"]) == ("576", "2304", "2")
    for row in (small, large, two):
        assert row["reason"] == ""
        assert float(row["linear_error"]) < 1e-10
        assert float(row["tangent_s"]) > 0
    q = done.summary["quantities"]
    ratio = float(large["tangent_s"]) / float(small["tangent_s"])
    exponent = np.log(ratio) / np.log(float(large["dofs"]) / float(small["dofs"]))
    assert q["mumps-cholesky"]["exponent_of_tangent_s"] == pytest.approx(
        exponent, rel=0.05, abs=0.05
    )
    assert "gain_of_tangent_s" in q["2 ranks, 2304 cells"]


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
