"""Where points of a sheet lie over another one, and how the faces are lagged, without any law."""

import numpy as np
import pytest
from builders import COMM
from builders import sheet as rectangle

import fabric_fenicsx as ff
from fabric_fenicsx.mechanics.contact.lagged_faces import LaggedFaces
from fabric_fenicsx.mechanics.contact.sheet_points import SheetPoints

T = 1.0


@pytest.fixture
def points():
    """Of two flat sheets, the upper one of smaller cells."""
    sheets = [
        (rectangle(20, 10, n, n // 2, spatial=True), T, name) for n, name in ((4, "a"), (6, "b"))
    ]
    stack = ff.Stack(sheets)
    return SheetPoints(stack.part("a"), stack.part("b"), 3, (T, T), (0.0, 0.0), [])


def lift(points, by):
    """Move the upper sheet up, by a function of places (n, 3)."""
    blank = points.blank
    x = blank.coordinates()
    blank.u.x.array.reshape(-1, 3)[:, 2] = np.where(x[:, 2] > T / 2, by(x), 0.0)


@pytest.mark.mpi
def test_points_stand_for_the_area_of_the_sheet_of_smaller_cells(points):
    assert points.part.name == "b" and points.side == 1
    assert COMM.allreduce(points.areas.sum()) == pytest.approx(200)
    pairs = points.pairs()
    assert COMM.allreduce(len(pairs.gap)) == COMM.allreduce(points.count)
    assert abs(pairs.gap).max(initial=0) < 1e-12


def test_a_step_begins_with_the_faces_of_its_prediction(points):
    """Over the areas of the last accepted state, until a solution is found."""
    faces = LaggedFaces(points, 0.01, 3 * points.nodes.count)
    start = faces.now
    points.blank.u.x.array.reshape(-1, 3)[:] = 0.1 * points.blank.coordinates()
    faces.on_prediction()
    assert faces.now.relative == pytest.approx(points.pairs().relative)
    assert np.array_equal(faces.now.areas, start.areas)
    faces.restore()
    assert faces.now is start


@pytest.mark.mpi
def test_faces_are_taken_anew_only_if_forces_change(points):
    faces = LaggedFaces(points, 0.01, 3 * points.nodes.count)
    start = faces.now

    def forces(pairs):
        return points.of_all(pairs, pairs.normal)

    def tilt(slope):
        z = points.blank.u.x.array.reshape(-1, 3)[:, 2]
        z[:] = slope * points.blank.coordinates()[:, 0]

    tilt(1e-3)  # turns normals by 0.1 %
    assert not faces.update(forces) and faces.now is start
    tilt(0.05)
    assert faces.update(forces) and faces.now is not start
    faces.restore()
    assert faces.now is start is faces.accepted
    faces.accept()
    assert faces.accepted is points.pairs()
