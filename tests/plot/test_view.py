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

from fabric_fenicsx.command_line import main
from fabric_fenicsx.plot import view
from fabric_fenicsx.plot.space import drawing
from fabric_fenicsx.postprocess import states as written
from fabric_fenicsx.postprocess.ply import SYMMETRIC
from fabric_fenicsx.postprocess.states import save
from fabric_fenicsx.runtime.errors import InputError

LISTED = '<VTKFile type="Collection"><Collection>{}</Collection></VTKFile>'


def quarter(height):
    """A quarter of a ply, 20 x 10 mm, bent up to `height`, with its shear angle [rad]."""
    grid = pyvista.Plane(center=(10, 5, 0), i_size=20, j_size=10, i_resolution=4, j_resolution=2)
    grid = grid.triangulate().cast_to_unstructured_grid()
    grid.clear_data()
    grid.field_data[SYMMETRIC] = [0, 1]
    grid.point_data["u"] = np.outer(grid.points[:, 0] ** 2 / 400, [0, 0, height])
    grid.cell_data["shear_angle"] = np.linspace(-0.1 * height, 0.05, grid.n_cells)
    grid.cell_data["thickness_under_pressure"] = np.full(grid.n_cells, 0.3)
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
    text = view.page(run)
    assert f"<title>{run.name}</title>" in text
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=.?https?:", text)
    (data,) = re.findall(r'base64Str = "(.*?)"', text)
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(data))) as file:
        scene = json.loads(file.read("index.json"))
    kinds = re.findall(r'"type": "(vtk\w+)"', json.dumps(scene["scene"]))
    assert kinds.count("vtkMapper") >= 2 and "vtkScalarBarActor" in kinds
    assert len(scene["hashes"]) > 4 and all(each["content"] for each in scene["hashes"].values())


@pytest.mark.versions
def test_another_state_takes_the_place_of_the_one_shown(run):
    first, last = written.states(run)
    with drawing() as plotter:
        update = view._draw(plotter, run, last, None)
        before, count = plotter.bounds, len(plotter.actors)
        assert before[:4] == pytest.approx((-20, 20, -10, 10)) and before[5] == pytest.approx(5)
        update(first)
        assert plotter.bounds[5] == pytest.approx(1) and len(plotter.actors) == count


@pytest.mark.parametrize(
    "field, least, largest", [(None, 0.0, np.degrees(0.5)), ("thickness_under_pressure", 0.3, 0.3)]
)
def test_colours_are_those_of_the_last_state(run, field, least, largest):
    with drawing() as plotter:
        with pytest.raises(InputError, match=r"field shear is unknown \(did you mean shear_angle"):
            view._draw(plotter, run, written.states(run)[-1], "shear")
        view._draw(plotter, run, written.states(run)[-1], field)
        mapper = plotter.actors["ply "].GetMapper()
        assert mapper.GetScalarRange() == pytest.approx((least, largest), abs=1e-6)


def test_without_its_package_there_is_no_page(run, monkeypatch, capsys):
    for name in ("trame_vtk", "trame_vtk.modules.vtk", "trame_vtk.tools.vtksz2html"):
        monkeypatch.setitem(sys.modules, name, None)
    assert main.main(["view", str(run), "--html", str(run / "page.html")]) == 2
    assert "allowed is `pip install 'fabric_fenicsx[view]'` first" in capsys.readouterr().err
    assert not (run / "page.html").exists()


@pytest.mark.parametrize("words, file", [([], "view.html"), (["--html", "{}/a.html"], "a.html")])
def test_a_page_is_written_without_a_display(run, words, file, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(view, "page", lambda folder, field: f"{folder} {field}")
    assert main.main(["view", str(run), *(word.format(run) for word in words)]) == 0
    assert (run / file).read_text() == f"{run} None"


@pytest.mark.parametrize(
    "words, error",
    [
        ([], "has no fields.pvd"),
        (["--html", "no/where.html"], "no/where.html can't be read or written"),
        (["--colour", "red"], "option --colour is unknown"),
    ],
)
def test_the_command_refuses(run, words, error, capsys):
    folder = run if words else run / "fields"
    assert main.main(["view", str(folder), *words]) == 2
    assert error in capsys.readouterr().err
