"""Measures that a finer mesh, another numbering or more ranks must not change."""

import numpy as np
import pytest
from builders import COMM

import fabric_fenicsx as ff
from fabric_fenicsx.results import measures
from fabric_fenicsx.sheet.specimen import specimen


@pytest.mark.mpi
@pytest.mark.parametrize(
    "pattern, cell", [("graded", "triangle"), ("unstructured", "quadrilateral")]
)
def test_a_hole_is_seen(pattern, cell):
    """Of a sheet of 200 x 50 mm without the cells nearer than 9 mm to its middle."""

    def sheet(hole):
        x, cells, kind = specimen(nx=24, ny=6, pattern="unstructured", cell=cell)
        cells = cells[np.linalg.norm(x[cells].mean(1) - [100, 25, 0], axis=1) >= hole]
        return ff.Blank.from_arrays(COMM, *((x, cells, kind) if COMM.rank == 0 else 3 * (None,)))

    whole, holed = sheet(0.0), sheet(9.0)
    assert measures.covers(whole, (100, 25)) and not measures.covers(holed, (100, 25))
    for blank in (whole, holed):  # nodes, edges, corners of the sheet, and what lies beside it
        places = (0, 0), (200, 50), (50, 25), *np.random.default_rng(0).uniform(1, 15, (20, 2))
        assert all(measures.covers(blank, p) for p in places)
        assert not any(measures.covers(blank, p) for p in ((-0.1, 25), (200.1, 25), (100, 50.1)))


@pytest.mark.mpi
def test_means_and_quantiles_are_by_weight():
    """Each value in the middle of its weight: at 1, 3, 5.5 and 7.5 of 8; an exact linear sample."""
    mine = np.arange(COMM.rank, 4, COMM.size)
    values, weights = np.array([[3.0, 1, 7, 2], [3, 2, 1, 2]])[:, mine]
    assert measures.mean(COMM, values, weights) == 22 / 8
    assert measures.mean(COMM, values, 0 * weights) is None
    found = measures.quantiles(COMM, values, weights, (0.1, 0.25, 0.5, 0.75, 0.99))
    assert found == pytest.approx([1, 1.5, 2.4, 4, 7])
    assert measures.extremes(COMM, values) == (1, 7)
    sample = np.arange(COMM.rank, 100, COMM.size) + 0.5
    assert measures.bulk(COMM, sample, 0 * sample + 2) == pytest.approx([1, 99])


def test_places_near_a_point_are_within_the_radius_or_the_nearest():
    places = np.array([[3.0, 0, 0, -5.1], [0, 4.9, 5.1, 0], [9, 9, 9, 9]])
    assert measures.near(COMM, places, (0, 0), 5.0).tolist() == [True, True, False, False]
    assert measures.near(COMM, places, (0, 20), 5.0).tolist() == [False, False, True, False]


@pytest.mark.mpi
def test_of_values_that_differ_by_rounding_the_first_row_is_told():
    """Whichever ranks have them, and if some have none."""
    mine = np.arange(COMM.rank, 4, COMM.size)
    values = np.array([5.0, 7.0, 7.0 * (1 + 1e-9), 6.0])[mine]
    rows = np.array([[0.0, 1], [2, 0], [2, 1], [1, 1]])[mine]
    largest, row = measures.where_largest(COMM, values, rows)
    assert largest == 7.0 * (1 + 1e-9) and row == [2, 0]
    values[mine == 1] = 7.0 * (1 - 2e-6)  # no rounding
    assert measures.where_largest(COMM, values, rows)[1] == [2, 1]
    assert measures.where_largest(COMM, -values, rows) == (-5, [0, 1])
