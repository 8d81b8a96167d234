"""Surfaces through triangles against those through which they go, and against difference quotients
of their own gap."""

import math
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista
from dome_triangles import double_dome
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.sheet.specimen import own_model, specimen
from fabric_fenicsx.surfaces import files, patches
from fabric_fenicsx.surfaces.checks import check_triangles
from fabric_fenicsx.surfaces.projection import curvatures

HERE = Path(__file__).parent
DOME, BLOCK = ff.DoubleDome(), ff.Block(100, 60, 40, radius=12)


def write_block(path):
    """`BLOCK` as a solid in a STEP file."""
    import gmsh

    with own_model(gmsh):
        occ = gmsh.model.occ
        box = occ.addBox(-50, -30, -40, 100, 60, 40)
        occ.synchronize()
        edges = [tag for _, tag in gmsh.model.getEntities(1)]
        occ.fillet([box], edges, [12.0])
        occ.synchronize()
        gmsh.write(str(path))


def refined_sphere(n):
    """Points on the unit sphere and triangles: a cube's faces of n x n squares each, blown up."""
    s = np.tan(np.linspace(-np.pi / 4, np.pi / 4, n + 1))
    u, v = (a.ravel() for a in np.meshgrid(s, s, indexing="ij"))
    p = ((n + 1) * np.arange(n)[:, None] + np.arange(n)).ravel()
    face = np.vstack([np.stack([p, p + k, p + m], 1) for k, m in ((n + 1, n + 2), (n + 2, 1))])
    sides = (np.column_stack([side + 0 * u, side * u, v]) for side in (1, -1))
    cube = [np.roll(side, axis, axis=1) for side in sides for axis in range(3)]
    points = np.vstack(cube).round(14)  # faces share their edges
    triangles = np.vstack([face + k * len(u) for k in range(6)])
    return points / np.linalg.norm(points, axis=1)[:, None], triangles


def errors(surface, exact, points, kind, reach=math.inf):
    found, right = surface.evaluate(points, reach), exact.evaluate(points)
    size = [abs(a - b).reshape(len(points), -1).max(1) for a, b in zip(found, right)]
    return np.array([a.max() if kind == "max" else np.sqrt((a**2).mean()) for a in size])


def test_triangles_of_a_sphere_converge():
    rng = np.random.default_rng(6)
    direction = rng.normal(size=(3000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    points, sphere = 10 * direction * rng.uniform(0.85, 1.2, (3000, 1)), ff.Sphere(10, [0, 0, 0])
    table = []
    for n in (8, 16, 32):
        p, t = refined_sphere(n)
        surface = ff.TriangulatedSurface(10 * p, t)
        assert len(surface.points) == 6 * n * n + 2
        table.append(errors(surface, sphere, points, "rms"))
    orders = np.log2(table[0] / table[2]) / 2
    assert (orders >= [2.3, 1.3, 0.6]).all(), orders
    assert (table[0] <= [1e-4, 2e-4, 1e-3]).all(), table[0]
    assert surface.radii == (pytest.approx(10, rel=0.01), math.inf)


def test_triangles_of_the_double_dome_converge():
    rng = np.random.default_rng(7)
    x, y = rng.uniform(-1, 1, (2, 4000)) * [[250], [150]]
    on = DOME.lift(x, y)
    points = on + rng.uniform(-3, 3, (4000, 1)) * DOME.evaluate(on).normal
    table = []
    for scale in (2, 1):
        surface = ff.TriangulatedSurface(*double_dome(DOME, size=7 * scale, turn=7 * scale))
        table.append(errors(surface, DOME, points, "rms", reach=5))
    orders = np.log2(table[0] / table[1])
    assert (orders >= [1.7, 1.0, 0.5]).all(), orders
    assert (table[1] <= [1e-3, 1e-3, 1e-2]).all(), table[1]
    assert surface.radii == pytest.approx(DOME.radii, rel=0.1)
    flange = points[(DOME.plan(x, y)[0] > DOME.developed[-1] + 5) & (abs(points[:, 2]) > 0.1)]
    found = surface.evaluate(flange)
    assert len(flange) > 500 and np.array_equal(found.gap, flange[:, 2])
    assert np.array_equal(found.normal, np.tile([0, 0, 1], (len(flange), 1)))
    assert not found.curvature.any()


def opening(n, steps, entry=6.0):
    """The plate's opening of diameter 40 as CAD exports it, turned about z in n steps: a face of
    slivers, strips as long as the wall."""
    k = np.linspace(0, np.pi / 2, steps + 1) if entry else np.zeros(1)
    edge = np.column_stack([20 + entry - entry * np.sin(k), entry * np.cos(k) - entry])
    r, z = np.vstack([(80, 0), edge, (20, -36)]).T
    a, count = np.arange(n) * 2 * np.pi / n, n * (len(r) - 1)
    x, y = (np.outer(r, f(a)).ravel() for f in (np.cos, np.sin))
    p = np.arange(count)
    q = p - p % n + (p + 1) % n
    cells = [np.column_stack([p, q, q + n]), np.column_stack([p, q + n, p + n])]
    return np.column_stack([x, y, np.repeat(z, n)]), np.vstack(cells)


def beside_opening(count, band=2.0):
    rng = np.random.default_rng(1)
    points = rng.uniform([-50, -50, -25], [50, 50, 3], (40 * count, 3))
    return points[abs(ff.Plate(40, entry=6).evaluate(points).gap) < band][:count]


def test_an_opening_of_72_facets_is_round():
    points, plate = beside_opening(2000), ff.Plate(40, entry=6)
    surface = ff.TriangulatedSurface(*opening(72, 9))
    assert (errors(surface, plate, points, "max", reach=4)[:2] <= [2e-3, 1e-2]).all()
    assert surface.radii == pytest.approx(plate.radii, rel=0.02)
    over = points[(np.hypot(points[:, 0], points[:, 1]) > 30) & (abs(points[:, 2]) < 2)]
    found = surface.evaluate(over, 4)
    assert len(over) > 100 and np.array_equal(found.gap, over[:, 2])
    assert not found.normal[:, :2].any()


@pytest.mark.parametrize("size, entry, angle", [(5, 15.0, 10.0), (8, 15.0, 10.0), (3, 9.0, 25.0)])
def test_planes_end_within_triangles(size, entry, angle):
    """A holder presses where a die is flat: within 12 mm of where that ends, the plane's points on
    the surface are those of the double dome on which the triangles' corners lie, squares cut in
    four. Facets that bend from the last corners in the plane on would lose 13 and 22 % of the
    first two."""
    dome = ff.DoubleDome(entry_radius=entry, wall_angle=angle)
    flat, cells, _ = specimen(600, 400, round(600 / size), round(400 / size))
    points = dome.lift(flat[:, 0] - 300, flat[:, 1] - 200).astype(np.float32)  # as of an STL
    surface = ff.TriangulatedSurface(points, cells)
    x, y = np.random.default_rng(3).uniform(-1, 1, (2, 200_000)) * [[235], [135]]
    d = dome.plan(x, y)[0] - dome.roundings[1]
    place, exact = np.column_stack([x, y, 0 * x])[abs(d) < 12], d[abs(d) < 12] > 0
    flat = abs(surface.evaluate(place, 1.0).gap) < 1e-4
    assert flat.sum() / exact.sum() == pytest.approx(1, abs=0.01)
    assert (flat != exact).mean() < 0.02 and not len(surface.sharp)


def test_sharp_edges_stay_sharp():
    surface = ff.TriangulatedSurface(*opening(72, 0, entry=0))
    assert len(surface.sharp) == 72
    rng = np.random.default_rng(2)
    angle, arm = rng.uniform(0, 2 * np.pi, 500), rng.uniform(-3, 3, (500, 2))
    r = 20 + arm[:, 0]
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle), arm[:, 1]])
    outside = (arm[:, 0] < 0) & (arm[:, 1] > 0)
    exact = np.where(outside, np.hypot(*arm.T), np.maximum(-arm[:, 0], arm[:, 1]))
    found = surface.evaluate(points)
    assert outside.sum() > 50 and abs(found.gap - exact).max() <= 2e-3


def test_a_cube_is_exact():
    """With slivers along the diagonal of its face z = 1."""
    rng = np.random.default_rng(2)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4)]
    cells = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    slivers = [[1e-3 * k - 0.5, 1e-4 * (-1) ** k, 1.0] for k in range(7)]
    left, right, low, high = 1, 5, 3, 7
    cells += [(right, high, 14), (low, left, 8), (left, right, 14), (high, low, 14)]
    cells += [cell for a in range(8, 14) for cell in ((left, a + 1, a), (low, a, a + 1))]
    cube = ff.TriangulatedSurface(np.vstack([corners, slivers]), cells)
    points = rng.uniform(-2, 2, (2000, 3))
    q = abs(points) - 1
    exact = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(1), 0)
    found = cube.evaluate(points)
    assert abs(found.gap - exact).max() <= 1e-12
    foot = points - found.gap[:, None] * found.normal
    assert abs(abs(foot).max(1) - 1).max() <= 1e-12
    assert len(cube.rim) == len(cube.forks) == 0 and cube.radii == (math.inf, math.inf)


def slopes(surface, points, h=1e-4):
    """Of the gap, (n, 3), and of the normal, (n, 3, 3), by differences of fourth order."""
    gradient, hessian = np.empty_like(points), np.empty((len(points), 3, 3))
    for k in range(3):
        a, b, c, d = (surface.evaluate(points + step * h * np.eye(3)[k]) for step in (-2, -1, 1, 2))
        gradient[:, k] = (a.gap - 8 * b.gap + 8 * c.gap - d.gap) / (12 * h)
        hessian[:, :, k] = (a.normal - 8 * b.normal + 8 * c.normal - d.normal) / (12 * h)
    return gradient, hessian


@pytest.mark.parametrize("name", ["opening", "sharp"])
def test_normal_and_curvature_are_derivatives_of_the_gap(name):
    given = opening(24, 4) if name == "opening" else opening(24, 0, entry=0)
    surface, points = ff.TriangulatedSurface(*given), beside_opening(600)
    found = surface.evaluate(points)
    gradient, hessian = slopes(surface, points)
    assert np.linalg.norm(found.normal, axis=1) == pytest.approx(1, abs=1e-12)
    # a few lie so near to a jump of the curvature, or to where two parts are as near, that the
    # differences lie across
    assert np.quantile(abs(gradient - found.normal).max(1), 0.99) <= 1e-8
    assert np.quantile(abs(hessian - found.curvature).max((1, 2)), 0.97) <= 1e-8
    if name != "sharp":
        assert abs(gradient - found.normal).max() <= 1e-5


def test_what_touches_has_the_normal_of_the_surface():
    """Inside triangles, on their edges and at their corners, where a search across an edge must not
    go to and fro."""
    surface = ff.TriangulatedSurface(*double_dome(size=20, turn=15))
    rng = np.random.default_rng(9)
    n = 6000
    ends = np.unique(np.concatenate([surface.sharp, surface.rim]))
    smooth = np.flatnonzero(~np.isin(surface.triangles, ends).any(1))
    b = rng.dirichlet([1, 1, 1], n).T
    b[0, : 2 * n // 3] = 0
    b[:2, : n // 3] = 0
    b = rng.permuted(b / b.sum(0), axis=0)
    at, w = np.empty((n, 6, 3)), np.empty((6, 18))
    for row, triangle, place in zip(at, rng.choice(smooth, n), b.T.copy()):
        patches.place(surface.curved.patches, triangle, place, w, row)
    normal = np.cross(at[:, 1], at[:, 2])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for off in (0.0, 1e-9, -1e-6, 1e-4, -2e-3):
        points = at[:, 0] + off * normal
        found = surface.evaluate(points, 1.0)
        assert abs(found.gap - off).max() <= 1e-11
        assert abs(found.normal - normal).max() <= 1e-8


@pytest.mark.versions
@pytest.mark.parametrize("ending", ["step", "brep"])
def test_a_model_is_its_solid(tmp_path, ending):
    """In STEP the same numbers as metres are a block a thousand times as large."""
    path = tmp_path / f"block.{ending}"
    write_block(path)
    unit = 1000 if ending == "step" else 1
    if unit > 1:
        path.write_text(path.read_text().replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)"))
    surface = ff.TriangulatedSurface.read(path, chord=0.1 * unit)
    # facets are off the faces by the chord that was asked
    off = abs(BLOCK.evaluate(surface.points[surface.triangles].mean(1) / unit).gap)
    assert 0.05 < np.median(off[off > 1e-6]) < 0.11
    assert not check_triangles(surface, path.name, 1.0 * unit)
    assert len(surface.rim) == len(surface.forks) == 0  # closed
    # corners of triangles lie on the file's faces and have their normals
    right = BLOCK.evaluate(surface.points / unit)
    assert abs(right.gap).max() < 1e-6
    assert (right.normal * surface.normals).sum(1).min() > np.cos(np.radians(0.02))
    # where the middle of a ply is, also between the corners
    x = np.random.default_rng(0).uniform([-52, -32, -20], [52, 32, 2], (20_000, 3))
    x = x[abs(BLOCK.evaluate(x).gap - 0.5) < 0.2]
    found, right = surface.evaluate(unit * x), BLOCK.evaluate(x)
    assert len(x) > 500 and abs(found.gap / unit - right.gap).max() < 0.01
    assert (right.normal * found.normal).sum(1).min() > np.cos(np.radians(0.5))


def test_a_cad_model_is_meshed_once(tmp_path, monkeypatch):
    """A sweep or a resumed run finds the triangles of the run before."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    write_block(tmp_path / "block.step")
    first = ff.TriangulatedSurface.read(tmp_path / "block.step", chord=1.0)
    assert np.degrees(first.curved.turns()[1].max()) < 23  # however far the chord would let them
    monkeypatch.setattr(files, "_mesh_of_model", None)
    (tmp_path / "block.step").rename(tmp_path / "moved.step")
    again = ff.TriangulatedSurface.read(tmp_path / "moved.step", chord=1.0)
    assert (again.points == first.points).all() and (again.triangles == first.triangles).all()
    assert (again.normals == first.normals).all()


def test_bodies_of_cad_models(tmp_path):
    """Solids of IGES are closed; of several in a STEP file those are read that are asked for."""
    import gmsh

    with own_model(gmsh):
        gmsh.model.occ.addBox(0, 0, 0, 10, 20, 30)
        gmsh.model.occ.addSphere(50, 0, 0, 10)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "two.step"))
    two, ball, iges = tmp_path / "two.step", 400 * np.pi, HERE / "ball.igs"
    cases = [(iges, (), 9 * ball), (two, (1,), 2200), (two, (2,), ball), (two, (1, 2), 2200 + ball)]
    for file, body, area in cases:
        surface = ff.TriangulatedSurface.read(file, chord=0.02, body=body)
        assert surface.areas.sum() == pytest.approx(area, rel=5e-3) and not len(surface.rim)
    words = r"2 bodies: 1 from \(0, 0, 0\) to \(10, 20, 30\), 2 from \(40, -10, -10\) to"
    for wrong in ((), (3,)):
        with pytest.raises(ff.InputError, match=words):
            ff.TriangulatedSurface.read(two, body=wrong)


def test_points_that_move_are_found_as_anew():
    points, rng = double_dome(size=20, turn=20), np.random.default_rng(8)
    surface = ff.TriangulatedSurface(*points)
    at = rng.uniform([-250, -150, -5], [250, 150, 70], (400, 3))
    for size in (0.0, 0.3, 3.0, 0.1, 30.0):
        at = at + rng.normal(0, size + 1e-12, at.shape)
        right = ff.TriangulatedSurface(*points).evaluate(at)
        for reach in (5.0, 20.0):
            found, near = surface.evaluate(at, reach), abs(right.gap) <= reach
            assert near.sum() > 10 and (abs(found.gap[~near]) > reach).all()
            assert np.array_equal(np.sign(found.gap), np.sign(right.gap))
            for a, b in zip(found, right):
                assert abs(a[near] - b[near]).max() <= 1e-9


def test_triangles_turned_against_each_other_are_put_right():
    points, triangles = refined_sphere(4)
    triangles[10::3] = triangles[10::3, ::-1]
    surface = ff.TriangulatedSurface(10 * points, triangles)
    assert np.allclose(np.einsum("ij,ij->i", surface.normals, surface.points), 10, atol=0.3)
    turned = ff.TriangulatedSurface(10 * points, triangles[:, ::-1])
    inwards = turned.evaluate([[0, 0, 12]])
    assert inwards.gap == pytest.approx(-surface.evaluate([[0, 0, 12]]).gap, abs=1e-12)
    assert inwards.normal[0, 2] < -0.99


@pytest.mark.parametrize("off", [1e-4, 1e-3])
def test_cracks_between_triangles_are_closed(off):
    points, triangles = refined_sphere(4)
    corners = 30 * points[triangles].reshape(-1, 3)
    cracked = corners + np.random.default_rng(0).uniform(-off, off, corners.shape)
    surface = ff.TriangulatedSurface(cracked, np.arange(len(corners)).reshape(-1, 3))
    assert len(surface.points) == len(ff.TriangulatedSurface(points, triangles).points)
    assert not len(surface.rim)
    twice = ff.TriangulatedSurface(points, np.vstack([triangles, triangles[:3, [1, 2, 0]]]))
    assert len(twice.triangles) == len(triangles) and not len(twice.forks)
    lower = points[triangles][:, :, 2].mean(1) < 0  # wider gaps stay open
    halves = np.vstack([30 * points, 30 * points - [0, 0, 0.2]])
    halves = ff.TriangulatedSurface(halves, triangles + np.where(lower, len(points), 0)[:, None])
    assert len(halves.rim)


def test_beyond_the_rim_there_is_no_body():
    surface = ff.TriangulatedSurface([[0, 0, 0], [9, 0, 0], [0, 9, 0]], [[0, 1, 2]])
    points = [[-1e-3, 2, 0.5], [-1e-3, 2, -0.5], [3, -4, -3], [3, 3, -2]]
    far = math.hypot(1e-3, 0.5)
    assert surface.evaluate(points).gap == pytest.approx([far, far, 5, -2])
    for same in (surface, ff.Offset(surface, 0), ff.Flipped(ff.Flipped(surface))):
        assert ff.Reversed(same).evaluate(points).gap == pytest.approx([far, far, 5, 2])


def test_quadrilaterals_are_cut_and_solids_are_refused(tmp_path):
    points = np.array([[x, y, z] for z in (0.0, 1) for x, y in ((0, 0), (2, 0), (2, 2), (0, 2))])
    meshio.write(tmp_path / "quad.vtk", meshio.Mesh(points[4:], {"quad": [[0, 1, 2, 3]]}))
    quad = ff.TriangulatedSurface.read(tmp_path / "quad.vtk")
    assert quad.evaluate([[0.5, 1.5, 3]]).gap == pytest.approx([2])
    pyvista.Plane().triangulate().save(tmp_path / "plane.vtk")
    assert ff.TriangulatedSurface.read(tmp_path / "plane.vtk").evaluate([[0, 0, 2]]).gap == 2
    meshio.write(tmp_path / "solid.vtu", meshio.Mesh(points, {"hexahedron": [list(range(8))]}))
    with pytest.raises(ff.InputError, match=r"solid.vtu holds no surface cells, but \['hexa"):
        ff.TriangulatedSurface.read(tmp_path / "solid.vtu")


@pytest.mark.mpi
def test_all_ranks_hold_the_triangles_of_one_read(shared_path):
    comm, path = MPI.COMM_WORLD, shared_path / "block.step"
    if comm.rank == 0:
        write_block(path)
    comm.barrier()
    surface = ff.TriangulatedSurface.read(path, comm=comm)
    for points, triangles in comm.allgather((surface.points, surface.triangles)):
        np.testing.assert_array_equal(points, surface.points)
        np.testing.assert_array_equal(triangles, surface.triangles)
    with pytest.raises(ff.InputError, match="does not exist"):
        ff.TriangulatedSurface.read(shared_path / "none.step", comm=comm)


def test_radii_of_marching_cubes_are_those_over_several_cells():
    """Slivers bend by any amount between points that lie on a ball."""
    grid = pyvista.ImageData(dimensions=(40, 40, 40), origin=(-20.2, -19.7, -19.9))
    gap = np.linalg.norm(grid.points, axis=1) - 15
    cubes = grid.contour([0.0], gap, method="marching_cubes")
    surface = ff.TriangulatedSurface(cubes.points, cubes.faces.reshape(-1, 4)[:, 1:])
    patches = np.abs(curvatures(surface.curved.patches)).max()
    assert 1 / patches < 1 and 10 < min(surface.radii) < 17 and np.isinf(max(surface.radii))


def test_faces_of_an_iges_file():
    """A roof of two bilinear faces (entity 128), which in this format do not share their edge."""
    surface = ff.TriangulatedSurface.read(HERE / "roof.igs")
    assert len(surface.sharp) >= 1 and (surface.points[surface.sharp][..., 0] == 10).all()
    found = surface.evaluate([[5, 5, 2], [15, 10, -3]])
    assert abs(found.gap) == pytest.approx([2, math.sqrt(2)], abs=1e-9)
