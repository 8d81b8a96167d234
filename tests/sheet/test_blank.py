"""Meshes in and out, fibre fields, and what is said of bad ones."""

import math

import numpy as np
import pytest
import ufl
from builders import COMM
from dolfinx import fem

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.sheet.gmsh_cells import own_model
from fabric_fenicsx.sheet.specimen import specimen, yarns_through_corners


def area(blank):
    return COMM.allreduce(fem.assemble_scalar(compat.form(1.0 * ufl.dx(blank.mesh))))


@pytest.mark.parametrize("angle, lines", [(0, 0), (45, 4), (100, 4)])
def test_edges_follow_the_yarns_through_the_corners(angle, lines):
    yarns = math.radians(angle)
    points, cells, _ = specimen(200, 50, 40, 10, "yarns", yarns=yarns)
    edges = np.sort(np.stack([cells, np.roll(cells, -1, 1)], 2).reshape(-1, 2), 1)
    edges = points[np.unique(edges, axis=0)][:, :, :2]
    segments = yarns_through_corners(200, 50, yarns)
    assert len(segments) == lines
    for start, end in segments:
        assert set(np.abs(start) / [200, 50]) <= {0.0, 1.0}
        direction = (end - start) / np.linalg.norm(end - start)
        assert math.sin(2 * (math.atan2(*direction[::-1]) - yarns)) == pytest.approx(0, abs=1e-12)
        off = np.abs((edges - start) @ [-direction[1], direction[0]]).max(1)
        covered = np.linalg.norm(np.diff(edges[off < 2e-6], axis=1), axis=2).sum()  # 1e-6 mm: grid
        assert covered == pytest.approx(np.linalg.norm(end - start), rel=1e-7)


def test_squares_along_yarns_are_half_of_their_size_off_the_edges():
    """Of the larger of both sizes that are asked for."""
    for sides, counts, size in (((235, 135), (24, 14), 235 / 24), ((100, 60), (10, 12), 10)):
        points, cells, _ = specimen(*sides, *counts, "along", yarns=0.3)
        off = np.minimum(points[:, :2], sides - points[:, :2]).min(1)
        assert 0.5 <= off[off > 1e-9].min() / size < 0.6
        edges = (np.roll(points[cells], -1, 1) - points[cells]).reshape(-1, 3)
        quarters = (np.arctan2(edges[:, 1], edges[:, 0]) - 0.3) / (math.pi / 2)
        along = np.linalg.norm(edges[abs(quarters - quarters.round()) < 1e-9], axis=1)
        assert np.median(along) == pytest.approx(size)


def test_diagonals_and_yarns_through_corners():
    for pattern, sums in (("left", [1, 1]), ("right", [0, 2])):
        points, cells, _ = specimen(1, 1, 1, 1, pattern)
        shared = np.intersect1d(*cells)
        assert sorted(points[shared].sum(1)) == sums
    start, end = yarns_through_corners(200, 50, 0.3, 1.0).swapaxes(0, 1)
    angles = np.arctan2(*(end - start).T[::-1]) % math.pi
    assert np.sort(angles) == pytest.approx([0.3, 0.3, 1.3, 1.3])


def test_graded_cells_are_moved_by_a_sine_along_both_diagonals():
    """So cells are smallest across the lines at 45 deg through corners, 0.05 of even ones there."""
    x = specimen(200, 50, 48, 12)[0]
    s, d = ([1, 1] * x[:, :2]).sum(1), ([1, -1] * x[:, :2]).sum(1)
    s, d = (v - 0.95 * 50 / (2 * np.pi) * np.sin(2 * np.pi * v / 50) for v in (s, d))
    points = specimen(200, 50, 48, 12, "graded")[0]
    assert points[:, :2] == pytest.approx(np.column_stack([s + d, s - d]) / 2, abs=1e-9)
    with pytest.raises(ff.InputError, match="210 x 50 mm .* multiple of the width"):
        specimen(210, 50, 48, 12, "graded")


@pytest.mark.versions
@pytest.mark.parametrize("kind", ["triangle6", "quad9"])
def test_curved_cells(tmp_path, kind):
    import gmsh

    options = {"RecombineAll": float(kind == "quad9"), "RecombinationAlgorithm": 3.0}
    with own_model(gmsh, MeshSizeMax=3.0, **options):
        gmsh.model.occ.addDisk(0, 0, 0, 10, 10)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(tmp_path / "disk.msh"))
    blank = ff.Blank.read(tmp_path / "disk.msh")
    assert blank.mesh.geometry.dim == 2 and not blank.warnings
    assert area(blank) == pytest.approx(100 * math.pi, rel=1e-3)


def cylinder(cell="triangle"):
    """Quarter of a cylinder of radius 50 about the y axis, 40 long."""
    points, cells, kind = specimen(math.pi / 2, 40, 24, 6, cell=cell)
    t = points[:, 0]
    return np.column_stack([50 * np.sin(t), points[:, 1], 50 * np.cos(t)]), cells, kind


@pytest.mark.versions
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_fibres_on_a_curved_blank(cell):
    arrays = cylinder(cell) if COMM.rank == 0 else (None,) * 3
    blank = ff.Blank.from_arrays(COMM, *arrays, a=(1.0, 0.0, -1.0), up=(1.0, 0.0, 1.0))
    a, b = (f.x.array.reshape(-1, 3) for f in (blank.a0, blank.b0))
    x = blank.mesh.geometry.x[compat.geometry_dofmap(blank.mesh)].mean(1)
    radial = x * [1, 0, 1] / np.linalg.norm(x * [1, 0, 1], axis=1, keepdims=True)
    assert np.allclose(np.linalg.norm(a, axis=1), 1) and np.allclose(np.linalg.norm(b, axis=1), 1)
    assert np.abs((a * radial).sum(1)).max() < 0.04  # facets of the cylinder
    assert np.allclose(np.cross(a, b)[:, [0, 2]] @ [1, 1] > 0, True)
    assert np.abs((a * b).sum(1)).max() < 1e-12


@pytest.mark.mpi
def test_fibres_from_angle_vector_and_function_agree():
    arrays = specimen(nx=6, ny=3) if COMM.rank == 0 else (None,) * 3
    angle = 0.7
    vector = [math.cos(angle), math.sin(angle)]
    ways = [angle, [3 * v for v in vector] + [0.0], lambda x: np.full(x.shape[1], angle)]
    for a in [*ways, lambda x: np.outer(vector, np.ones(x.shape[1]))]:
        blank = ff.Blank.from_arrays(COMM, *arrays, a=a)
        assert np.allclose(blank.a0.x.array.reshape(-1, 2), vector, atol=1e-15)
        assert np.allclose(blank.b0.x.array.reshape(-1, 2), [-vector[1], vector[0]], atol=1e-15)


@pytest.mark.mpi
def test_fibres_that_are_refused():
    flat = specimen(nx=4, ny=2)
    for options, words in (
        ({"frame": [[1, 0], [1, 1]]}, "frame of the blank"),
        ({"a": (0.0, 0.0)}, "a is zero or not finite"),
    ):
        with pytest.raises(ff.InputError, match=words):
            ff.Blank.from_arrays(COMM, *(flat if COMM.rank == 0 else (None,) * 3), **options)
