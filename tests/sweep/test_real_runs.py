"""A sweep of a small press, with the runs of `fabric form` itself."""

import csv
import json
import re
from pathlib import Path

import pytest

from fabric_fenicsx.cli import sweep
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.sweep.runner import SweepRun

EXAMPLE = Path(__file__).parents[2] / "studies/presses/hemisphere.toml"
PRESS = re.sub(" *#.*", "", EXAMPLE.read_text()).replace("nx = 16", "nx = 4")
PRESS = PRESS.replace("steps = 20", "steps = 2").replace("punch = 40", "punch = 4")


@pytest.fixture
def press(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("press.toml").write_text(PRESS)
    return "press.toml"


@pytest.mark.versions
def test_more_pressure_of_the_holder_draws_in_less(press, capsys):
    """Numbers in the table are those of the runs; the page has their pictures."""
    assert sweep.main([press, "--vary", "holder.pressure=0.5,0.05", "--", "--no-pictures"]) == 0
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


def test_the_press_of_a_run_has_its_values_and_options(press):
    form = SweepRun(Path(press), ["--nx", "8", "--fibre-angle=45", "--no-pictures"])
    (sheet,) = form.read({"blank.width": "150"}).sheets
    assert (sheet.nx, sheet.fibre_angle, sheet.width) == (8, 45, 150)
    with pytest.raises(InputError, match="width is 0; allowed is"):
        form.read({"blank.width": "0"})
