"""Pictures: what is drawn of a sheet is the sheet."""

import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.blank import Blank
from fabric_fenicsx.material.presets import load
from fabric_fenicsx.mechanics.membrane import Membrane
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.results import pictures
from fabric_fenicsx.results.fields import FieldSeries, cell_fields, read_last


@pytest.mark.parametrize("element", ["P1", "P2", "P3", "Q1", "Q2"])
def test_polygons_cover_the_deformed_sheet(tmp_path, element):
    cell = "triangle" if element[0] == "P" else "quadrilateral"
    arrays = specimen(60.0, 40.0, 6, 4, cell=cell)
    blank = Blank.from_arrays(MPI.COMM_SELF, *arrays, degree=int(element[1]))
    x, stretch = blank.coordinates()[:, :2], np.array([[0.1, 0.05], [0.0, -0.02]])
    blank.u.x.array[:] = (x @ stretch.T).ravel()
    membrane = Membrane(blank, load("komeili"))
    FieldSeries(tmp_path, membrane).write(1.0, cell_fields(membrane)[0])
    x, y = np.moveaxis(pictures._polygons(read_last(tmp_path)), -1, 0)
    areas = (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(1) / 2
    assert len(areas) == blank.mesh.topology.index_map(2).size_local
    assert abs(areas) == pytest.approx(2400 * np.linalg.det(np.eye(2) + stretch) / len(areas), rel=1e-9)
