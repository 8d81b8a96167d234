"""Measures that a finer mesh, another numbering or more ranks must not change."""

import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.results import measures
from fabric_fenicsx.sheets.blank import Blank

COMM = MPI.COMM_WORLD
KINDS = [("graded", "triangle"), ("unstructured", "quadrilateral")]


def sheet(pattern="crossed", cell="triangle", nx=24, hole=0.0, **options):
    """A 200 x 50 mm sheet on all ranks, without the cells nearer than `hole` to its middle."""
    arrays = None, None, None
    if COMM.rank == 0:
        x, cells, kind = specimen(nx=nx, ny=nx // 4, pattern=pattern, cell=cell)
        kept = np.linalg.norm(x[cells].mean(1) - [100, 25, 0], axis=1) >= hole
        arrays = x, cells[kept], kind
    return Blank.from_arrays(COMM, *arrays, **options)


@pytest.mark.mpi
@pytest.mark.parametrize("pattern, cell", KINDS)
def test_a_hole_is_seen(pattern, cell):
    whole, holed = sheet(pattern, cell), sheet(pattern, cell, hole=9.0)
    assert measures.covers(whole, (100, 25)) and not measures.covers(holed, (100, 25))
    for blank in (whole, holed):  # nodes, edges, corners of the sheet, and what lies beside it
        assert all(measures.covers(blank, p) for p in ((0, 0), (200, 50), (50, 25), (37.1, 12.7)))
        assert not any(measures.covers(blank, p) for p in ((-0.1, 25), (200.1, 25), (100, 50.1)))


@pytest.mark.mpi
def test_means_and_quantiles_are_those_of_the_area():
    values = {}
    for pattern, nx in (("crossed", 48), ("graded", 48), ("unstructured", 60)):
        blank = sheet(pattern, nx=nx)
        x, area = blank.midpoints()[0], blank.areas()
        assert measures.mean(COMM, x, area) == pytest.approx(
            100, rel=1e-9 if pattern != "unstructured" else 1e-3
        )
        values[pattern] = measures.quantiles(COMM, x, area, (0.1, 0.5, 0.9))
        assert values[pattern] == pytest.approx([20, 100, 180], abs=2.5)
        assert measures.bulk(COMM, x, area) == pytest.approx([2, 198], abs=1.5)
    assert measures.mean(COMM, x, 0 * area) is None


@pytest.mark.mpi
def test_of_values_that_differ_by_rounding_the_first_row_is_told():
    """Whichever ranks have them, and if some have none."""
    mine = np.arange(COMM.rank, 4, COMM.size)
    values = np.array([5.0, 7.0, 7.0 * (1 + 1e-9), 6.0])[mine]
    rows = np.array([[0.0, 1], [2, 0], [2, 1], [1, 1]])[mine]
    largest, row = measures.where_largest(COMM, values, rows)
    assert largest == 7.0 * (1 + 1e-9) and row == [2, 0]
    assert measures.where_largest(COMM, -values, rows) == (-5, [0, 1])
