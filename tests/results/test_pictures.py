"""Pictures: what is drawn of a sheet is the sheet."""

from types import SimpleNamespace

import numpy as np
import pytest
from formed_plies import halves
from matplotlib.figure import Figure
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.results import forming_pictures, pictures, space
from fabric_fenicsx.results.fields import FieldSeries
from fabric_fenicsx.results.states import read_state
from fabric_fenicsx.sheet.specimen import specimen

pytestmark = pytest.mark.versions


@pytest.mark.parametrize("element", ["P1", "P3", "Q2"])
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


@pytest.fixture
def drawn(monkeypatch):
    """Axes of each picture, in the order in which they are written."""
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: figures.append(figure.axes))
    return figures


def test_scales_cover_what_they_show():
    assert pictures.colour_scale("coolwarm", -2.0, 5.0) == ("coolwarm", -5.0, 5.0)
    assert pictures.colour_scale("coolwarm", -5.0, 2.0) == ("coolwarm", -5.0, 5.0)
    assert pictures.colour_scale("viridis", 1.0, 1.0) == ("viridis", 0.5, 1.5)
    ends = {(0, 10): "neither", (1, 10): "min", (0, 9): "max", (1, 9): "both"}
    assert all(pictures.arrows(np.array([0.0, 10]), *key) == end for key, end in ends.items())
    assert [space.round_length(about) for about in (1.5, 12.0, 3.0)] == [2, 10, 2]
    limits = [space.shear_limit([{"shear_angle": np.array([x, 1])}]) for x in (12.1, 15, 2)]
    assert limits == [15, 15, 5]
    first = lambda *holds: forming_pictures._first(np.arange(4.0), np.array(holds))  # noqa: E731
    assert first(1, 0, 1, 1) == 2 and first(0, 1, 1, 1) == 1 and np.isnan(first(1, 0, 0, 0))


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


def test_shares_of_strain_states_are_of_the_area(tmp_path, drawn):
    grid = halves(strain_state=[1, 4], shear_angle=[0.1, -0.5])
    forming_pictures.state_map(tmp_path / "states.png", grid)
    texts = [text.get_text() for text in drawn[0][0].get_legend().get_texts()]
    assert texts[0] == "both in tension: 75%" and texts[3] == "both in compression: 25%"
    assert list(drawn[0][1].collections[0].get_array()) == pytest.approx(np.degrees([0.1, -0.5]))
    surface = space.surface_of(grid)  # means by area of the magnitude
    at = {tuple(p): v for p, v in zip(surface["place"][:, :2], surface["shear_angle"])}
    angles = {(0, 0): 0.2, (4, 0): 0.1, (4, 3): 0.2, (0, 1): 0.5}
    assert at == pytest.approx({place: np.degrees(angle) for place, angle in angles.items()})
