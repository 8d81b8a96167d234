"""A sweep of a small press, with the runs of `fabric form` itself."""

import csv
import json
from pathlib import Path

import pytest

from fabric_fenicsx.command_line import sweep

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
    assert status == 0 and "below 90: in all runs, from pressure = 0.05 on" in out
    folder = Path("results/sweep_press")
    with open(folder / "table.csv", newline="") as file:
        weak, strong = csv.DictReader(file)
    assert float(weak["draw_in.largest_mm"]) > float(strong["draw_in.largest_mm"]) > 0
    assert float(strong["reaction_N"]) > 2 * float(weak["reaction_N"]) > 0
    summary = json.loads((folder / "pressure=0.5/summary.json").read_text())
    assert float(strong["wrinkles.shortening"]) == summary["quantities"]["wrinkles"]["shortening"]
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png") == 3 and 'href="pressure%3D0.5/report.html"' in page
    assert (folder / "maps.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ("holder.presure=1,2", "run presure=1: press.toml: holders.ring.presure is unknown"),
        ("holder.pressure=0.1,-1", "run pressure=-1: press.toml: holders.ring.pressure is -1"),
        ("stage.2.steps=3", "run steps=3: press.toml: stage.2.steps: 2 of stage is unknown"),
    ],
)
def test_values_that_a_press_cannot_have_are_told_before_any_run(press, capfd, vary, message):
    assert sweep.main([press, "--vary", vary]) == 2
    assert f"fabric sweep: error: {message}" in capfd.readouterr().err
    assert not Path("results").exists()
