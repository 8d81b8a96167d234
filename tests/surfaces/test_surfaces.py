"""Surfaces of tools against closed forms, difference quotients of their own gap, and each other."""

import math

import numpy as np
import pytest

import fabric_fenicsx as ff

DOMES = {
    "default": ff.DoubleDome(),
    "straight": ff.DoubleDome(waist=65, saddle_depth=0),
    "upright": ff.DoubleDome(wall_angle=0, top_radius=30, entry_radius=12),
    "overlapping": ff.DoubleDome(dome_distance=90, waist=60, saddle_length=120, saddle_depth=10),
}


def around(dome, n, band, seed=0):
    """Points within `band` of the surface, spread evenly over the developed plan, walls and fillets
    included."""
    rng = np.random.default_rng(seed)
    reach = dome.dome_radius + dome.developed[-1] + 20
    x, y = rng.uniform(-1, 1, (2, n)) * [[dome.dome_distance / 2 + reach], [reach]]
    on = dome.lift(x, y)
    gap = rng.uniform(-band, band, n)
    return on, gap, on + gap[:, None] * dome.evaluate(on).normal


def check_derivatives(surface, points, h=1e-5):
    """Gradient of the gap and curvature by differences, of the normal from both sides apart."""
    found = surface.evaluate(points)
    gradient, sides = np.empty_like(found.normal), np.empty((2, *found.curvature.shape))
    for k in range(3):
        plus, minus = (surface.evaluate(points + sign * h * np.eye(3)[k]) for sign in (1, -1))
        gradient[:, k] = (plus.gap - minus.gap) / (2 * h)
        sides[:, :, :, k] = (plus.normal - found.normal) / h, (found.normal - minus.normal) / h
    assert abs(found.normal - gradient).max() <= 1e-6
    assert abs(np.linalg.norm(found.normal, axis=1) - 1).max() <= 1e-14
    assert np.array_equal(found.curvature, found.curvature.swapaxes(1, 2))
    assert abs(np.einsum("nij,nj->ni", found.curvature, found.normal)).max() <= 1e-14
    # where the two sides differ a seam lies between them, and the curvature is that of either
    smooth = abs(sides[0] - sides[1]).max((1, 2)) <= 1e-4
    assert smooth.mean() >= 0.99
    error = abs(found.curvature - sides.mean(0)).max((1, 2))
    assert error[smooth].max() <= 1e-6


ARM = 0.5**0.5
CLOSED_FORMS = [  # surface, point, gap and normal
    (ff.Plane([0, 0, 2], [0, 0, 5]), [7, -3, 5], 3, [0, 0, 1]),
    (ff.Plane([1, 0, 0], [3, 4, 0]), [2, 1, 0], 1.4, [0.6, 0.8, 0]),
    (ff.Plane([0, 0, 0], [0, 1e-200, 0]), [0, 2, 0], 2, [0, 1, 0]),
    (ff.Sphere(5, [1, 2, 3]), [1, -1, 3], -2, [0, -1, 0]),
    (ff.Cylinder([0, 0, 1], [2, 0, 0], 4), [9, 0, 7], 2, [0, 0, 1]),
    (ff.Torus([0, 0, 0], [0, 0, 3], 20, 6), [0, 13, 0], 1, [0, -1, 0]),
    (ff.Torus([0, 0, 0], [0, 0, 3], 20, 6), [20, 0, 0], -6, [0, 0, 1]),
    (ff.Plate(40, entry=6, centre=[0, 0, 1]), [0, -19, -20], 1, [0, 1, 0]),
    (ff.Plate(40, entry=6), [26 - 6 * ARM, 0, 6 * ARM - 6], 0, [-ARM, 0, ARM]),
    (ff.Plate(60, 40, 12), [29, 0, -9], 1, [-1, 0, 0]),
    (ff.Block(60, 40, 30, 6, centre=[0, 0, 2]), [34, 0, -9], 4, [1, 0, 0]),
    (ff.Block(60, 40, 30, 6), [24 + 6 * ARM, 0, 6 * ARM - 6], 0, [ARM, 0, ARM]),
]


@pytest.mark.parametrize("surface, point, gap, normal", CLOSED_FORMS)
def test_gap_and_normal_of_closed_forms(surface, point, gap, normal):
    near = surface.evaluate([point])
    assert near.gap == pytest.approx([gap], abs=1e-11)
    assert near.normal == pytest.approx(np.array([normal]), abs=1e-12)


def test_radii_of_closed_forms():
    radii = [each.radii for each in (RING, ff.Plate(40, entry=6), ff.Plate(60, 40, 12), BLOCKS[1])]
    assert radii == [(6, 14), (6, 20), (math.inf, 12), (6, math.inf)]
    assert ff.Offset(RING, 2).radii == (8, 12) and ff.Reversed(RING).radii == (14, 6)
    # of a dome whose saddle flattens nothing: its rounding and its fillet
    assert DOMES["straight"].radii == pytest.approx((40, 15), rel=1e-9)


RING = ff.Torus([1, 2, 3], [1, -1, 2], 20, 6)
ROUND = [ff.Sphere(5, [1, 2, 3]), ff.Cylinder([1, 0, -1], [1, 2, 3], 4)]
PLATES = [ff.Plate(40, entry=6), ff.Plate(60, 40, 12, 6, [1, 2, 3]), ff.Plate(60, 40, 12)]
BLOCKS = [ff.Block(60, 40, 30, 6, centre=[1, 2, 3]), ff.Block(60, 40, 40, 6, 15, [0, 0, 20])]


@pytest.mark.parametrize("surface", [*ROUND, RING, *PLATES, *BLOCKS])
def test_bodies(surface):
    """Points of the surface, moved along the normal, are given back; a centre has a number."""
    if surface in ROUND:
        centre = surface.evaluate([surface.centre])
        assert centre.gap == [-surface.radius]
        assert np.linalg.norm(centre.normal) == pytest.approx(1)
        assert np.isfinite(centre.curvature).all()
    points = surface.centre + np.random.default_rng(0).uniform(-45, 45, (20_000, 3)) * [1, 1, 0.4]
    found = surface.evaluate(points)
    points = points[abs(found.gap) < (2 if surface in ROUND else 4)]
    assert len(points) > 30
    found = surface.evaluate(points)
    foot = points - found.gap[:, None] * found.normal
    there = surface.evaluate(foot)
    assert abs(there.gap).max() <= 1e-12
    if surface.radii[0] < math.inf:
        assert abs(there.normal - found.normal).max() <= 1e-6
        check_derivatives(surface, points[:1000])


class Floor(ff.Surface):
    """z <= 0, as a user writes it."""

    def nearest(self, points, reach):
        normal = np.tile([0.0, 0, 1], (len(points), 1))
        return ff.Nearest(points[:, 2].copy(), normal, np.zeros((len(points), 3, 3)))


class Dent(ff.ImplicitSurface):
    """A bump of 25 mm without a bound, far from which the projection finds nothing."""

    radii = (15.0, 15.0)

    def implicit(self, x):
        ax, ay = 2 / 75**2, 2 / 55**2
        q = 1 - np.minimum(ax / 2 * x[0] ** 2 + ay / 2 * x[1] ** 2, 1.0)
        d, dd, sx, sy = -75 * q**2, 150 * q, ax * x[0], ay * x[1]
        hessian = np.zeros((3, 3, len(q)))
        hessian[0, 0], hessian[1, 1] = -(dd * sx * sx + d * ax), -(dd * sy * sy + d * ay)
        hessian[0, 1] = hessian[1, 0] = -dd * sx * sy
        return x[2] - 25 * q**3, np.array([-d * sx, -d * sy, 0 * q + 1]), hessian


def test_surfaces_of_a_user():
    """Where no nearest point is found the surface is told to be far."""
    points = np.random.default_rng(0).uniform([-20, -15, -3], [20, 15, 3], (500, 3))
    up = points[:, 2:] - Dent().implicit(points.T)[0][:, None]
    check_derivatives(Dent(), points + [[0, 0, 1]] * up)
    far = np.array([[10.759631695, -51.810639783, 33.652719063], [2.820369e-6, 7e-18, 0.7712783]])
    assert np.isnan(Dent().evaluate(far).gap).any()
    found = Dent().evaluate(far, reach=1.0)
    assert (found.gap * (1, -1) > 1).all() and all(np.isfinite(each).all() for each in found)
    die = ff.Reversed(ff.Offset(Floor(), 1.5))
    assert np.array_equal(die.evaluate(points).gap, 1.5 - points[:, 2])
    assert np.isnan(Floor().evaluate([[0, 0, np.nan]]).gap).all()


@pytest.mark.parametrize("dome", DOMES.values(), ids=DOMES)
def test_double_dome_finds_the_nearest_point(dome):
    inside, outside = dome.radii
    assert outside < dome.entry_radius + 1e-9 and inside < dome.top_radius + 1e-9
    on, gap, points = around(dome, 20_000, min(inside, outside) - 0.5)
    assert abs(dome.evaluate(on).gap).max() <= 1e-11
    found = dome.evaluate(points)
    # points of the surface and their normals are given back: that is what nearest means
    assert abs(found.gap - gap).max() <= 1e-10
    foot = points - found.gap[:, None] * found.normal
    assert abs(foot - on).max() <= 1e-8
    there = dome.evaluate(foot)
    assert abs(there.gap).max() <= 1e-10
    assert abs(np.cross(points - foot, there.normal)).max() <= 1e-10
    _, gap, points = around(dome, 4000, 5, seed=1)
    d = dome.plan(*points.T[:2])[0]
    fillet = (d > -10) & (d < dome.roundings[1]) & (points[:, 2] < 20)
    assert (fillet & (gap > 1)).sum() > 100 and (fillet & (gap < -1)).sum() > 100
    assert (abs(points[:, 0]) < 50).sum() > 500
    check_derivatives(dome, points)


def test_double_dome_has_the_dimensions_it_was_given():
    dome = ff.DoubleDome()
    along = [[0, 0], [152, 0], [-152, 0], [0, 120]]
    assert dome.lift(*np.transpose(along))[:, 2] == pytest.approx([45, 60, 60, 0])
    half_length, half_width = dome.dome_distance / 2 + 65, 65
    d, _, _ = dome.plan(np.array([half_length, 152, 0]), np.array([0, half_width, 55]))
    assert d == pytest.approx([0, 0, 0], abs=1e-12) and 2 * half_length == 434
    wall = np.array([np.interp(0.5, [0, 1], dome.developed[1:3])])
    normal = dome.evaluate(dome.lift(152 + 65 + wall, 0 * wall)).normal[0]
    assert math.degrees(math.asin(normal[2])) == pytest.approx(10)
    around_x = np.linspace(-1, 1, 100)
    c = dome.evaluate(np.column_stack([0 * around_x, around_x, 45 + 0 * around_x])).curvature
    assert c[:, 0, 0] == pytest.approx(-6 * 15 / 152**2)  # along the saddle


def test_double_dome_far_from_it():
    dome = DOMES["default"]
    points = np.random.default_rng(3).uniform([-300, -200, -80], [300, 200, 140], (30_000, 3))
    exact, quick = dome.evaluate(points), dome.evaluate(points, reach=5)
    known = np.isfinite(exact.gap)
    assert known.mean() > 0.9995  # the rest lies where several points are equally near
    assert np.isfinite(quick.gap).all() and np.isfinite(quick.curvature).all()
    assert np.array_equal(np.sign(exact.gap[known]), np.sign(quick.gap[known]))
    assert (abs(quick.gap) <= abs(exact.gap) + 1e-9)[known].all()
    near = known & (abs(exact.gap) <= 5)
    assert near.sum() > 1000 and (abs(quick.gap[~near & known]) > 5).all()
    for a, b in zip(exact, quick):
        assert abs(a - b)[near].max() <= 1e-10


@pytest.mark.parametrize(
    "surface",
    [ff.DoubleDome(), ff.TriangulatedSurface([[0, 0, 0], [9, 0, 0], [0, 9, 0]], [[0, 1, 2]]), RING],
)
def test_no_points_and_points_that_are_not_finite(surface):
    for each in (surface, ff.Reversed(ff.Flipped(ff.Offset(surface, 1)))):
        shapes = [a.shape for a in each.evaluate(np.empty((0, 3)), reach=1)]
        assert shapes == [(0,), (0, 3), (0, 3, 3)]
        for values in each.evaluate([[1, 2, 12], [np.nan, 0, 0], [0, np.inf, 0], [1, 2, 12]]):
            assert np.isnan(values[1:3]).all() and np.isfinite(values[[0, 3]]).all()
            assert np.array_equal(values[0], values[3])


def test_modifiers():
    dome = DOMES["default"]
    _, _, points = around(dome, 500, 5, seed=4)
    found, die = dome.evaluate(points), ff.Reversed(ff.Offset(dome, 2))
    on_punch, _, _ = around(dome, 500, 0, seed=5)
    assert abs(die.evaluate(on_punch, reach=3).gap - 2).max() <= 1e-10
    assert die.radii == pytest.approx((dome.radii[1] - 2, dome.radii[0] + 2))
    mirror = np.array([1, 1, -1])
    flipped = ff.Flipped(dome).evaluate(points * mirror)
    assert np.array_equal(flipped.gap, found.gap)
    assert np.array_equal(flipped.normal, found.normal * mirror)
    for surface in (ff.Offset(dome, -3), die, ff.Flipped(dome)):
        check_derivatives(surface, points * (mirror if isinstance(surface, ff.Flipped) else 1))


def test_turned_surfaces():
    """About x first, then y, then z: what pointed along y ends along x, by way of z."""
    twice = ff.Turned(ff.Plane([0, 3, 0], [0, 1, 0]), (90, 90, 0))
    once = ff.Turned(ff.Plane([3, 0, 0], [1, 0, 0]), (0, 0, 90))
    assert twice.evaluate([[7, 2, 1]]).gap == pytest.approx([4])
    assert once.evaluate([[2, 7, 1]]).normal == pytest.approx(np.array([[0, 1, 0]]))
    block = ff.Turned(BLOCKS[1], (10, -70, 25))
    points = np.random.default_rng(0).uniform(-40, 40, (5000, 3))
    points = points[abs(block.evaluate(points).gap) < 4]
    check_derivatives(block, points[:1000])
    assert block.radii == (6, math.inf) and block.fingerprint()["angles"].tolist() == [10, -70, 25]


@pytest.mark.parametrize("surface", [BLOCKS[0], ff.Turned(BLOCKS[0], (30, 20, 10))])
def test_a_drawn_block_lies_on_itself_with_its_normals(surface):
    points, normals, triangles = surface.mesh((-50, -50, -50), (50, 50, 50), 2.0)
    found = surface.evaluate(points)
    assert abs(found.gap).max() < 1e-9 and np.allclose(normals, found.normal)
    p, q, r = points[triangles].swapaxes(0, 1)
    area = np.cross(q - p, r - p) / 2
    assert ((area * normals[triangles[:, 0]]).sum(1) > 0).all()
    # of the faces, the quarters of cylinders along the edges, and a ball
    exact = 2 * (48 * 28 + 48 * 18 + 28 * 18) + 2 * math.pi * 6 * (48 + 28 + 18) + 4 * math.pi * 36
    assert np.linalg.norm(area, axis=1).sum() == pytest.approx(exact, rel=5e-3)


def test_bad_parameters():
    for make, words in (
        (lambda: ff.DoubleDome(wall_angle=50), "wall_angle is 50 and top_radius 40; expected"),
        (lambda: ff.Offset(ff.Sphere(10), -10), "distance of the offset of surface Sphere is -10"),
        (lambda: ff.Tool(ff.Sphere(1), lambda load: load, name="a"), "path of a at load 0 is 0.0;"),
    ):
        with pytest.raises(ff.InputError, match=f"^{words}"):
            make()


def test_tool_moves():
    for path, load, moved in (
        ([0, 0, -60], 0.5, [0, 0, -30]),
        (lambda load: (load**2, 0, 0), 3, [9, 0, 0]),
    ):
        tool = ff.Tool(ff.Sphere(10, [0, 0, 0]), path=path, name="punch")
        assert tool.evaluate([[0, 0, 12]]).gap == [2]
        tool.at(load)
        assert np.array_equal(tool.displacement, moved)
        assert tool.evaluate([np.add(moved, [0, 0, 20])], reach=20).gap == [10]
    tool = ff.Tool(ff.Sphere(10), force=lambda load: (0, 0, -60 * load**2), name="press")
    tool.at(0.5)
    assert tool.push == 15 and np.array_equal(tool.direction, [0, 0, -1])
