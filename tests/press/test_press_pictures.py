"""Pictures of a press: what can be seen in them."""

from types import SimpleNamespace

import builders
import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.press import pictures
from fabric_fenicsx.results import forming_pictures, report, space
from fabric_fenicsx.results.fields import FieldSeries
from fabric_fenicsx.results.states import states

QUARTER = [ff.Support(f"x{i} = 0", lambda x, i=i: x[i] < 1e-6, (i,)) for i in (0, 1)]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A folder with two states of a ply that is lifted over a ball that rises to a plate."""
    folder = tmp_path_factory.mktemp("run")
    sheet = builders.sheet(60, 40, 6, 4, comm=MPI.COMM_SELF, spatial=True, a=0.0)
    bodies = [ff.Tool(ff.Sphere(15.0, centre=(0, 0, -16)), path=(0, 0, 10), name="ball")]
    bodies.append(ff.Tool(ff.Plane((0, 0, 12), (0, 0, -1)), name="lid"))
    with builders.compiled_as_it_stands():  # and never run
        scene = ff.Scene(
            sheet, [ff.Membrane(ff.load("komeili")), *map(ff.Contact, bodies)], QUARTER
        )
    series, x = FieldSeries(folder, scene), sheet.coordinates()
    for at in (0.0, 0.8):
        u = np.zeros_like(x)
        u[:, 2] = 10 * at * np.exp(-(x[:, 0] ** 2 + x[:, 1] ** 2) / 400)
        sheet.u.x.array[:] = u.ravel()
        for tool in bodies:
            tool.at(at)
        series.write(at)
    return folder


@pytest.mark.versions
def test_the_setup_shows_each_tool_in_its_colour(tmp_path, run, capfd):
    """In what is drawn in space, as pixels in its hue."""
    path, first = tmp_path / "setup.png", states(run)[0]
    pictures.setup_picture(path, first.plies(), first.tools(), {"lid": (0, 0, -9)})
    assert capfd.readouterr().err == ""
    image = matplotlib.image.imread(path)[..., :3]
    assert image.shape[:2] == (1200, 1600)
    grey = image[80:720] - image[80:720].mean(2, keepdims=True)
    size, found = np.linalg.norm(grey, axis=2), []
    for colour in pictures.TOOLS[:3]:
        hue = np.array(to_rgb(colour)) - np.mean(to_rgb(colour))
        alike = grey @ hue > 0.97 * size * np.linalg.norm(hue)
        found.append(int((alike & (size > 0.05)).sum()))
    assert found[0] > 2000 and found[1] > 100000 and found[2] < 1000


def test_tools_of_a_quarter_are_mirrored(run):
    state = states(run)[-1]
    plies = {n: space.surface_of(grid) for n, grid in state.plies().items()}
    scene = pictures._scene(plies, state.tools())
    assert scene.plies[""].bounds[:4] == pytest.approx((-60, 60, -40, 40))
    low, high = np.reshape(scene.tools["ball"].bounds, (3, 2)).T
    assert low[:2] == pytest.approx(-high[:2]) and high[2] == pytest.approx(7, abs=0.1)
    assert scene.tools["lid"].n_open_edges == 4 * round(scene.tools["lid"].n_open_edges / 4)


def test_the_legend_tells_how_far_a_tool_moves():
    scene = SimpleNamespace(tools={"lid": None, "die": None}, above={"lid": True, "die": False})
    handles = pictures._legend(scene, {"lid": np.array([3.0, 0, -4])})
    assert [each.get_label() for each in handles] == ["blank", "lid, moves 5 mm", "die"]


@pytest.mark.mpi
def test_all_ranks_know_the_whole_blank():
    (grid,) = pictures.flat_grids(builders.sheet(60, 40, 6, 4, spatial=True)).values()
    assert grid.area == pytest.approx(2400) and not grid["u"].any()


def test_a_run_draws_what_the_report_names(run):
    forming_pictures.draw_plies(run, states(run)[-1].plies(), "ball")
    drawn = {file.stem for file in run.glob("*.png")}
    assert {"formed", "states"} <= drawn <= set(report.CAPTIONS) - {"shortening"}
