"""Sheets from files of other programs: which cells are taken, and as what."""

import meshio
import numpy as np
import pytest

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.sheet.mesh_checks import CELLS, checked_mesh, turned_over
from fabric_fenicsx.sheet.sources import read_mesh, straight_cells
from fabric_fenicsx.sheet.specimen import specimen

SQUARE = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]])


def written(path, points, *blocks):
    points = np.pad(np.asarray(points, float), ((0, 0), (0, 3 - np.shape(points)[1])))
    meshio.write_points_cells(path, points, [(kind, np.asarray(cells)) for kind, cells in blocks])
    return path


def high_order(p, bulge=0.0):
    """Triangle of order p over half of `SQUARE`, the first edge bulged out, as gmsh orders it."""
    corners, shares = SQUARE[:3], np.arange(1, p)[:, None] / p
    edges = [(1 - shares) * corners[i] + shares * corners[(i + 1) % 3] for i in range(3)]
    edges[0] = edges[0] - [0, bulge]
    inside = np.tile([7.0, 3.0], ((p - 1) * (p - 2) // 2, 1))
    points = np.pad(np.vstack([corners, *edges, inside]), ((0, 0), (0, 1)))
    return points, np.arange(len(points))[None], f"triangle{len(points)}"


@pytest.mark.parametrize("p", [3, 4])
def test_straight_cells_of_a_higher_order_are_their_corners(p):
    cells, kind = straight_cells(*high_order(p), "s.msh")
    assert kind == "triangle" and cells.tolist() == [[0, 1, 2]]
    within, beyond = (share * 1e-6 * np.hypot(10, 10) for share in (0.9, 1.1))
    straight_cells(*high_order(p, bulge=within), "s.msh")
    with pytest.raises(InputError, match=f"curved cells of order {p}, the first number 0"):
        straight_cells(*high_order(p, bulge=beyond), "s.msh")


@pytest.mark.parametrize("unused, told", [(2, 0), (3, 1)])
def test_a_mesh_with_more_than_2_percent_of_its_nodes_in_no_cell_is_doubted(tmp_path, unused, told):
    points, cells, kind = specimen(48, 1, 48, 1, "right")
    points = np.vstack([points, points[:unused] + [0, 9, 0]])
    mesh = read_mesh(written(tmp_path / "s.vtu", points, (kind, cells)))
    assert len(mesh.warnings) == told


def test_quadrilaterals_of_8_nodes_keep_their_shape(tmp_path):
    nodes = np.vstack([SQUARE, [[5, -1], [10, 5], [5, 12], [0, 5]]])
    mesh = read_mesh(written(tmp_path / "s.vtu", nodes, ("quad8", [np.arange(8)])))
    assert mesh.kind == "quad9" and mesh.cells.tolist() == [[*range(9)]]
    np.testing.assert_allclose(mesh.points[8], [5, 5.5, 0])


def test_cells_that_make_no_sheet(tmp_path):
    points = np.vstack([SQUARE, [[-5, 5], [5, 0], [10, 5]]])
    quad, triangle = ("quad", [[0, 1, 2, 3]]), ("triangle", [[0, 1, 2]])
    for *blocks, words in (
        (triangle, quad, r"\['quad', 'triangle'\]"),
        (triangle, ("tetra", [[0, 1, 2, 4]]), r"solid cells \['tetra'"),
    ):
        with pytest.raises(InputError, match=words):
            read_mesh(written(tmp_path / "s.vtu", points, *blocks))
    with pytest.raises(InputError, match="geometry without a mesh; .* `gmsh -2 s.step -o s.msh`"):
        read_mesh(tmp_path / "s.step")


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
    assert f"has {over.sum()} of {len(cells)} cells turned over, the first number" in words


def test_a_sheet_out_of_plane_by_rounding_is_plane():
    points, cells, kind = specimen(200, 50, 8, 2)
    noise = np.random.default_rng(0).uniform(-1, 1, len(points))[:, None] * [0, 0, 1]
    assert checked_mesh(points + 1e-9 * noise, cells, kind, "sheet").points.shape[1] == 2
    assert checked_mesh(points + 1e-3 * noise, cells, kind, "sheet").points.shape[1] == 3
    heights = checked_mesh(points + 1e-9 * noise + [0, 0, 7], cells, kind, "sheet", True).points
    assert np.ptp(heights[:, 2]) == 0 and heights[0, 2] == pytest.approx(7)
