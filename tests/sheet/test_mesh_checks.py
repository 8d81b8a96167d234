"""Sheets from files: which cells are taken, as what, and what is refused or doubted."""

import meshio
import numpy as np
import pytest
from builders import COMM, slit_strip

import fabric_fenicsx as ff
from fabric_fenicsx.sheet.mesh_checks import CELLS, checked_mesh, turned_over
from fabric_fenicsx.sheet.sources import read_mesh
from fabric_fenicsx.sheet.specimen import PATTERNS, specimen

STRIP = specimen(4, 2, 4, 2, "right")
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
TWO = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 0], [2, 2, 0.0]])


def hanging(off=0.0):
    """Sheet of 4 x 2 mm, of which a cell under y = 1 is cut at x = 1.5, and the one above it is
    not."""
    points, cells, kind = specimen(4, 2, 4, 2, "right")
    at = {tuple(p): i for i, p in enumerate(points[:, :2].astype(int).tolist())}
    low, high = at[1, 0], [at[x, 1] for x in (1, 2)]
    n = len(points)
    points = np.vstack([points, [1.5, 1 + off, 0], [1.5, 0, 0]])
    cut = [[low, high[1], n], [low, n, high[0]]]
    (below,) = [i for i, c in enumerate(cells) if set(c) == {low, *high}]
    return points, np.vstack([np.delete(cells, below, 0), cut]), kind


def second_order(points, cells, kind):
    """The same mesh with a node in the middle of each edge and, of quadrilaterals, each cell."""
    k = CELLS[kind].corners
    ends = np.stack([cells, np.roll(cells, -1, 1)], -1).reshape(-1, 2)
    keys, number = np.unique(np.sort(ends, 1), axis=0, return_inverse=True)
    middles = len(points) + number.reshape(-1, k)
    new = [points, points[keys].mean(1)]
    columns = [cells, middles]
    if k == 4:
        columns.append(len(points) + len(keys) + np.arange(len(cells))[:, None])
        new.append(points[cells].mean(1))
    return np.vstack(new), np.hstack(columns), {3: "triangle6", 4: "quad9"}[k]


def one(kind, moved):
    """One cell of kind, 10 mm wide, with some nodes moved (by number)."""
    points = 10 * CELLS[kind].nodes
    for node, by in moved.items():
        points[node] += by
    return points, np.arange(len(points))[None], kind


LIES = {
    "hanging node": (hanging(), r"hanging node, number 15 at \[1.5, 1.0, 0.0\] mm: it lies on"),
    "one of quadratic cells": (second_order(*hanging()), r"number 31 at \[1.25, 1.0, 0.0\] mm"),
    "a cell twice": ((STRIP[0], STRIP[1][[0, *range(16)]], "triangle"), "that 3 cells share, .*0"),
    "a cell that crosses itself": ((SQUARE, [[0, 2, 1, 3]], "quad"), "degenerate or non-convex"),
    "no number": ((SQUARE * np.nan, [[0, 1, 2]], "triangle"), "not a number at node 0"),
    "no cells": ((SQUARE, np.empty((0, 3), int), "triangle"), "0 cells"),
    "cells that share a corner": ((TWO, [[0, 1, 2], [2, 3, 4]], "triangle"), "consists of 2 parts"),
    "a corner turned over": (one("triangle6", {3: (-3, 0)}), "number 0, that its curved edges"),
    # at all of whose nodes it is not
    "inside": (one("triangle6", {3: (2.5, 2.5), 4: (3, -3), 5: (-3, 1)}), "edges invert"),
    "node that is not there": ((STRIP[0], [[0, 1, 99]], "triangle"), r"nodes \[0, 1, 99\]; exp"),
}


@pytest.mark.mpi
@pytest.mark.parametrize("case", LIES)
def test_a_mesh_that_lies_is_refused_with_its_place(case):
    mesh, words = LIES[case]
    arrays = mesh if COMM.rank == 0 else (None,) * 3
    with pytest.raises(ff.InputError, match=words) as error:
        ff.Blank.from_arrays(COMM, *arrays, source="sheet.msh")
    assert str(error.value).startswith("sheet.msh ") and "; expected" in str(error.value)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
@pytest.mark.parametrize("pattern", [each for each in PATTERNS if each != "along"])
def test_specimens_are_not_doubted(pattern, cell):
    mesh = specimen(60, 20, 12, 4, pattern, cell, 0.5)
    x, y = np.moveaxis(mesh[0][mesh[1]], 2, 0)[:2]
    areas = (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(1) / 2
    assert abs(areas).sum() == pytest.approx(1200, rel=1e-12)
    assert checked_mesh(*mesh, "sheet").warnings == []
    assert checked_mesh(*second_order(*mesh), "sheet").warnings == []


@pytest.mark.mpi
@pytest.mark.parametrize("make", [lambda mesh: mesh, lambda mesh: second_order(*mesh)])
def test_a_slit_is_doubted_on_all_ranks(make):
    arrays = make(slit_strip()) if COMM.rank == 0 else (None,) * 3
    (doubt,) = ff.Blank.from_arrays(COMM, *arrays, source="sheet.msh").warnings
    assert "where another one lies" in doubt and "1.0, 0.0] mm" in doubt
    assert f"{3 if len(arrays[0]) < 40 else 7} nodes" in doubt if COMM.rank == 0 else True


def lips(apart):
    points, cells, kind = slit_strip()
    points[-3:, 1] += apart
    return points, cells, kind


LIMITS = {  # over an edge of 1 mm, of a curved cell of 0.5; over the extent of 4 mm
    "a hanging node": (hanging, (0.9e-3, 1.1e-3), "hanging node"),
    "one of curved cells": (lambda off: second_order(*hanging(off)), (0.028, 0.032), "hanging"),
    "a slit": (lips, (0.9e-6, 1.1e-6), "where another one lies"),
    "a plane sheet": (lambda off: (STRIP[0] + off * AT_ONE, *STRIP[1:]), (3.9e-7, 4.1e-7), "plane"),
}
AT_ONE = np.eye(len(STRIP[0]))[:, [7]] * [0, 0, 1]


@pytest.mark.parametrize("case", LIMITS)
def test_meshes_just_within_and_just_beyond_a_tolerance(case):
    make, offs, words = LIMITS[case]

    def said(off):
        try:
            mesh = checked_mesh(*make(off), "it")
        except ff.InputError as error:
            return str(error)
        return " ".join(mesh.warnings) or {2: "plane", 3: ""}[mesh.points.shape[1]]

    assert [words in said(off) for off in offs] == [True, False]


@pytest.mark.parametrize("unused, told", [(2, 0), (3, 1)])
def test_a_mesh_with_more_than_2_percent_of_its_nodes_in_no_cell_is_doubted(tmp_path, unused, told):
    points, cells, kind = specimen(48, 1, 48, 1, "right")
    points = np.vstack([points, points[:unused] + [0, 9, 0]])
    meshio.write_points_cells(tmp_path / "s.vtu", points, [(kind, cells)])
    mesh = read_mesh(tmp_path / "s.vtu")
    assert len(mesh.warnings) == told


def test_quadrilaterals_of_8_nodes_keep_their_shape(tmp_path):
    nodes = np.vstack([10 * SQUARE, [[5, -1, 0], [10, 5, 0], [5, 12, 0], [0, 5, 0]]])
    meshio.write_points_cells(tmp_path / "s.vtu", nodes, [("quad8", np.arange(8)[None])])
    mesh = read_mesh(tmp_path / "s.vtu")
    assert mesh.kind == "quad9" and mesh.cells.tolist() == [[*range(9)]]
    np.testing.assert_allclose(mesh.points[8], [5, 5.5, 0])


@pytest.mark.parametrize("kind", CELLS)
def test_a_cell_turned_over_has_its_nodes_the_other_way_round(kind):
    how = CELLS[kind]
    (order,) = turned_over(np.arange(len(how.nodes))[None], how)
    mirrored = how.nodes[order][:, ::-1]  # in the diagonal, where it is as before
    np.testing.assert_array_equal(mirrored, how.nodes)


@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_one_of_two_surfaces_that_is_turned_over_is_turned(cell):
    points, cells, kind = specimen(20, 10, 8, 2, "right", cell)
    over = points[cells, 0].mean(1) > 11
    turned = np.where(over[:, None], turned_over(cells, CELLS[kind]), cells)
    mesh = checked_mesh(points, turned, kind, "sheet.msh")
    np.testing.assert_array_equal(mesh.cells, cells)
    (words,) = mesh.warnings
    assert f"has {over.sum()} of {len(cells)} cells with reversed orientation, the first" in words


def test_a_sheet_out_of_plane_by_rounding_is_plane():
    points, cells, kind = specimen(200, 50, 8, 2)
    noise = np.random.default_rng(0).uniform(-1, 1, len(points))[:, None] * [0, 0, 1]
    heights = checked_mesh(points + 1e-9 * noise + [0, 0, 7], cells, kind, "sheet", True).points
    assert np.ptp(heights[:, 2]) == 0 and heights[0, 2] == pytest.approx(7)
