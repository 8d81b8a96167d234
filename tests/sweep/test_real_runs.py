"""A sweep of a small press, with the runs of `fabric form` itself."""

import csv
import io
import json
import re
from contextlib import chdir, redirect_stdout
from pathlib import Path

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.command_line import sweep
from fabric_fenicsx.sweep.form import Form

EXAMPLE = Path(__file__).parents[2] / "studies/presses/hemisphere.toml"
PRESS = re.sub(" *#.*", "", EXAMPLE.read_text()).replace("nx = 16", "nx = 6")
PRESS = PRESS.replace("steps = 20", "steps = 2").replace("punch = 40", "punch = 4")


@pytest.fixture
def press(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("press.toml").write_text(PRESS)
    return "press.toml"


VARY = ["--vary", "holder.pressure=0.5,0.05"]


def table(folder):
    with open(folder / "table.csv", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """The folder of a sweep, and what it printed."""
    path = tmp_path_factory.mktemp("swept")
    (path / "press.toml").write_text(PRESS)
    below = "--below", "shear_angle_max_deg=90"
    with chdir(path), redirect_stdout(io.StringIO()) as out:
        assert sweep.main(["press.toml", *VARY, *below, "--", "--no-pictures"]) == 0
    return path / "results/sweep_press", out.getvalue()


@pytest.mark.versions
def test_more_pressure_of_the_holder_draws_in_less(swept):
    folder, out = swept
    told = "in all runs, from pressure = 0.05 on"
    assert f"below 90: {told}; on finer cells (nx=10) in all runs, from" in out
    weak, finer, strong = table(folder)
    assert float(weak["draw_in.largest_mm"]) > float(strong["draw_in.largest_mm"]) > 0
    assert float(strong["reaction_N"]) > 1.5 * float(weak["reaction_N"]) > 0
    # of the larger angle alone, which is nearer to the limit
    assert finer["run"] == "pressure=0.05_nx=10"
    summary, other = (
        json.loads((folder / f"{row['run']}/summary.json").read_text()) for row in (weak, finer)
    )
    assert other["cells"] / summary["cells"] == pytest.approx((10 / 6) ** 2)
    assert float(weak["shortening_mean"]) == summary["quantities"]["shortening_mean"]
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png") == 3 and 'href="pressure%3D0.5/report.html"' in page
    assert (folder / "maps.png").stat().st_size > 10_000


RECTANGLE = 'length = 200\nwidth = 200\nnx = 6\nsymmetry = "xy"'


@pytest.mark.parametrize(
    ("before", "after", "cells"),
    [
        ("[contact]", "[[ply]]\n[[ply]]\nnx = 8\n[contact]", {"ply.1.nx": "10", "ply.2.nx": "12"}),
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
    [
        ("holder.presure=1,2", "run presure=1: press.toml: holders.holder.presure is unknown"),
        ("fabric.p_min=0.1,2", "run p_min=2: press.toml: blank.fabric: Yarn.p_min is 2; allowed"),
    ],
)
def test_values_that_a_press_cannot_have_are_told_before_any_run(press, capfd, vary, message):
    assert sweep.main([press, "--vary", vary]) == 2
    assert f"fabric sweep: error: {message}" in capfd.readouterr().err
    assert not Path("results").exists()
