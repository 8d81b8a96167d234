"""A sweep of a small press, with the runs of `fabric form` itself."""

import csv
import json
import os
import subprocess
from pathlib import Path

import pytest

from fabric_fenicsx.command_line import sweep
from fabric_fenicsx.sweep.processes import Form

PRESS = """
unit = "mm"
title = "Small hemisphere"
[blank]
fabric = "komeili"
length = 200
width = 200
nx = 6
quarter = true
[contact]
friction = 0.2
[tools.punch]
shape = "sphere"
radius = 50
[tools.ring]
shape = "plate"
length = 108
entry = 8
side = "above"
[holders.ring]
pressure = 0.05
[[stage]]
name = "forming"
moves = { punch = 4 }
steps = 2
"""


@pytest.fixture
def press(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("press.toml").write_text(PRESS)
    return "press.toml"


@pytest.mark.versions
def test_more_pressure_of_the_holder_draws_in_less(press, capfd):
    vary = ["--vary", "holder.pressure=0.5,0.05", "--below", "shear_angle_max_deg=90"]
    status = sweep.main([press, *vary, "--", "--no-pictures"])
    out = capfd.readouterr().out
    told = "in all runs, from pressure = 0.05 on"
    assert status == 0 and f"below 90: {told}; on finer cells (nx=10) in all runs, from" in out
    folder = Path("results/sweep_press")
    with open(folder / "table.csv", newline="") as file:
        weak, strong, finer = csv.DictReader(file)
    assert float(weak["draw_in.largest_mm"]) > float(strong["draw_in.largest_mm"]) > 0
    assert float(strong["reaction_N"]) > 2 * float(weak["reaction_N"]) > 0
    # of the larger angle alone, which is nearer to the limit
    assert finer["run"] == "pressure=0.5_nx=10"
    cells = [
        json.loads((folder / f"{row['run']}/summary.json").read_text())["cells"]
        for row in (strong, finer)
    ]
    assert cells[1] / cells[0] == pytest.approx((10 / 6) ** 2)
    summary = json.loads((folder / "pressure=0.5/summary.json").read_text())
    assert float(strong["shortening_mean"]) == summary["quantities"]["shortening_mean"]
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png") == 3 and 'href="pressure%3D0.5/report.html"' in page
    assert (folder / "maps.png").stat().st_size > 10_000


WEAVE = """
law = "law58"
thickness_mm = 1.0
density_g_per_cm3 = 0.75
E_a = 1000.0
E_b = 1000.0
B_a = 0.0
B_b = 0.0
flex = 0.01
G_0 = 0.02
G_T = 0.5
gamma_T = 0.8
[units]
stress = "MPa"
[scatter]
shear_factor = [0.5, 2.0]
"""


def test_scatter_of_a_material_file(press, capfd):
    """Forces of shear and friction are of first order in both numbers."""
    text = PRESS.replace('"komeili"', '"weave.toml"').replace("pressure = 0.05", "pressure = 1e-4")
    Path(press).write_text(text)
    Path("weave.toml").write_text(WEAVE)
    words = [press, "--scatter", "8", "--vary", "contact.friction=0.01..0.02", "--jobs", "2"]
    assert sweep.main([*words, "--", "--no-pictures"]) == 0, capfd.readouterr().err
    folder = Path("results/sweep_press")
    state = json.loads((folder / "sweep.json").read_text())
    force = state["scatter"]["reaction_N"]
    assert state["keys"] == ["fabric.shear_factor", "contact.friction"]
    assert [each["name"] for each in force["effects"]] == ["shear_factor", "friction"]
    assert force["effects"][0]["change"] > 10 * force["effects"][0]["error"]
    with open(folder / "table.csv", newline="") as file:
        for row in csv.DictReader(file):
            values = json.loads((folder / row["run"] / "run.json").read_text())["values"]
            assert row["fabric.shear_factor"] == values["fabric.shear_factor"]
            facts = json.loads((folder / row["run"] / "summary.json").read_text())
            stiffness = 0.02 * float(row["fabric.shear_factor"])
            assert f"G_0 = {stiffness!r}" in facts["fabric"]
    assert {"curves.png", "trends.png"} == {path.name for path in folder.glob("*.png")}


def test_a_job_array_on_ranks_has_the_results_of_a_sweep(press, capfd):
    words = [press, "--vary", "holder.pressure=0.5,0.05", "--no-pictures"]
    passed = ["--", "--no-pictures"]
    assert sweep.main([*words, "--slurm", "array.sh", "--ranks", "2", *passed]) == 0
    for k in ("1", "2"):
        task = os.environ | {"SLURM_ARRAY_TASK_ID": k, "PYTHONPATH": str(Path(__file__).parents[2])}
        subprocess.run(["bash", "array.sh"], check=True, env=task)
    tables = []
    for where in ([], ["--out", "here"]):
        assert sweep.main([*words, *where, *passed]) == 0
        with open(Path(*where[1:] or ["results/sweep_press"]) / "table.csv", newline="") as file:
            tables.append([*csv.DictReader(file)])
    assert "2 runs, 2 done before" in capfd.readouterr().out
    for array, local in zip(*tables, strict=True):
        assert array.keys() == local.keys() and array["run"] == local["run"]
        for name in ("reaction_N", "shear_angle_max_deg", "draw_in.largest_mm"):
            assert float(array[name]) == pytest.approx(float(local[name]), rel=1e-7)


@pytest.mark.parametrize(
    ("changes", "cells"),
    [
        ([], {"blank.nx": "10"}),
        ([("nx = 6", "nx = 7\nny = 4")], {"blank.nx": "11", "blank.ny": "6"}),
        ([("nx = 6", "")], {"blank.nx": "36"}),
        ([("quarter = true", "quarter = true\nelement = 'P2'")], {"blank.nx": "10"}),
        (
            [("[contact]", "[[ply]]\n[[ply]]\nnx = 8\n[contact]")],
            {"blank.nx": "10", "ply.2.nx": "12"},
        ),
        (
            [("length = 200\nwidth = 200\nnx = 6\nquarter = true", "outline = 'o.csv'\nsize = 30")],
            {"blank.size": "20"},
        ),
        (
            [
                ("length = 200\nwidth = 200\nnx = 6\nquarter = true", "size = 30"),
                ("[contact]", "[[ply]]\noutline = 'o.csv'\n[contact]"),
            ],
            {"ply.1.size": "20"},
        ),
    ],
)
def test_cells_of_the_finer_mesh(press, changes, cells):
    Path("o.csv").write_text("x [mm],y [mm]\n-100,-100\n100,-100\n100,100\n-100,100\n")
    text = PRESS
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    Path(press).write_text(text)
    form = Form(Path(press))
    assert form.finer({"holder.pressure": "0.1"}) == cells
    assert not form.finer({"blank.nx": "8"})
    form.check([{"holder.pressure": "0.1", **cells}])


def test_a_press_of_several_fabrics_scatters_them_apart(press):
    plies = '[[ply]]\n[[ply]]\nname = "upper"\nfabric = "stiff.toml"\n[contact]'
    text = PRESS.replace('"komeili"', '"weave.toml"').replace("[contact]", plies)
    Path(press).write_text(text)
    Path("weave.toml").write_text(WEAVE)
    Path("stiff.toml").write_text(WEAVE.replace("G_0 = 0.02", "G_0 = 0.03"))
    keys = [each.key for each in Form(Path(press)).scatter()]
    assert keys == ["ply.1.fabric.shear_factor", "ply.upper.fabric.shear_factor"]
    Path("stiff.toml").write_text(WEAVE)
    text = text.replace("stiff.toml", "weave.toml")
    Path(press).write_text(text)
    assert [each.key for each in Form(Path(press)).scatter()] == ["fabric.shear_factor"]
    Form(Path(press)).check([{"fabric.shear_factor": "1.2", "ply.upper.fabric.G_T": "0.3"}])


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ("holder.presure=1,2", "run presure=1: press.toml: holders.ring.presure is unknown"),
        ("holder.pressure=0.1,-1", "run pressure=-1: press.toml: holders.ring.pressure is -1"),
        (
            "fabric.p_min=0.1,2",
            "run p_min=2: press.toml: blank.fabric: Yarn.p_min is 2; allowed is",
        ),
        ("fabric.s5=1,2", "run s5=1: press.toml: blank.fabric: s5 is unknown; allowed are a, b"),
        ("metal.E=1,2", "run E=1: press.toml: change metal.E=1 is of one metal of all sheets, and"),
        ("stage.2.steps=3", "run steps=3: press.toml: stage.2.steps: 2 of stage is unknown"),
    ],
)
def test_values_that_a_press_cannot_have_are_told_before_any_run(press, capfd, vary, message):
    assert sweep.main([press, "--vary", vary]) == 2
    assert f"fabric sweep: error: {message}" in capfd.readouterr().err
    assert not Path("results").exists()
