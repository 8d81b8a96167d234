"""Pictures of presses, formed plies and coupons."""

from types import SimpleNamespace

import builders
import matplotlib.image
import numpy as np
import pytest
import pyvista
from dome_triangles import double_dome
from formed_plies import formed, halves
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.press import pictures as press_pictures
from fabric_fenicsx.results import pictures, report, space
from fabric_fenicsx.results.fields import FieldSeries
from fabric_fenicsx.results.shape import Path
from fabric_fenicsx.results.states import read_state, states
from fabric_fenicsx.sheet.specimen import specimen
from fabric_fenicsx.surfaces.double_dome import DoubleDome

QUARTER = [ff.Support(f"x{i} = 0", lambda x, i=i: x[i] < 1e-6, (i,)) for i in (0, 1)]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A folder with two states of a ply that is lifted over a ball that rises to a plate."""
    folder = tmp_path_factory.mktemp("run")
    sheet = builders.sheet(60, 40, 6, 4, comm=MPI.COMM_SELF, spatial=True, a=0.0)
    bodies = [ff.Tool(ff.Sphere(15.0, centre=(0, 0, -16)), path=(0, 0, 10), name="ball")]
    bodies.append(ff.Tool(ff.Plane((0, 0, 12), (0, 0, -1)), name="lid"))
    with builders.compiled_as_it_stands():  # and never run
        terms = [ff.Membrane(ff.load("komeili")), *map(ff.Contact, bodies)]
        scene = ff.Scene(sheet, terms, QUARTER)
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
    press_pictures.setup_picture(path, first.plies(), first.tools(), {"lid": (0, 0, -9)})
    assert capfd.readouterr().err == ""
    image = matplotlib.image.imread(path)[..., :3]
    assert image.shape[:2] == (1200, 1600)
    grey = image[80:720] - image[80:720].mean(2, keepdims=True)
    size, found = np.linalg.norm(grey, axis=2), []
    for colour in press_pictures.TOOLS[:3]:
        hue = np.array(to_rgb(colour)) - np.mean(to_rgb(colour))
        alike = grey @ hue > 0.97 * size * np.linalg.norm(hue)
        found.append(int((alike & (size > 0.05)).sum()))
    assert found[0] > 2000 and found[1] > 100000 and found[2] < 1000


def test_tools_of_a_quarter_are_mirrored(run):
    state = states(run)[-1]
    plies = [space.surface_of(grid) for grid in state.plies().values()]
    scene = press_pictures._scene(plies, state.tools(), {})
    assert scene.plies[0].bounds[:4] == pytest.approx((-60, 60, -40, 40))
    (ball, _, above, _), (lid, *_) = scene.tools.values()
    low, high = np.reshape(ball.bounds, (3, 2)).T
    assert low[:2] == pytest.approx(-high[:2]) and high[2] == pytest.approx(7, abs=0.1)
    assert not above and lid.n_open_edges == 4 * round(lid.n_open_edges / 4)


@pytest.mark.mpi
def test_all_ranks_know_the_whole_blank():
    (grid,) = press_pictures.flat_grids(builders.sheet(60, 40, 6, 4, spatial=True), {}).values()
    assert grid.area == pytest.approx(2400) and not grid["u"].any()


def test_a_run_draws_what_the_report_names(run):
    pictures.draw_plies(run, states(run)[-1].plies(), "ball")
    drawn = {file.stem for file in run.glob("*.png")}
    assert {"formed", "states"} <= drawn <= set(report.CAPTIONS) - {"shortening"}


def test_pictures_of_a_formed_ply(tmp_path, capfd, monkeypatch):
    draped = lambda x, y: DoubleDome().lift(x, y) + [0, 0, 0.5]  # noqa: E731
    grid = formed(draped, angle=np.radians(45), ranks=2)
    grid["shear_angle"][7] = -0.9
    files = [tmp_path / f"{name}.png" for name in ("states", "formed")]
    drawn, save = [], Figure.savefig
    noted = lambda figure, *given, **more: drawn.append(figure) or save(figure, *given, **more)  # noqa: E731
    monkeypatch.setattr(Figure, "savefig", noted)
    pictures.state_map(files[0], grid, formed=True)
    tool = pyvista.PolyData.from_regular_faces(*double_dome())
    space.formed_picture(files[1], [grid], tool)
    images = [matplotlib.image.imread(file)[..., :3] for file in files]
    assert min(image.std() for image in images) > 0.05 and images[1].shape[:2] == (1000, 1600)
    assert "largest of a cell: 51.57)" in drawn[1].axes[1].get_xlabel()
    assert capfd.readouterr().err == ""


@pytest.fixture
def drawn(monkeypatch):
    """Axes of each picture, in the order in which they are written."""
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: figures.append(figure.axes))
    return figures


def test_paths_are_drawn_in_per_cent_and_degrees_with_marks_that_lie_on_them(tmp_path, drawn):
    distance = np.array([0.0, 10, 20])
    path = Path(distance, 2 * distance, 0.01 * distance, -0.001 * distance, distance / 2, None)
    marks = {"edge": [15.0, 25.0], "none": [np.nan, np.nan]}
    pictures.paths_picture(tmp_path / "p.png", {"run": {0: path, 90: path}}, marks)
    for axes, mark in ((drawn[0][:3], [15.0]), (drawn[0][3:], [])):
        for ax, values in zip(axes, ([0, 10, 20], [0, -1, -2], [0, 5, 10])):
            curve, *vertical, zero = ax.lines
            assert list(curve.get_xdata()) == [0, 10, 20]
            assert list(curve.get_ydata()) == pytest.approx(values)
            assert [line.get_xdata()[0] for line in vertical] == mark


@pytest.mark.parametrize("element", ["P1", "P3", "Q2"])
@pytest.mark.versions
def test_polygons_cover_the_deformed_sheet(tmp_path, element):
    cell = "triangle" if element[0] == "P" else "quadrilateral"
    arrays = specimen(60.0, 40.0, 6, 4, cell=cell)
    blank = ff.Blank.from_arrays(MPI.COMM_SELF, *arrays, degree=int(element[1]))
    x, stretch = blank.coordinates()[:, :2], np.array([[0.1, 0.05], [0.0, -0.02]])
    blank.u.x.array[:] = (x @ stretch.T).ravel()
    FieldSeries(tmp_path, ff.Scene(blank, [ff.Membrane(ff.load("komeili"))])).write(1.0)
    x, y = np.moveaxis(pictures.cell_polygons(read_state(tmp_path)), -1, 0)
    areas = (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(1) / 2
    assert len(areas) == blank.mesh.topology.index_map(2).size_local
    share = np.linalg.det(np.eye(2) + stretch) / len(areas)
    assert abs(areas) == pytest.approx(2400 * share, rel=1e-9)


@pytest.mark.versions
def test_scales_cover_what_they_show():
    assert pictures.colour_scale("coolwarm", -2.0, 5.0) == ("coolwarm", -5.0, 5.0)
    assert pictures.colour_scale("coolwarm", -5.0, 2.0) == ("coolwarm", -5.0, 5.0)
    assert pictures.colour_scale("viridis", 1.0, 1.0) == ("viridis", 0.5, 1.5)
    ends = {(0, 10): "neither", (1, 10): "min", (0, 9): "max", (1, 9): "both"}
    assert all(pictures.arrows(np.array([0.0, 10]), *key) == end for key, end in ends.items())
    assert [space.round_length(about) for about in (1.5, 12.0, 3.0)] == [2, 10, 2]
    limits = [space.shear_limit([{"shear_angle": np.array([x, 1])}]) for x in (12.1, 15, 2)]
    assert limits == [15, 15, 5]
    first = lambda *holds: pictures._first(np.arange(4.0), np.array(holds))  # noqa: E731
    assert first(1, 0, 1, 1) == 2 and first(0, 1, 1, 1) == 1 and np.isnan(first(1, 0, 0, 0))


@pytest.mark.versions
def test_maps_of_several_sheets_share_a_scale(tmp_path, drawn):
    """Of cells with 0, 10, 20 and 40 % without a quarter at either end: 7.5 to 25 %; angles keep
    their sign."""
    a = halves(log_eps_11=[0.4, 0.1], shear_angle=[-0.4, -0.1])
    b = halves(log_eps_11=[0.0, 0.2], shear_angle=[0.0, 0.2])
    fields = ["log_eps_11", "shear_angle"]
    pictures.maps(tmp_path / "maps.png", {"a": a, "b": b}, fields, outliers=0.25)
    pictures.maps(tmp_path / "one.png", {"a": a}, fields[1:])
    ((first, signed, second, *bars), (alone, _)) = drawn
    assert first.get_title() == "a\ncells: 10 to 40" and second.get_title() == "b\ncells: 0 to 20"
    assert alone.get_title() == "cells: -22.92 to -5.73"
    # without indices, which beside axes x and y would be theirs
    labels = [" ".join(bar.get_ylabel().split() or bar.get_xlabel().split()) for bar in bars[1:]]
    assert labels == ["log strain along yarns a / %", "shear angle / deg"]
    for ax, limits, values in (
        (first, (7.5, 25.0), [40, 10]),
        (signed, np.degrees((-0.175, 0.175)), np.degrees([-0.4, -0.1])),
        (alone, np.degrees((-0.4, 0.4)), np.degrees([-0.4, -0.1])),
    ):
        assert ax.collections[0].get_clim() == pytest.approx(limits)
        assert list(ax.collections[0].get_array()) == pytest.approx(values)


@pytest.mark.versions
def test_a_band_is_as_high_as_the_errors(tmp_path, drawn):
    run = [{"displacement_mm": x, "reaction_N": 2 + 2 * x, "error_N": 0.5 + x} for x in (0, 1)]
    other = [run[0] | {"error_N": None}]
    results = {name: SimpleNamespace(rows=rows) for name, rows in (("run", run), ("other", other))}
    pictures.reactions(tmp_path / "curve.png", results)
    ((ax,),) = drawn
    assert [list(line.get_ydata()) for line in ax.lines] == [[2, 4], [2]]
    (band,) = ax.collections
    places = {tuple(p) for p in band.get_paths()[0].vertices}
    assert places == {(0, 1.5), (0, 2.5), (1, 2.5), (1, 5.5)}


@pytest.mark.versions
def test_shares_of_strain_states_are_of_the_area(tmp_path, drawn):
    grid = halves(strain_state=[1, 4], shear_angle=[0.1, -0.5])
    pictures.state_map(tmp_path / "states.png", grid)
    texts = [text.get_text() for text in drawn[0][0].get_legend().get_texts()]
    assert texts[0] == "both in tension: 75%" and texts[3] == "both in compression: 25%"
    assert list(drawn[0][1].collections[0].get_array()) == pytest.approx(np.degrees([0.1, -0.5]))
    surface = space.surface_of(grid)  # means by area of the magnitude
    at = {tuple(p): v for p, v in zip(surface["place"][:, :2], surface["shear_angle"])}
    angles = {(0, 0): 0.2, (4, 0): 0.1, (4, 3): 0.2, (0, 1): 0.5}
    assert at == pytest.approx({place: np.degrees(angle) for place, angle in angles.items()})
