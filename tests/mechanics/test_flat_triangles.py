"""Contact, bending and metal take a quadratic cell as the four flat triangles between its nodes."""

import numpy as np
import pytest
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx import Bending, Blank
from fabric_fenicsx.mechanics.contact.faces import Face
from fabric_fenicsx.mechanics.contact.nodes import Nodes
from fabric_fenicsx.mechanics.shell.metal import SheetMetal
from fabric_fenicsx.meshes.specimen import specimen
from tests.builders import alone

KOMEILI = ff.load("komeili")


def sheets(comm=MPI.COMM_SELF):
    """A quadratic sheet, and the linear one of the same nodes."""
    arrays = specimen(40.0, 30.0, 4, 3, "unstructured")
    options = {"spatial": True, "a": 0.3, "b": 1.7}
    fine = Blank.from_arrays(comm, *arrays, degree=2, **options)
    coarse = fine.coordinates()[:, :2], fine.triangles().reshape(-1, 3), "triangle"
    return fine, Blank.from_arrays(comm, *coarse, **options)


def bend(blank):
    x, y, _ = blank.coordinates().T
    w = np.column_stack([0.01 * x * y, -0.02 * x, 2 * np.sin(x / 15) + 0.002 * x * y])
    blank.u.x.array[:] = w.ravel()


def by_place(blank, values):
    """Rows (nodes, k) in an order of places."""
    return values[np.lexsort(blank.coordinates().round(6).T)]


@pytest.mark.parametrize(
    "make", [lambda: Bending(2.0, D_t=1.0), lambda: SheetMetal(ff.load_metal("dc04"))]
)
def test_bending_is_that_of_the_linear_sheet(make):
    found = []
    for blank in sheets():
        term = alone(blank, make())
        bend(blank)
        f = np.zeros(len(blank.u.x.array))
        term.add_forces(f)
        found.append((term.stored(), by_place(blank, f.reshape(-1, 3))))
    (energy, forces), (linear, others) = found
    assert energy == pytest.approx(linear, rel=1e-10)
    assert forces == pytest.approx(others, abs=1e-9 * abs(others).max())


def test_areas_at_nodes_are_those_of_the_linear_sheet():
    quadratic, linear = ([by_place(b, Nodes(b).areas[:, None])] for b in sheets())
    assert np.array(quadratic) == pytest.approx(np.array(linear), rel=1e-12)


def test_the_smooth_face_is_that_of_the_linear_sheet():
    found = []
    points = np.column_stack(
        [*(np.random.default_rng(1).uniform(8, 22, (2, 50))), np.full(50, 3.0)]
    )
    for blank in sheets():
        bend(blank)
        found.append(Face(blank.whole, 1.0, []).below(points, np.full(50, -1), 10.0).gap)
    assert found[0] == pytest.approx(found[1], abs=1e-10)


def test_metal_remembers_strains_in_triangles():
    blank, _ = sheets()
    metal = alone(blank, SheetMetal(ff.load_metal("dc04")))
    bend(blank)
    metal.accept()
    kept, before = metal.cell_memory(), metal.stored()
    assert kept["plastic"].max() > 0 and len(kept["plastic"]) == len(blank.areas())
    again = alone(blank, SheetMetal(ff.load_metal("dc04")))
    again.recall(kept)
    assert again.stored() == pytest.approx(before, rel=1e-12)
