"""A sweep of a small press, with the runs of `fabric form` itself."""

import csv
import json
import re
from pathlib import Path

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.command_line import sweep
from fabric_fenicsx.sweep.form import Form

EXAMPLE = Path(__file__).parents[2] / "studies/presses/hemisphere.toml"
PRESS = re.sub(" *#.*", "", EXAMPLE.read_text()).replace("nx = 16", "nx = 4")
PRESS = PRESS.replace("steps = 20", "steps = 2").replace("punch = 40", "punch = 4")


@pytest.fixture
def press(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("press.toml").write_text(PRESS)
    return "press.toml"


VARY = ["--vary", "holder.pressure=0.5,0.05"]


@pytest.mark.versions
def test_more_pressure_of_the_holder_draws_in_less(press, capsys):
    """Numbers in the table are those of the runs; the page has their pictures."""
    assert sweep.main([press, *VARY, "--", "--no-pictures"]) == 0
    folder = Path("results/sweep_press")
    with open(folder / "table.csv", newline="") as file:
        weak, strong = csv.DictReader(file)
    assert float(weak["draw_in.largest_mm"]) > float(strong["draw_in.largest_mm"]) > 0
    assert float(strong["reaction_N"]) > 1.5 * float(weak["reaction_N"]) > 0
    summary = json.loads((folder / "pressure=0.05/summary.json").read_text())
    assert float(weak["shortening_mean"]) == summary["quantities"]["shortening_mean"]
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png") == 3 and 'href="pressure%3D0.5/report.html"' in page
    assert (folder / "maps.png").stat().st_size > 10_000


RECTANGLE = 'length = 200\nwidth = 200\nnx = 4\nsymmetry = "xy"'


@pytest.mark.parametrize(
    ("before", "after", "cells"),
    [
        ("[contact]", "[[ply]]\n[[ply]]\nnx = 8\n[contact]", {"ply.1.nx": "6", "ply.2.nx": "12"}),
        (RECTANGLE, "outline = 'o.csv'\nsize = 30", {"blank.size": "20"}),
    ],
)
def test_cells_of_the_finer_mesh(press, before, after, cells):
    Path("o.csv").write_text("x [mm],y [mm]\n-100,-100\n100,-100\n100,100\n-100,100\n")
    assert before in PRESS
    Path(press).write_text(PRESS.replace(before, after))
    form = Form(Path(press))
    assert form.finer({"holder.pressure": "0.1"}) == cells
    assert not form.finer({"blank.nx": "8"})
    short = Form(Path(press), ["--nx", "8", "--fibre-angle=45"])  # cells that its runs have
    assert "size" in before + after or short.finer({})["ply.1.nx"] == "12"
    form.check([{"holder.pressure": "0.1", **cells}])
    known = form.quantities({"holder.pressure": "0.1"})
    assert any(name.endswith("wavelength_mm") for name in known)  # which a flat ply has no value of


def test_a_press_of_several_fabrics_scatters_them_apart(press):
    weave, scatter = ff.load("komeili"), "\n[scatter]\nshear_factor = [0.5, 2.0]\n"
    Path("weave.toml").write_text(weave.dumps() + scatter)
    Path("stiff.toml").write_text(weave.changed({"s1": 0.3}).dumps() + scatter)
    plies = '[[ply]]\n[[ply]]\nname = "upper"\nfabric = "stiff.toml"\n[contact]'
    text = PRESS.replace('"komeili"', '"weave.toml"').replace("[contact]", plies)
    for other, keys in (("stiff", "ply.1.fabric ply.upper.fabric"), ("weave", "fabric")):
        Path(press).write_text(text.replace("stiff", other))
        found = [each.key for each in Form(Path(press)).scatter()]
        assert found == [f"{key}.shear_factor" for key in keys.split()]
    Form(Path(press)).check([{"fabric.shear_factor": "1.2", "ply.upper.fabric.s1": "0.3"}])


@pytest.mark.parametrize(
    ("vary", "message"),
    [("fabric.p_min=0.1,2", "run p_min=2: press.toml: blank.fabric: Yarn.p_min is 2; allowed")],
)
def test_values_that_a_press_cannot_have_are_told_before_any_run(press, capfd, vary, message):
    assert sweep.main([press, "--vary", vary]) == 2
    assert f"fabric sweep: error: {message}" in capfd.readouterr().err
    assert not Path("results").exists()
