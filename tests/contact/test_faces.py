"""The smooth face of a sheet of triangles."""

import numpy as np
import pytest
from builders import COMM, near
from builders import sheet as rectangle

from fabric_fenicsx.contact.faces import Face

CURVES = np.array([[0.01, -0.004], [-0.004, 0.006]])  # 1/mm
SIZE = 60.0, 30.0


def height(x):
    """Of a paraboloid over the places x (n, 2), flat along x = 0 and y = 0 but for its twist."""
    return np.einsum("ni,ij,nj->n", x, CURVES, x) / 2


def bent(nx=16, ny=8, comm=COMM, curve=height, pattern="crossed"):
    """A sheet from (-30, -15) to (30, 15), displaced by `curve`."""
    centred = lambda x: x - [30.0, 15.0, 0.0]  # noqa: E731
    blank = rectangle(*SIZE, nx, ny, pattern, comm, spatial=True, shape=centred)
    blank.u.x.array[2::3] = curve(blank.coordinates()[:, :2])
    return blank


def places(n=200, within=(18.0, 7.0)):
    return np.random.default_rng(0).uniform(-1, 1, (n, 2)) * within


def over(face, points, reach=5.0):
    return face.project(points, np.full(len(points), -1), reach)


@pytest.mark.mpi
def test_points_load_all_nodes_by_their_areas():
    """Also beside free edges, but for a few per cent, and exactly further in."""
    blank = bent(curve=lambda x: 0 * x[:, 0])
    face = Face(blank.whole, 1.0, [])
    places = np.full((1, 3), 1 / 3)
    weights = face.own_weights(places)
    points = face.flat(places)
    area = SIZE[0] * SIZE[1] / COMM.allreduce(len(points))
    loads = COMM.allreduce(area * np.asarray(weights.sum(0)).ravel())
    corners = face.triangles[face.own_triangles].ravel()
    flat = COMM.allreduce(area / 3 * np.bincount(corners, minlength=len(face.nodes)))
    off = abs(loads / flat - 1)
    assert off.max() < 0.06
    middle = abs(face.places[:, :2]).max(1) < 1.0
    assert middle.any() and off[middle].max() < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_gap_is_that_along_the_normal(side):
    """To second order of the cells' size; the paraboloid's own normal at that place is met. On it
    the gap is 0 but for about h^4, as what lies below is sought along the normal, not along the
    bulge."""
    x = places()
    slope = np.column_stack([-(x @ CURVES), np.ones(len(x))])
    normal = side * slope / np.linalg.norm(slope, axis=1)[:, None]
    on = np.column_stack([x, height(x)])
    off = []
    for n in (1, 2):
        face = Face(bent(16 * n, 8 * n).whole, side, [])
        there, found = over(face, on), over(face, on + 0.5 * normal)
        assert (there.triangle >= 0).all() and (there.normal[:, 2] * side > 0.9).all()
        errors = there.gap, found.gap - 0.5, found.normal - normal
        off.append([abs(each).max() for each in errors])
    (on, gap, tilt), (finer_on, finer_gap, finer_tilt) = off
    assert on < 1e-5 and finer_on < on / 10
    assert gap < 0.01 and finer_gap < gap / 3.5
    assert tilt < 0.05 and finer_tilt < tilt / 3


def test_gradient_and_turning_of_the_normal():
    """The gradient is that of the gap; its turning that of the normal, but for terms of h^2."""
    blank = bent()
    face, rng = Face(blank.whole, 1.0, []), np.random.default_rng(1)
    x = places()
    points = np.column_stack([x, height(x) + rng.uniform(-0.7, 0.7, len(x))])
    found, h = over(face, points), 1e-5
    for axis in range(3):
        moved = (points + s * h * np.eye(3)[axis] for s in (1, -1))
        ahead, back = (face.project(x, found.triangle, 5.0) for x in moved)
        same = (ahead.triangle == found.triangle) & (back.triangle == found.triangle)
        assert same.sum() > 150
        slope = (ahead.gap - back.gap)[same] / (2 * h)
        assert abs(slope - found.normal[same, axis]).max() < 1e-9
        turn = (ahead.normal - back.normal)[same] / (2 * h)
        assert abs(turn - found.curvature[same, axis]).max() < 0.3 * abs(CURVES).max()
    assert np.array_equal(found.curvature, found.curvature.swapaxes(1, 2))


@pytest.mark.mpi
def test_nothing_jumps_across_edges():
    """A wavy face over cells that are not regular: gap and gradient's direction on both sides."""
    blank = bent(pattern="unstructured", curve=lambda x: np.sin(x[:, 0] / 5) * np.cos(x[:, 1] / 6))
    face = Face(blank.whole, 1.0, [])
    ends = face.triangles[:, [1, 2]]  # edges of all triangles opposite corner 0
    middles, normals = face.places[ends].mean(1), face.normals[ends].mean(1)
    inner = (abs(middles[:, :2]) < [25.0, 12.0]).all(1)
    middles = (middles + 0.3 * normals)[inner]
    along = face.places[ends[inner, 1]] - face.places[ends[inner, 0]]
    across = np.cross(along, normals[inner])
    across *= 1e-5 / np.linalg.norm(across, axis=1)[:, None]
    one, other = (over(face, middles + s * across) for s in (1, -1))
    crossed = one.triangle != other.triangle
    assert crossed.sum() > 50
    assert abs(one.gap - other.gap)[crossed].max() < 2e-6
    ends = ((o.weights, face.normals[face.triangles[o.triangle]]) for o in (one, other))
    normals = [np.einsum("nc,nci->ni", *each)[crossed] for each in ends]
    assert abs(normals[0] - normals[1]).max() < 1e-5


@pytest.mark.mpi
def test_half_a_sheet_with_a_plane_of_symmetry_is_the_whole():
    """Next to the plane x = 0, where the whole one goes on."""

    def curve(x):
        return (x[:, 0] ** 2 * (1 + 0.02 * x[:, 1]) + x[:, 1] ** 2) / 100

    whole = bent(curve=curve)
    half = rectangle(30, 30, 8, 8, spatial=True, shape=lambda x: x - [0.0, 15.0, 0.0])
    X = half.coordinates()
    half.u.x.array[2::3] = curve(X[:, :2])
    x = places(within=(4.0, 7.0))
    x[:, 0] = abs(x[:, 0])
    points = np.column_stack([x, curve(x) + 0.5])
    on_plane = near(0, 0.0)
    faces = (whole, []), (half, [on_plane]), (half, [])
    one, other, without = (over(Face(b.whole, 1.0, planes), points) for b, planes in faces)
    for name in ("gap", "normal", "curvature"):
        assert getattr(other, name) == pytest.approx(getattr(one, name), abs=1e-11)
    assert abs(without.gap - one.gap).max() > 1e-3


def test_nothing_lies_beyond_the_rim_or_further_off_than_asked():
    face = Face(bent(curve=lambda x: 0 * x[:, 0]).whole, 1.0, [])
    points = [[0, 0, 0.9], [0, 0, 1.1], [0, 0, -0.9], [29.9, 14.9, 0], [30.1, 0, 0], [0, -15.1, 0]]
    found = over(face, np.array(points, float), 1.0)
    assert (found.triangle >= 0).tolist() == [True, False, True, True, False, False]
    assert found.gap[[0, 2, 3]] == pytest.approx([0.9, -0.9, 0.0], abs=1e-12)
