"""Formed plies whose measures are known in closed form."""

import numpy as np
import pytest
from formed_plies import HALVES, SHEARED, formed, halves, plane

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.results import shape
from fabric_fenicsx.results.ply import areas, grid_of, plan_area, ply_of, whole


@pytest.mark.parametrize("full, ranks", [(False, 3), (True, 1)])
def test_paths_of_a_homogeneous_state(full, ranks):
    paths = shape.along_paths(formed(SHEARED, full=full, ranks=ranks), spacing=5.0)
    half = (117.5, 67.5) if full else (235.0, 135.0)
    for angle, length in ((0, half[0]), (45, half[1] * np.sqrt(2)), (90, half[1])):
        path, turn = paths[angle], np.radians(angle)
        np.testing.assert_allclose(path.distance[:-1], 5.0 * np.arange(np.ceil(length / 5)))
        assert path.distance[-1] == pytest.approx(length, abs=1e-6)  # the ply's edge
        stretch = np.linalg.norm([[1.02, 0.3], [0, 0.9]] @ np.array([np.cos(turn), np.sin(turn)]))
        np.testing.assert_allclose(path.formed, path.distance * stretch, rtol=1e-8)
        np.testing.assert_allclose(path.log_eps_11, np.log(1.02), rtol=1e-10)
        np.testing.assert_allclose(path.log_eps_22, np.log(np.hypot(0.3, 0.9)), rtol=1e-10)
        np.testing.assert_allclose(path.shear_angle, np.degrees(np.arctan2(0.3, 0.9)), rtol=1e-10)


def test_a_path_ends_at_a_hole():
    grid = formed(SHEARED, nx=40, ny=40, length=100.0, width=100.0)
    x, y, _ = grid.cell_centers().points.T
    path = shape.along_paths(grid.extract_cells((x < 50) | (x > 70) | (y > 20)), (0,))[0]
    assert path.distance[-1] == pytest.approx(50, abs=1e-6)
    grid = formed(SHEARED, full=True)
    ring = np.linalg.norm(grid.cell_centers().points, axis=1) > 40
    with pytest.raises(InputError, match="centroid.* is not on the flat sheet"):
        shape.along_paths(grid.extract_cells(ring))


def test_a_path_over_a_cylinder_is_its_arc_in_a_table(tmp_path):
    rolled = lambda x, y: np.column_stack([50 * np.sin(x / 50), y, 50 * np.cos(x / 50)])  # noqa: E731
    paths = shape.along_paths(formed(rolled, length=78.5, width=40.0), (0, 90), spacing=5.0)
    assert paths[0].formed == pytest.approx(paths[0].distance, rel=2e-4)  # chords of 1.7 mm
    assert paths[90].formed == pytest.approx(paths[90].distance, rel=1e-8)
    columns = np.arange(12.0).reshape(2, 6, 1) + 0.25
    paths = {angle: shape.Path(*values) for angle, values in zip((0, 45), columns)}
    shape.write_paths(tmp_path / "paths.csv", paths)
    head, *rows = (tmp_path / "paths.csv").read_text().splitlines()
    names = "path_deg,distance_mm,formed_distance_mm,log_eps_11,log_eps_22,shear_angle_deg"
    assert head == names and rows == ["0,0.25,1.25,2.25,3.25,4.25", "45,6.25,7.25,8.25,9.25,10.25"]


def test_values_at_nodes_are_means_by_area():
    """(6 1 + 2 5) / 8 = 2 on the diagonal; cells are 2/3 and 2 off the means about them."""
    ply = ply_of(halves(known=[1.0, 5.0]))
    at = {tuple(x[:2]): value for x, value in zip(ply.x, ply.at_nodes(ply.fields["known"]))}
    assert at == pytest.approx({(0, 0): 2.0, (4, 0): 1.0, (4, 3): 2.0, (0, 1): 5.0})
    grid = halves(known=[1.0, 5.0])
    assert shape.contrast(grid, "known") == pytest.approx(np.sqrt((4 / 9 + 4) / 2))
    assert shape.value_at(grid, (3.9, 0.1), "known") == 1.0
    assert areas(HALVES[None]) == pytest.approx(8.0)  # of a quadrilateral


def test_paths_begin_at_the_centroid_of_the_area():
    """At (6 (8/3, 1) + 2 (4/3, 4/3)) / 8; to the edge at x = 4 mm, and y = 1 + x / 2."""
    fields = {"log_eps_11": [0.1, 0.1], "log_eps_22": [0.0, 0.0], "shear_angle": [0.2, 0.2]}
    paths = shape.along_paths(halves(**fields), (0, 90), spacing=1.0)
    x, y = 7 / 3, 13 / 12
    assert paths[0].distance == pytest.approx([0, 1, 4 - x], abs=1e-6)
    assert paths[90].distance[-1] == pytest.approx(1 + x / 2 - y, abs=1e-6)
    assert list(paths[0].places[0]) == pytest.approx([x, y, 0])
    assert paths[0].shear_angle == pytest.approx([np.degrees(0.2)] * 3)


def test_the_image_of_a_ply():
    """Vectors lose their sign across the plane, cells stay anticlockwise, nodes on it are one."""
    ply = ply_of(halves([0.1, 0.2, 0.3], vector=[[1, 2, 3], [4, 5, 6.0]], number=[7, 8.0]))
    full = whole(ply._replace(planes={0: 0.0}))
    assert len(full.x) == 6 and full.x[4:, 0] == pytest.approx([-4, -4])
    assert full.u[4:] == pytest.approx(np.tile([-0.1, 0.2, 0.3], (2, 1)))
    assert full.fields["vector"].tolist()[2:] == [[-1, 2, 3], [-4, 5, 6]]
    assert full.fields["number"].tolist() == [7, 8, 7, 8]
    assert plan_area(full.x, full.cells) == pytest.approx([6, 2, 6, 2])


def test_quadrilaterals_are_halved_along_their_shorter_diagonal():
    x = np.array([[0, 0, 0], [4, 0, 0], [5, 1, 0], [1, 1, 0.0]])
    grid = grid_of(x, np.array([[0, 1, 2, 3]]), 0 * x)
    grid.cell_data["number"] = [3.0]
    ply = ply_of(grid)
    ends = {frozenset(map(tuple, ply.x[side, :2])) for side in ply.cells}
    assert frozenset({(4, 0), (5, 1), (1, 1)}) in ends and ply.fields["number"].tolist() == [3, 3]


def test_outlines_are_free_edges():
    """Of a quarter without its planes of symmetry; of a whole ply closed and anticlockwise."""
    (edge,) = shape.outline(formed(SHEARED, ranks=3))
    corners = [[235, 0, 0], [235, 135, 0], [0, 135, 0]]
    np.testing.assert_allclose(edge.undeformed[[0, 27, -1]], corners, atol=1e-9)
    np.testing.assert_allclose(edge.formed[27], [1.02 * 235 + 0.3 * 135, 0.9 * 135, 0], atol=1e-9)
    (edge,) = shape.outline(formed(SHEARED, full=True))
    assert (edge.undeformed[0] == edge.undeformed[-1]).all()
    x, y, _ = edge.formed.T
    assert np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) / 2 == pytest.approx(1.02 * 0.9 * 235 * 135)


def test_a_ply_that_moves_aside_is_off_its_mirror_image_and_keeps_its_mean_draw_in():
    """By twice the 1 mm that all of it moves along x, at most 3.35 mm of its ends, which differ."""
    grid = formed(plane((0.98, 0), (0, 0.99)), full=True)
    assert shape.asymmetry(grid, 0) is None
    grid.point_data["u"][:, 0] += 1
    moved, off, _ = shape.asymmetry(grid, 0)
    assert off == pytest.approx(2.0) and moved == pytest.approx(np.hypot(0.02 * 117.5 + 1, 0.675))
    assert shape.asymmetry(grid, 1) is None
    found, short = shape.draw_in(grid), 0.02 * 235 / 2
    ends = found["middle_at_low_x_mm"], found["middle_at_high_x_mm"]
    assert ends == pytest.approx((short + 1, short - 1))
    assert found["middle_of_short_side_mm"] == pytest.approx(short)
    assert shape.asymmetry(grid.translate((0.1, 0, 0)), 0) is None  # its mesh is not its image


def test_what_goes_outwards_is_no_draw_in():
    """Most goes inwards in the middle of the long sides, at the low one first."""
    found = shape.draw_in(formed(plane((1.05, 0), (0, 0.99)), full=True))
    assert (found["largest_mm"], found["middle_of_short_side_mm"]) == pytest.approx((0.675, -5.875))
    assert found["largest_at_mm"][1] == -67.5


@pytest.mark.parametrize("rounding", [-1e-12, 1e-12])
def test_the_long_side_of_a_square_ply_does_not_depend_on_rounding(rounding):
    """It is along x."""
    grid = formed(plane((0.98, 0), (0, 0.9)), nx=8, ny=8, length=80.0, width=80.0, full=True)
    grid.points[:, 0] *= 1 + rounding
    assert shape.draw_in(grid)["corner_mm"] == pytest.approx(4.8 / np.sqrt(2))
    assert shape.draw_in(grid)["middle_of_long_side_mm"] == pytest.approx(4.0)
