"""Contact, bending and metal take a quadratic cell as the four flat triangles between its nodes."""

import numpy as np
import pytest
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.sheet.specimen import specimen
from tests.builders import alone, nodal_forces


@pytest.mark.parametrize(
    "make", [lambda: ff.Bending(2.0, D_t=1.0), lambda: ff.SheetMetal(ff.load_metal("dc04"))]
)
def test_bending_is_that_of_the_linear_sheet(make):
    """Of the same nodes."""
    found, options = [], {"spatial": True, "a": 0.3, "b": 1.7}
    arrays = specimen(40.0, 30.0, 4, 3, "unstructured")
    fine = ff.Blank.from_arrays(MPI.COMM_SELF, *arrays, degree=2, **options)
    coarse = fine.coordinates()[:, :2], fine.triangles().reshape(-1, 3), "triangle"
    for blank in (fine, ff.Blank.from_arrays(MPI.COMM_SELF, *coarse, **options)):
        term, (x, y, _) = alone(blank, make()), blank.coordinates().T
        w = np.column_stack([0.01 * x * y, -0.02 * x, 2 * np.sin(x / 15) + 0.002 * x * y])
        blank.u.x.array[:] = w.ravel()
        places = np.lexsort(blank.coordinates().round(6).T)
        found.append((term.stored(), nodal_forces(term)[places]))
    (energy, forces), (linear, others) = found
    assert energy == pytest.approx(linear, rel=1e-10)
    assert forces == pytest.approx(others, abs=1e-9 * abs(others).max())
