"""Pictures: what is drawn of a sheet is the sheet."""

import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.material.presets import load
from fabric_fenicsx.mechanics.shell.membrane import Membrane
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.plot import pictures
from fabric_fenicsx.postprocess.states import read_state
from fabric_fenicsx.results.fields import FieldSeries
from fabric_fenicsx.scene import output as reports
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.sheets.blank import Blank

pytestmark = pytest.mark.versions


@pytest.mark.parametrize("element", ["P1", "P2", "P3", "Q1", "Q2"])
def test_polygons_cover_the_deformed_sheet(tmp_path, element):
    cell = "triangle" if element[0] == "P" else "quadrilateral"
    arrays = specimen(60.0, 40.0, 6, 4, cell=cell)
    blank = Blank.from_arrays(MPI.COMM_SELF, *arrays, degree=int(element[1]))
    x, stretch = blank.coordinates()[:, :2], np.array([[0.1, 0.05], [0.0, -0.02]])
    blank.u.x.array[:] = (x @ stretch.T).ravel()
    FieldSeries(tmp_path, Scene(blank, [Membrane(load("komeili"))])).write(1.0)
    x, y = np.moveaxis(pictures.cell_polygons(read_state(tmp_path)), -1, 0)
    areas = (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(1) / 2
    assert len(areas) == blank.mesh.topology.index_map(2).size_local
    assert abs(areas) == pytest.approx(
        2400 * np.linalg.det(np.eye(2) + stretch) / len(areas), rel=1e-9
    )


def test_maps_show_signed_values_and_their_extremes(tmp_path, monkeypatch):
    blank = Blank.from_arrays(MPI.COMM_SELF, *specimen(60.0, 40.0, 6, 4))
    scene = Scene(blank, [Membrane(load("komeili"))])
    x, y = blank.coordinates()[:, :2].T
    blank.u.x.array[:] = np.column_stack([-0.1 * y - 0.001 * x * y, 0 * x]).ravel()
    fields = reports.cell_fields(scene)
    FieldSeries(tmp_path, scene).write(1.0, fields)
    drawn = []
    monkeypatch.setattr(pictures.plt, "close", drawn.append)
    grid = read_state(tmp_path)
    pictures.maps(tmp_path / "one.png", {"one": grid}, ("log_eps_22", "shear_angle"), outliers=0.1)
    pictures.maps(tmp_path / "two.png", {"one": grid, "two": grid}, ("shear_angle",))
    gamma = np.degrees(fields["shear_angle"])
    assert gamma.max() < -5
    said = f"cells: {gamma.min():.4g} to {gamma.max():.4g}"
    (_, shear, *bars), (first, second, *_) = (
        figure.axes for figure in drawn if hasattr(figure, "axes")
    )
    assert shear.get_title() == said
    assert first.get_title() == f"one\n{said}"
    assert second.get_title() == f"two\n{said}"
    # without indices, which beside axes x and y would be theirs
    labels = [" ".join(bar.get_ylabel().split()) for bar in bars]
    assert labels == ["log strain along yarns b / %", "shear angle / deg"]
    for ax in (shear, first):
        (cells,) = ax.collections
        low, high = cells.get_clim()
        assert low == -high and cells.get_cmap().name == "coolwarm"
        assert np.asarray(cells.get_array()) == pytest.approx(gamma, abs=1e-4)
