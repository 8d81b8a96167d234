"""Contact with rigid tools, held, moved along a path and by force."""

import math
import re

import numpy as np
import pytest
import pyvista
from builders import Elastic, alone, bent, displacement, everywhere, near, off_differences, run
from builders import sheet as flat
from mpi4py import MPI
from scipy.spatial import Delaunay

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.job.space_validity import passed_through
from fabric_fenicsx.scene import output as reports
from fabric_fenicsx.solve.newton import Newton

COMM = MPI.COMM_WORLD
T, K = 0.4, 1000.0  # thickness [mm], penalty [N/mm^3]
S = 0.3 * 0.0125 * T  # depth up to which a rigid face is smoothed [mm]


def sheet(length, width, nx, ny, pattern="left", comm=COMM, **options):
    return flat(length, width, nx, ny, pattern, comm, spatial=True, **options)


SURFACES = {
    "sphere": ff.Sphere(10.0, (5, 5, -10)),
    "cylinder": ff.Cylinder((5, 5, -4), (1, 0.3, 0), 4.0),
    "double dome": ff.DoubleDome(),
}


def pressed_in(blank, tool, depth, start):
    """Displacements that put nodes at `start` (n, 3) as deep as `depth` (n,) into the ply's
    face."""
    x = start
    for _ in range(3):  # on a curved surface the normal there is that here
        found = tool.evaluate(x)
        x = x + (T / 2 - depth - found.gap)[:, None] * found.normal
    assert np.abs(tool.evaluate(x).gap - T / 2 + depth).max() < 1e-10
    return (x - blank.coordinates()).ravel()


def around(surface, blank):
    """Points near the surface, of the wall and its roundings for the dome."""
    x = blank.coordinates()
    if isinstance(surface, ff.DoubleDome):
        return np.column_stack([130 + 3 * x[:, 0], 20 + 6 * x[:, 1], 2 + 5 * x[:, 0]])
    return x


@pytest.mark.parametrize("side", ["outside", "inside"])
@pytest.mark.parametrize("kind", SURFACES)
@pytest.mark.parametrize("direction", [None, (0.2, 0.3, 1)])
def test_derivatives(kind, side, direction):
    surface = SURFACES[kind] if side == "outside" else ff.Reversed(ff.Offset(SURFACES[kind], 1.0))
    blank = sheet(10, 10, 5, 5, comm=MPI.COMM_SELF)
    contact = alone(blank, ff.Contact(ff.Tool(surface, name="tool"), T, K))
    # away from the kinks of the stiffness at depths 0 and s
    depth = S * np.resize([-0.5, 0.3, 0.7, 1.5, 3.0], len(blank.coordinates()))
    blank.u.x.array[:] = pressed_in(blank, contact.tool, depth, around(SURFACES[kind], blank))
    if direction:
        force, tool = contact.force(), contact.tool
        tool.direction = np.array(direction) / np.linalg.norm(direction)
        tool.direction *= np.sign(force @ direction)
        tool.push, tool.force, tool.travel = float(force @ tool.direction), True, 1.0  # to be found
        contact._response = None
        assert contact.force() @ tool.direction == pytest.approx(tool.push, rel=1e-11)
        assert abs(tool.travel) < 1e-8
    assert off_differences(contact) < 1e-6


def test_forces_are_derivatives_where_the_mid_surface_is_deep_in_the_tool():
    """Deeper than a ply is thick, where surfaces may tell a bound instead of the gap."""
    fabric, surface = ff.load("komeili"), SURFACES["double dome"]
    blank = sheet(10, 10, 5, 5, comm=MPI.COMM_SELF)
    contact = ff.Contact(ff.Tool(surface, name="tool"))
    ff.Scene(blank, [ff.Membrane(fabric), contact], [])
    depth = np.linspace(0.1, 4.0, len(blank.coordinates())) * fabric.thickness_under(0.0)
    blank.u.x.array[:] = pressed_in(blank, contact.tool, depth, around(surface, blank))
    assert off_differences(contact) < 1e-6


def test_tool_pushed_past_the_sheet_is_no_state():
    blank = sheet(10, 10, 2, 2, comm=MPI.COMM_SELF)
    ball = ff.Tool(ff.Sphere(5.0, (50, 0, -10)), force=(0, 0, 1.0), name="ball")
    contact = alone(blank, ff.Contact(ball, T, K))
    contact.set_load(1.0)
    assert math.isnan(contact.stored())


def test_what_is_told_of_a_pressed_face():
    """A rigid face 3 s deep in a slanted plane, and 2 mm off another, as the sheet is stretched by
    10 % along x; its energy stays while the areas grow."""
    blank, n = sheet(20, 10, 4, 2), np.array([0.6, 0.0, 0.8])
    wall = ff.Tool(ff.Plane((0, 0, 0), n), name="wall")
    other = ff.Tool(ff.Plane((T + 2) * n, -n), name="other")
    contact, far = ff.Contact(wall, T, K), ff.Contact(other, T, K)
    scene, X = ff.Scene(blank, [Elastic(), contact, far], []), blank.coordinates()
    x = 1.1 * X[:, :1] * [0.8, 0, -0.6] + X[:, 1:2] * [0, 1, 0] + (T / 2 - 3 * S) * n
    blank.u.x.array[:] = (x - X).ravel()
    pressure, energy = K * 2.5 * S, K * (S**2 / 6 + 2 * S * 1.5 * S)
    assert contact.energies()["contact"] == pytest.approx(energy * 200)
    assert contact.update_lagged() and contact.energies()["contact"] == pytest.approx(energy * 200)
    assert contact.force() == pytest.approx(pressure * 220 * n)
    fields = reports.nodal_fields(scene)
    count = len(fields["contact_gap"])
    assert fields["contact_traction"] == pytest.approx(np.tile(pressure * n, (count, 1)))
    assert fields["contact_pressure"] == pytest.approx(np.full(count, pressure))
    assert fields["contact_gap"] == pytest.approx(np.full(count, -3 * S))
    assert contact.penetration() == pytest.approx(3 * S)


def test_a_pressure_that_grows_does_the_mean_times_the_way():
    """On a sheet of unequal cells that tilts, by p A w / 2; then at rest none."""
    shape = lambda x: np.column_stack([x[:, 0] ** 2 / 20, x[:, 1:]])  # noqa: E731
    blank = sheet(20, 10, 4, 2, shape=shape)
    holder = ff.BlankHolderPressure(lambda at: 2 * at, (0, 0, -1), lambda x: 0 * x[0] + 1, lag=1e-3)
    alone(blank, holder)
    holder.accept()
    holder.set_load(1.0)
    blank.u.x.array[2::3] = -0.1 * blank.coordinates()[:, 0]
    assert COMM.allreduce(holder.work()) == pytest.approx(1.0 * 200 * 1.0, rel=1e-9)
    assert COMM.allreduce(holder.energies()[None]) == pytest.approx(-2.0 * 200 * 1.0)
    holder.accept()
    assert COMM.allreduce(holder.work()) == 0.0
    blank.u.x.array[:] = 0.0  # up to the second of columns that are 1.25, 3.75, 6.25 and 8.75 wide
    ones = lambda x: 0 * x[0] + 1  # noqa: E731
    part = alone(blank, ff.BlankHolderPressure(1.0, (0, 0, -1), lambda x: x[0] < 5, borne=ones))
    assert part.force() == pytest.approx([0, 0, -50.0], rel=1e-9)


@pytest.mark.parametrize("growth, taken", [(0.009, False), (0.011, True)])
def test_areas_are_taken_anew_where_they_change_forces_by_one_per_cent(growth, taken):
    blank = sheet(20, 10, 4, 2)
    table = ff.Tool(ff.Plane((0, 0, -T / 2), (0, 0, 1)), name="table")
    contact = alone(blank, ff.Contact(table, T, K, friction=ff.Coulomb(0.1, lag=0.5)))
    u = blank.u.x.array.reshape(-1, 3)
    u[:, 0], u[:, 2] = growth / (1 - growth) * blank.coordinates()[:, 0], -S
    assert contact._update_pressing() == taken


def over_a_bar(nx, pattern, penalty=1e4, tension=5.0):
    """Contact of a strip laid around a quarter of a bar of radius 10 mm, by its middle surface, and
    pulled at both ends; the largest error of the pressure, T / R."""
    radius, angle, tail, width = 10.0, math.pi / 2, 2.0, 4.0
    length = radius * angle + 2 * tail
    shape, *ways = bent(radius, angle, tail)
    last = abs(shape(np.array([[length, 0, 0]]))[0, 0])
    blank = sheet(length, width, nx, 4, pattern, shape=shape, a=np.array([1.0, 0, 0]))
    bar = ff.Tool(ff.Cylinder((0, 0, 0), (0, 1, 0), radius - T / 2), name="bar")
    contact, supports = ff.Contact(bar, T, penalty), [ff.Support("side", near(1, 0.0), (1,))]
    ends = (lambda x, s=s: s * x[0] > last - 1e-6 for s in (-1, 1))
    pulls = [ff.EdgeTension(lambda v: v * tension, way, end) for way, end in zip(ways, ends)]
    supports.append(ff.Support("middle", near(0, 0.0), (0,)))
    run(ff.Scene(blank, [Elastic(1e5), contact, *pulls], supports), 2)
    assert contact.force()[2] == pytest.approx(2 * tension * width * math.sin(angle / 2), rel=1e-6)
    inside = np.abs(np.arctan2(*contact.nodes.places[:, [0, 2]].T)) < 0.4 * angle
    errors = np.abs(contact.state().pressure[inside] / (tension / radius) - 1)
    return COMM.allreduce(errors.max(initial=0.0), MPI.MAX)


@pytest.mark.versions
@pytest.mark.mpi
def test_strip_over_a_cylinder():
    """Where nodes lie on lines along the bar the contact pressure is T / R."""
    errors = [over_a_bar(nx, "left") for nx in (12, 24, 96)]
    assert errors[0] < 1e-2 and errors[1] < 1e-3 and errors[2] < 2e-4
    # elsewhere it scatters, the less the finer the mesh and the softer the contact
    errors = [over_a_bar(nx, "crossed", penalty=100) for nx in (24, 96)]
    assert errors[0] < 0.05 and errors[1] < 0.45 * errors[0]


def disc(rings, radius):
    """A circular sheet of that many rings of nodes."""
    points, cells = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    if COMM.rank == 0:
        r = np.append(0, np.repeat(np.arange(1, rings + 1), 6 * np.arange(1, rings + 1)))
        t = np.append(0, [k / i * np.pi / 3 for i in range(1, rings + 1) for k in range(6 * i)])
        points = radius / rings * np.column_stack([r * np.cos(t), r * np.sin(t), 0 * r])
        cells = Delaunay(points[:, :2]).simplices.astype(np.int64)
    return ff.Blank(compat.create_mesh(COMM, cells, points, "triangle", 1), a=0.0)


def test_circular_membrane_under_pressure():
    """Clamped, of nu = 0.3: w = 0.6534 a (p a / E h)^(1/3) at its centre, by H. Hencky, Z. Math.
    Phys. 63 (1915), in the corrected series of W. B. Fichter, NASA TP-3658 (1997), whose b_0 is
    1.7244."""
    a, stiffness, pressure, errors = 50.0, 1e3, 1e-4, []
    exact = 0.6534 * a * (pressure * a / stiffness) ** (1 / 3)
    for rings in (6, 12):
        blank = disc(rings, a)
        rim = ff.Support("rim", lambda x: np.hypot(x[0], x[1]) > a - 1e-6, (0, 1, 2))
        gas = ff.DeadPressure(pressure, (0, 0, 1))
        scene = ff.Scene(blank, [Elastic(stiffness, nu=0.3), gas], [rim])
        radii = np.linalg.norm(blank.coordinates()[: scene.u.local_size // 3], axis=1)
        scene.u.array[2::3] = 1e-3 * exact * (1 - (radii / a) ** 2)
        x = scene.u.copy()
        scene.set_load(1.0)
        report = Newton(scene).solve(x)
        assert report.converged, report.reason
        rise = COMM.allreduce(displacement(blank)[:, 2].max(initial=0.0), MPI.MAX)
        errors.append(rise / exact - 1)
    assert abs(errors[0]) < 0.02 and abs(errors[1]) < 0.4 * abs(errors[0])


@pytest.mark.mpi
def test_two_balls_pushed_by_force():
    """However far they have to go for it; each gives way, so that the tangent loses a matrix of
    rank two. Newton's method converges in second order."""
    blank, places = sheet(40, 20, 16, 8), (13, 26)
    spheres = {x: ff.Sphere(5.0, (x, 10, -5 - T / 2)) for x in places}
    balls = [ff.Tool(b, force=(0, 0, 10.0 + x), name=f"ball {x}") for x, b in spheres.items()]
    contacts = [ff.Contact(ball, T, K) for ball in balls]
    on_rim = lambda x: (abs(x[:2] - [[20], [10]]) > [[20 - 1e-6], [10 - 1e-6]]).any(0)  # noqa: E731
    rim = ff.Support("rim", on_rim, (0, 1, 2))
    scene = ff.Scene(blank, [Elastic(1e3), *contacts], [rim])
    states = run(scene, 4)
    for contact, x in zip(contacts, places):
        assert contact.force()[2] == pytest.approx(10 + x, rel=1e-9)
    assert scene.reaction("rim")[2] == pytest.approx(-20 - sum(places), rel=1e-6)
    fall = np.diff(np.log(states[-1].report.residuals))
    assert fall[-1] / fall[-2] > 1.6


@pytest.mark.parametrize("pattern, sheared", [("crossed", 0.0), ("left", 0.0), ("crossed", 0.5)])
def test_a_ring_is_pressed_by_its_area(pattern, sheared):
    """Of 30 mm, three cells wide, also on a flange that is sheared [rad]."""
    blank = sheet(200, 200, 20, 20, pattern)
    ring = lambda x: abs(np.hypot(x[0] - 100, x[1] - 100) - 65) < 15  # noqa: E731
    holder = alone(blank, ff.BlankHolderPressure(0.1, (0, 0, -1), ring))
    y, u = blank.coordinates()[:, 1] - 100, blank.u.x.array.reshape(-1, 3)
    u[:, 0], u[:, 1] = math.sin(sheared) * y, (math.cos(sheared) - 1) * y
    holder.set_load(1.0)
    holder.accept()
    pressed = holder.nodes.total(holder.applied_forces().reshape(-1, 3))
    assert pressed[2] == pytest.approx(-0.1 * math.pi * (80**2 - 50**2), rel=0.01)


def test_corners_beyond_the_die_are_not_pressed():
    """The holder ends within the last row of cells, 7 of 10 mm; the row's other nodes bear it."""
    blank = sheet(10, 10, 2, 2)
    holder = alone(blank, ff.BlankHolderPressure(1.0, (0, 0, -1), lambda x: x[0] < 7))
    holder.set_load(1.0)
    forces = holder.applied_forces().reshape(-1, 3)[:, 2]
    beyond = holder.nodes.places[:, 0] > 7
    total, lifted = (holder.nodes.total(each) for each in (forces, np.where(beyond, forces, 0.0)))
    assert total == pytest.approx(-70, rel=0.05) and abs(lifted) < 1e-2 * abs(total)


def on(die, where):
    """The mask `where` as the flange of a die below the sheet."""
    where.die, where.up = die, -1
    return where


def test_a_pressure_without_friction_acts_along_the_normals_of_the_die():
    """Near to it and far off."""
    blank = sheet(10, 10, 5, 5, comm=MPI.COMM_SELF)
    die = ff.Tool(SURFACES["sphere"], name="die")
    holder = ff.BlankHolderPressure(0.5, (0, 0, -1), on(die, lambda x: x[0] < 100))
    alone(blank, holder, ff.Contact(die, T, K))
    depth = np.linspace(-5 * T, T, len(blank.coordinates()))
    blank.u.x.array[:] = pressed_in(blank, die, depth, blank.coordinates())
    assert off_differences(holder) < 1e-6
    forces = holder.applied_forces().reshape(-1, 3)
    normals = die.evaluate(holder.nodes.places + holder.nodes.displacement()).normal
    assert (forces * normals).sum(1) == pytest.approx(-holder.normal_forces())
    assert abs(np.cross(forces, normals)).max() < 1e-12 * abs(forces).max()


def test_what_a_face_gives_back_as_it_leaves_the_holder_is_work():
    """A sheet is pressed on a table and led out from under the holder, half of it."""
    blank, die = sheet(20, 10, 8, 4), ff.Tool(ff.Plane((0, 0, -T / 2), (0, 0, 1)), name="table")
    flange = on(die, lambda x: x[0] < 20 + 1e-6)
    holder = ff.BlankHolderPressure(5.0, (0, 0, -1), flange, lag=1e-3)
    led = [ff.Support("all", everywhere, (0, 1), (10.0, 0.0, 0.0))]
    start, *_, end = run(ff.Scene(blank, [Elastic(), ff.Contact(die, T, K), holder], led), 5)
    given_back = start.energies["contact"] - end.energies["contact"]
    assert given_back == pytest.approx(start.energies["contact"] / 2, rel=0.1)
    missing = end.external_work - sum(end.energies.values())
    assert abs(missing) < 1e-2 * given_back


def test_pressed_areas_that_alternate_are_left_alone_in_the_end():
    """Three times in a step they are taken anew, and in the next step again."""
    shares = iter(np.repeat([0.0, 0.0] + 10 * [1.0, 0.5], 2))  # asked twice each time
    under = lambda x: np.full(x.shape[1], next(shares))  # noqa: E731
    press = ff.BlankHolderPressure(1.0, (0, 0, 1), under, lag=0.01)
    alone(sheet(10, 10, 2, 2), press)
    for factor in (0.5, 1.0):
        press.set_load(factor)
        assert [press.update_lagged() for _ in range(5)] == [True, True, True, False, False]


def ball(radius_within=None):
    """Triangles of a ball of 10 mm, hollow if a radius is given."""
    outer = pyvista.Sphere(radius=10.0, theta_resolution=24, phi_resolution=24)
    points, cells = np.array(outer.points, float), outer.regular_faces
    if radius_within:
        points = np.vstack([points, points * radius_within / 10])
        cells = np.vstack([cells, cells[:, ::-1] + len(points) // 2])
    return ff.TriangulatedSurface(points + [20, 20, -10 - T / 2], cells)


def pushed(surface):
    """Force [N] and shape of a clamped sheet that a tool pushes up by 4 mm in one step."""
    blank = sheet(40, 40, 10, 10, "crossed")
    contact = ff.Contact(ff.Tool(surface, path=(0, 0, 4.0), name="tool"), T, K, friction=0.2)
    on_rim = lambda x: (abs(x[:2] - 20) > 20 - 1e-6).any(0)  # noqa: E731
    scene = ff.Scene(blank, [Elastic(1e3), contact], [ff.Support("rim", on_rim, (0, 1, 2))])
    run(scene, 1)
    assert not passed_through(scene)
    return contact.force()[2], displacement(blank)


def test_a_wall_presses_as_a_solid():
    """However far a step takes it."""
    (force, shape), (right, same) = pushed(ball(9.5)), pushed(ball())
    assert right > 100 and force == pytest.approx(right, rel=1e-6)
    assert abs(shape - same).max() < 1e-5


@pytest.mark.parametrize(
    "way, up, sentence",
    [
        ([(28, 1.0), (28, -0.8)], 1, "5 nodes of blank passed through .* up to 0.6 mm behind .*"),
        ([(28, 1.0), (28, -1.2)], 1, "5 nodes of blank passed through .* up to 1 mm behind .*"),
        ([(28, 1.0), (31, 1.0), (31, -1.2), (28, -1.2)], -1, ""),  # round its edge at x = 30
    ],
)
def test_a_node_goes_round_a_wall_but_not_through_it(way, up, sentence):
    """Of a plate from z = -1.1 to -0.2; nodes that are all in one place are pressed up or down."""
    blank = sheet(4, 4, 1, 1, "crossed")
    plate = ff.Block(20, 14, 0.9, 0.4, 3.0, centre=(20, 20, -T / 2))
    contact = ff.Contact(ff.Tool(plate, name="plate"), T, K)
    scene = ff.Scene(blank, [Elastic(), contact], [])
    for x, z in way:
        blank.u.x.array[:] = ([x, 20, z] - blank.coordinates()).ravel()
        scene.set_load(1.0)
        force, told = contact.force()[2], "".join(passed_through(scene))
        scene.accept()
    assert np.sign(force) == up and re.fullmatch(sentence, told)
