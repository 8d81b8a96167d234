"""Formed plies and tools in a window, and as a page for a browser."""

import base64
import io
import json
import re
import sys
import zipfile

import numpy as np
import pytest
import pyvista
from formed_plies import formed

from fabric_fenicsx.cli import main
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.results import space
from fabric_fenicsx.results import states as written
from fabric_fenicsx.results.space import drawing
from fabric_fenicsx.results.states import save

LISTED = '<VTKFile type="Collection"><Collection>{}</Collection></VTKFile>'


def quarter(height):
    """A quarter of a ply, 20 x 10 mm, bent up to `height`, with its shear angle [rad]."""
    grid = formed(lambda x, y: np.column_stack([x, y, height * x**2 / 400]), 4, 2, 20.0, 10.0)
    grid.cell_data["shear_angle"] = np.linspace(-0.1 * height, 0.05, grid.n_cells)
    return grid


@pytest.fixture
def run(tmp_path):
    """The folder of a run with two states and a tool."""
    (tmp_path / "fields").mkdir()
    plies, tools = "", ""
    for k, height in enumerate((1.0, 5.0)):
        save(tmp_path / f"fields/{k}.vtu", quarter(height), {})
        plies += f'<DataSet timestep="{k}" part="0" file="fields/{k}.vtu"/>'
        ball = pyvista.Sphere(radius=3, center=(0, 0, height - 3))
        pyvista.MultiBlock({"ball": ball}).save(tmp_path / f"{k}.vtm")
        tools += f'<DataSet timestep="{k}" part="0" file="{k}.vtm"/>'
    (tmp_path / "fields.pvd").write_text(LISTED.format(plies))
    (tmp_path / "tools.pvd").write_text(LISTED.format(tools))
    return tmp_path


def test_a_page_has_all_in_it(run):
    pytest.importorskip("trame_vtk", reason="what makes the page is not installed")
    text = space.page(run)
    assert f"<title>{run.name}</title>" in text
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=.?https?:", text)
    (data,) = re.findall(r'base64Str = "(.*?)"', text)
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(data))) as file:
        scene = json.loads(file.read("index.json"))
    kinds = re.findall(r'"type": "(vtk\w+)"', json.dumps(scene["scene"]))
    assert kinds.count("vtkMapper") >= 2 and "vtkScalarBarActor" in kinds
    assert len(scene["hashes"]) > 4 and all(each["content"] for each in scene["hashes"].values())


@pytest.mark.versions
def test_another_state_takes_the_place_of_the_one_shown_in_colours_of_the_last(run):
    first, last = written.states(run)
    with drawing() as plotter:
        with pytest.raises(InputError, match=r"field shear is unknown \(did you mean shear_angle"):
            space._draw(plotter, run, last, "shear")
        update = space._draw(plotter, run, last, None)
        before, count = plotter.bounds, len(plotter.actors)
        assert before[:4] == pytest.approx((-20, 20, -10, 10)) and before[5] == pytest.approx(5)
        update(first)
        assert plotter.bounds[5] == pytest.approx(1) and len(plotter.actors) == count
        colours = plotter.actors["ply "].GetMapper().GetScalarRange()
        assert colours == pytest.approx((0, np.degrees(0.5)), abs=1e-6)


def test_the_command_writes_a_page_without_a_display(run, monkeypatch, capsys):
    def told(folder, *words):
        return main.main(["view", str(folder), *words]), capsys.readouterr().err

    assert told(run / "fields")[0] == 2
    with monkeypatch.context() as patch:
        for name in ("trame_vtk", "trame_vtk.modules.vtk", "trame_vtk.tools.vtksz2html"):
            patch.setitem(sys.modules, name, None)
        status, error = told(run, "--html", str(run / "a.html"))
    assert status == 2 and "expected `pip install 'fabric_fenicsx[view]'` first" in error
    assert not (run / "a.html").exists()
    monkeypatch.setenv("DISPLAY", ":77")  # which nobody serves
    monkeypatch.setattr(space, "page", lambda folder, field: f"{folder} {field}")
    for words, file in (((), "view.html"), (("--html", str(run / "a.html")), "a.html")):
        assert told(run, *words)[0] == 0 and (run / file).read_text() == f"{run} None"
        assert f"{file} exists already" in told(run, "--field", "x", *words)[1]
        assert (run / file).read_text() == f"{run} None"
