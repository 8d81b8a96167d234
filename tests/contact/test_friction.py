"""Coulomb friction of sheets on tools."""

import math

import numpy as np
import pytest
from builders import (
    Elastic,
    alone,
    bent,
    displacement,
    everywhere,
    march,
    near,
    off_differences,
    run,
)
from builders import sheet as flat
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.contact.friction import FrictionState
from fabric_fenicsx.contact.holder_pressure import LineBead
from fabric_fenicsx.scene import output as reports
from fabric_fenicsx.solve.checkpoint import Checkpoint
from fabric_fenicsx.solve.newton import Newton

COMM = MPI.COMM_WORLD
T, K = 0.4, 1000.0  # thickness [mm], penalty [N/mm^3]
MU, SLIP, PRESSURE, AREA = 0.3, 0.01, 2.0, 200.0
SMOOTHING = 1.5e-3  # of the table [mm]


def sheet(length, width, nx, ny, comm=COMM, **options):
    return flat(length, width, nx, ny, "left", comm, spatial=True, **options)


def on_nodes(term):
    """Forces of a term on the nodes (nodes, 3)."""
    return term.applied_forces().reshape(-1, 3)


@pytest.mark.parametrize("pushed", [False, True])
@pytest.mark.parametrize("distance", [0.3, 3.0, 100.0])
def test_derivatives(distance, pushed):
    """Sticking, partly sliding and sliding on a ball, held or moved by a slanted force that
    friction helps to bear."""
    blank = sheet(10, 10, 5, 5, MPI.COMM_SELF)
    ball = ff.Tool(ff.Sphere(10.0, (5, 5, -10)), name="ball")
    contact = alone(blank, ff.Contact(ball, T, K, friction=ff.Coulomb(MU, SLIP)))
    x, u = blank.coordinates(), blank.u.x.array
    depth = np.resize([-0.5, 0.3, 0.7, 1.5, 3.0], len(x)) * SMOOTHING
    for _ in range(3):
        nearest = ball.evaluate(x)
        x = x + (T / 2 - depth - nearest.gap)[:, None] * nearest.normal
    u[:] = (x - blank.coordinates()).ravel()
    contact.accept()
    limit = MU * contact.normal_forces()
    # further along the ball, as far as `distance` slips
    moved = np.cross(x - [5, 5, -10], [1.0, -0.3, 0.5]) * np.linspace(0.1, 1, len(x))[:, None]
    u[:] += (moved * distance * SLIP / np.linalg.norm(moved, axis=1).max()).ravel()
    if pushed:
        force = on_nodes(contact).sum(0)
        ball.direction = np.array([0.3, 0.2, 1]) / math.sqrt(1.13)
        ball.direction *= np.sign(force @ ball.direction)
        ball.push, ball.force = float(force @ ball.direction), True
        ball.travel = 0.3 * SLIP  # to be found back
        contact._response = None
        assert on_nodes(contact).sum(0) @ ball.direction == pytest.approx(ball.push, rel=1e-11)
        assert abs(ball.travel) < 1e-8
    rubbing = np.linalg.norm(contact.friction_state.forces(), axis=1)
    slides = ((limit > 0) & (rubbing > (1 - 1e-9) * limit)).sum()
    assert {0.3: slides == 0, 3.0: 0 < slides < len(x), 100.0: slides > len(x) / 2}[distance]
    assert off_differences(contact) < 1e-6


def on_table(**options):
    """That patch alone, and its contact with a table."""
    blank = sheet(20, 10, 4, 2)
    table = ff.Tool(ff.Plane((0, 0, -T / 2), (0, 0, 1)), (3.0, 0, 0), name="table")
    return blank, alone(blank, ff.Contact(table, T, K, **options))


def patch(place, tool_path=(0.0, 0.0, 0.0)):
    """A patch of 200 mm^2, pressed onto a table by 2 MPa; place: function of the load to its
    displacement along x, if not None."""
    blank = sheet(20, 10, 4, 2)
    table = ff.Tool(ff.Plane((0, 0, -T / 2), (0, 0, 1)), tool_path, name="table")
    table = ff.Contact(table, T, K, friction=ff.Coulomb(MU, SLIP, math.inf))
    press = ff.BlankHolderPressure(PRESSURE, (0, 0, -1), lambda x: np.ones(x.shape[1]))
    # what presses it is there from the start, so contact is too
    blank.u.x.array[2::3] = -(PRESSURE / K + SMOOTHING / 2)

    def moved(x, load):
        return np.array([np.full(x.shape[1], place(load)), 0 * x[0], 0 * x[0]])

    grip = ff.Support("grip", everywhere, (0,), moved)
    held = [*([grip] if place else []), ff.Support("y", everywhere, (1,))]
    return ff.Scene(blank, [Elastic(1e3), table, press], held), table


@pytest.mark.versions
def test_stick_slip():
    """Force mu p A x / slip in sticking, mu p A in sliding, there and back again; all energies add
    up to the work."""
    limit, curve, states = MU * PRESSURE * AREA, [], []
    scene, _ = patch(lambda load: 5 * SLIP * (1 - abs(2 * load - 1)))

    def note(state):
        states.append(state)
        at = displacement(scene.blank)[0, 0], scene.reaction("grip")[0]
        curve.append((*at, state.energies["friction"]))

    assert not march(Newton(scene), 20, on_accept=note).reason
    # steps of half the slip: 2 to stick, 8 to slide, 4 back until it slides the other way
    x, force, taken = np.array(COMM.bcast(curve)).T
    way = [0, 0.5, *[1.0] * 9, 0.5, 0, -0.5, *[-1.0] * 7]
    assert force == pytest.approx(limit * np.array(way), rel=1e-6, abs=1e-6 * limit)
    work = np.append(0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(x)))
    assert taken == pytest.approx(work, rel=1e-6, abs=1e-9)
    # the loop: what was slid there, 4 slips, and back, 3 slips, and what is left elastic
    assert taken[-1] == pytest.approx(limit * SLIP * (4 + 3 + 0.5), rel=1e-6)
    for state in states:
        assert sum(state.energies.values()) == pytest.approx(state.external_work, rel=1e-6)


def test_table_drags_a_patch_along():
    """What the table's motion does is the support's force with the opposite sign; a patch that
    nothing holds goes with it."""
    scene, table = patch(lambda load: 0.0, tool_path=(0.1, 0, 0))
    states = run(scene, 10)
    limit = MU * PRESSURE * AREA
    assert scene.reaction("grip")[0] == pytest.approx(-limit, rel=1e-6)
    assert reports.tool_force(scene, table.tool)[0] == pytest.approx(limit, rel=1e-6)
    start, end = (sum(states[k].energies.values()) for k in (0, -1))
    assert end - start == pytest.approx(limit * (0.1 - SLIP / 2), rel=1e-6)
    assert states[-1].external_work == pytest.approx(end, rel=1e-6)
    scene, _ = patch(None, tool_path=(0.1, 0, 0))
    run(scene, 10)
    assert displacement(scene.blank)[:, 0] == pytest.approx(0.1, rel=1e-6)


@pytest.mark.mpi
def test_capstan():
    """A strip around a bar, pulled over it at one end against a dead pull at the other: T_2 / T_1 =
    e^(mu theta R / r), as friction acts on the bar's radius R, tension on the mid-surface's r."""
    radius, theta, tail, width, pull, slid = 10.0, math.pi / 2, 2.0, 2.0, 2.0, 0.05
    length = radius * theta + 2 * tail
    shape, *ways = bent(radius, theta, tail)
    out = np.array(ways)
    last = shape(np.array([[0, 0, 0], [length, 0, 0.0]]))[:, :, None]
    ends = [lambda x, p=p: np.linalg.norm((x - p)[::2], axis=0) < 1e-6 for p in last]
    blank = sheet(length, width, 18, 1, shape=shape, a=np.array([1.0, 0, 0]))
    bar = ff.Tool(ff.Cylinder((0, 0, 0), (0, 1, 0), radius - T / 2), name="bar")
    contact = ff.Contact(bar, T, K, friction=ff.Coulomb(MU, 1e-3, lag=1e-5))
    # the far end is pulled at once, then the near one is drawn off
    weight = ff.EdgeTension(lambda load: pull * min(1.0, 2 * load), out[0], ends[0])

    def drawn(x, load):
        return np.outer(out[1], np.full(x.shape[1], max(0.0, 2 * load - 1) * slid))

    supports = [ff.Support("drawn end", ends[1], (0, 1, 2), drawn)]
    supports.append(ff.Support("side", near(1, 0.0), (1,)))
    scene = ff.Scene(blank, [Elastic(1e4), contact, weight], supports)
    run(scene, 20)
    tension = scene.reaction("drawn end") @ out[1] / width
    moment_arm = 1 - T / 2 / radius
    assert tension / pull == pytest.approx(math.exp(MU * theta * moment_arm), rel=0.01)


@pytest.mark.mpi
def test_a_resumed_run_knows_what_no_displacement_tells(shared_path):
    """What its march cost, what its solver met and how deep nodes once were."""
    ends, start = [], None
    for resumed in (False, True):
        scene, contact = patch(lambda load: 5 * SLIP * (1 - abs(2 * load - 1)))
        newton, states = Newton(scene, tolerance=1e-11), []
        checkpoint = Checkpoint(shared_path / "c.npz", scene.blank, {})
        if resumed:
            start, _ = checkpoint.load()
            (depth,) = [name for name in start.memory if name.endswith("depth")]
            start.memory[depth] = start.memory[depth] + 7.0
            before = start.iterations
        else:
            newton.recall({"negative_pivots_met": True, "shift": 0.125})

        def keep(state):
            states.append(state)
            if state.load == 0.5 and not resumed:
                checkpoint.save(state.progress, {})

        outcome = march(newton, 8, on_accept=keep, milestones=[0.5], start=start)
        assert not outcome.reason
        ends.append((outcome, contact.largest_penetration(), states[-1]))
    (first, deep, last), (second, deeper, end) = ends
    assert end.energies == pytest.approx(last.energies, rel=1e-7)
    assert 7 < deeper <= 7 + deep
    assert (second.accepted, second.rejected) == (first.accepted, first.rejected)
    assert second.iterations >= before + sum(state.report.iterations for state in states)
    assert newton.memory()["negative_pivots_met"] and newton.memory()["shift"] > 0


@pytest.mark.mpi
@pytest.mark.parametrize("across", [0.0, 0.75])
def test_a_strip_drawn_through_a_bead_needs_width_times_restraint(across):
    """Times the length of the line on it over the width, if the line is oblique, and friction mu p
    on 1200 mm2 of a holder; and nothing more as the strip goes on."""
    strip = sheet(60, 20, 13, 5)
    ends = [(30 + across * (y - 10), y) for y in (-30, 50)]
    bead = LineBead(ends, restraint=2.0)
    holder = ff.BlankHolderPressure(0.05, (0, 0, 1), everywhere, friction=0.2)
    held = [ff.Support("end", near(0, 60.0), (0, 1, 2), (6.0, 0, 0))]
    held.append(ff.Support("flat", everywhere, (1, 2)))
    scene = ff.Scene(strip, [Elastic(1e5), bead, holder], held)
    for steps in (3, 4):  # once more from where it is
        run(scene, steps)
        assert bead.restrained() == pytest.approx(40 * np.hypot(1, across), rel=3e-3)
        pull = bead.restrained() + 0.2 * 0.05 * 1200
        assert scene.reaction("end")[0] == pytest.approx(pull, rel=1e-3)


def test_elastic_slip():
    """By default what sticks is as stiff as told, from 0.1 micrometres to 0.1 mm."""
    limit = np.array([1e-3, 0.02, 5.0, 50.0])
    slips = ff.Coulomb(MU).slips(limit, 100.0)
    assert slips == pytest.approx([1e-4, 2e-4, 0.05, 0.1])
    z = np.array([[0.03, 0.04, 0.0]]) * [[0.5], [1], [2]]
    energy, force = ff.Coulomb(MU, 0.05).potential(z, np.full(3, 2.0))
    assert energy == pytest.approx([2 * 0.025**2 / 0.1, 0.05, 0.05 + 2 * 0.05])
    assert force == pytest.approx(np.array([[-0.6, -0.8, 0]]) * [[1], [2], [2]])
    assert ff.Coulomb(MU, 0.05).elastic(z, np.full(3, 2.0)) == pytest.approx(z * [[1], [1], [0.5]])
    assert ff.Coulomb({"a": 0.1, "b": 0.3}).largest == 0.3
    assert ff.Coulomb(ff.Field(lambda x, y, z: 0.1 + 0 * x)).largest > 0


def test_a_stuck_sheet_is_as_stiff_as_a_twentieth_of_its_triangles():
    """Of E t / (1 - nu) each; in series with the sheet that it lies on."""
    stiff = lambda t: 186600.0 * t / 0.7  # noqa: E731
    metal = ff.Metal(186600.0, 0.3, ff.Swift(500.0, 0.0005, 0.2), thickness=0.5)
    shares = []
    table = ff.Tool(ff.Plane((0, 0, -0.25), (0, 0, 1)), name="table")
    contact = ff.Contact(table, friction=MU)
    blank = sheet(20, 10, 4, 2)
    ff.Scene(blank, [contact, ff.SheetMetal(metal)], [])
    shares.append((contact, 16 * stiff(0.5)))
    stack = ff.Stack([(sheet(20, 10, 2, 1), 0.5, "a"), (sheet(20, 10, 4, 2), 1.5, "b")])
    pair = ff.SheetContact("a", "b", friction=MU)
    metals = [ff.SheetMetal(metal.replace(thickness=t)).on(k) for t, k in ((0.5, "a"), (1.5, "b"))]
    ff.Scene(stack, [*metals, pair], [])
    shares.append((pair, 16 / (1 / stiff(0.5) + 1 / stiff(1.5))))
    for term, whole in shares:
        each = np.broadcast_to(term.friction_state._stiffness, len(term.normal_forces()))
        assert COMM.allreduce(each.sum()) == pytest.approx(0.05 * whole, rel=1e-6)


def test_the_share_of_friction_that_is_used():
    """By what points can bear; the largest of all states, 1 where a point slid."""
    blank, contact = on_table(friction=ff.Coulomb(MU, SLIP))
    u, (x, _, _) = blank.u.x.array.reshape(-1, 3), blank.coordinates().T
    left = x < 9.0  # three eighths of the area, which bear 1 / (1 + 5 / 3 * 4) of it
    u[:, 2] = np.where(left, -1.5, -4.5) * SMOOTHING
    contact.accept()
    for way, used in ((0.5, 0.5), (0.0, 0.5), (2.0, None)):
        u[:, 0] = np.where(left, 0.25, 1.0) * way * SLIP
        contact.accept()
        if used:
            told = np.where(left, 0.25, 1.0) * used
            assert contact.friction_state.slip_ratio == pytest.approx(told)
    share = 1 / (1 + 5 / 3 * 4)
    assert contact.friction_used() == pytest.approx((0.5 * share + 1 - share, 1 - share), rel=1e-6)


class Moved:
    """A point that slides on a face across a normal."""

    def __init__(self, normal, way=(0.0, 0.0, 0.0)):
        self.normals, self.way = np.array([normal]), np.array([way])

    def slid(self):
        return self.way

    def exact(self, now):
        return self.way


def test_elastic_slip_turns_with_the_face():
    """As long as it was, where the face turns by 60 deg."""
    c, s, force, here = 0.5, math.sqrt(0.75), np.array([10.0]), Moved((0, 0, 1.0))
    state = FrictionState(ff.Coulomb(0.3, 0.1), 0.3, force, here, MPI.COMM_SELF)
    here.way = np.array([[0.05, 0, 0.7]])
    state.accept(force, Moved((s, 0, c)))
    assert state.memory()["slip"] == pytest.approx(0.05 * np.array([[c, 0, -s]]))


def test_a_friction_that_is_a_field_is_that_of_the_place_on_the_tool():
    """As it stood at first: a table that goes on by 3 mm takes its coefficients along."""
    field = ff.Field(lambda x, y, z: 0.3 + 0.01 * x + 0.1 * z)
    _, contact = on_table(friction=field)
    x = contact.nodes.places[:, 0]
    for load in (0.0, 1.0):
        contact.set_load(load)
        contact.accept()
        mu = 0.3 + 0.01 * (x - 3.0 * load) - 0.1 * T / 2
        assert contact.friction_state.coefficient == pytest.approx(mu)


@pytest.mark.parametrize("growth, taken", [(1.09, False), (1.13, True)])
def test_friction_is_taken_anew_where_it_changes_by_more_than_the_lag(growth, taken):
    """Of a tenth: from P to 1.09 P it changes by 8.3 % of that, to 1.13 P by 11.5 %."""
    blank, contact = on_table(friction=ff.Coulomb(MU, SLIP, lag=0.1))
    u = blank.u.x.array.reshape(-1, 3)
    u[:] = [0, 0, -2.5 * SMOOTHING]
    contact.accept()
    u[:] = [2 * SLIP, 0, -(2 * growth + 0.5) * SMOOTHING]
    assert contact.update_lagged() == taken


@pytest.mark.parametrize("lag, followed", [(0.01, True), (math.inf, False)])
def test_normal_forces_follow_within_a_step(lag, followed):
    """A patch pressed from nothing to 2 s deep and dragged at once: friction is asked for anew,
    once, if lag says so."""
    blank, contact = on_table(friction=ff.Coulomb(MU, SLIP, lag))
    blank.u.x.array.reshape(-1, 3)[:] = [5 * SLIP, 0, -2 * SMOOTHING]
    assert abs(on_nodes(contact)[:, :2]).max() == 0
    assert contact.update_lagged() == followed and not contact.update_lagged()
    normal = contact.force()[2]
    assert normal == pytest.approx(K * 1.5 * SMOOTHING * AREA)
    drag = on_nodes(contact).sum(0)[0]
    assert drag == pytest.approx(-MU * normal if followed else 0.0, abs=1e-12)
    # on the way there friction could bear half of that
    taken = MU * normal / 2 * 4.5 * SLIP if followed else 0.0
    assert COMM.allreduce(contact.energies()["friction"]) == pytest.approx(taken)
    contact.set_load(0.0)  # a step that failed forgets
    assert abs(on_nodes(contact)[:, :2]).max() == 0


def test_a_pressure_that_falls_takes_what_the_elastic_slip_held():
    """Energy is neither lost nor made as the load is set, also when a step is repeated."""
    blank, falls = sheet(20.0, 10.0, 4, 2), lambda load: PRESSURE * (1 - load / 2)
    rubs = {"friction": ff.Coulomb(MU, SLIP)}
    pressing = ff.BlankHolderPressure(falls, (0, 0, -1), lambda x: 0 * x[0] + 1, **rubs)
    alone(blank, pressing)
    blank.u.x.array[::3] = SLIP / 2
    pressing.accept()
    held = MU * PRESSURE * AREA * SLIP / 8
    taken = lambda: COMM.allreduce(pressing.energies()["friction"])  # noqa: E731
    for load in (0.0, 1.0, 0.5, 1.0):
        pressing.set_load(load)
        assert taken() == pytest.approx(held, rel=1e-12)
    blank.u.x.array[::3] = SLIP
    assert taken() == pytest.approx(held * (1 + 3 / 2), rel=1e-12)
    pressing.accept()
    assert taken() == pytest.approx(held * (1 + 3 / 2), rel=1e-12)


def test_the_face_slides_on_a_bar_not_the_mid_surface():
    """A strip led round a bar: its face slides by R phi, the mid-surface by (R + T / 2) phi."""
    R, phi, depth = 5.0, 0.3, 0.01
    blank, r = sheet(4, 2, 16, 4), R + T / 2 - depth
    bar = ff.Tool(ff.Cylinder((0, 0, -R - T / 2), (0, 1, 0), R), name="bar")

    def moved(x, load):
        angle = x[0] / r + phi * load
        return np.array([r * np.sin(angle), x[1], r * np.cos(angle) - R - T / 2]) - x

    contact = ff.Contact(bar, T, K, friction=ff.Coulomb(MU, SLIP, lag=0.01))
    led = ff.Support("led", everywhere, (0, 1, 2), moved)
    scene = ff.Scene(blank, [Elastic(1e-6), contact], [led])
    blank.u.x.array[:] = moved(blank.coordinates().T, 0.0).T.ravel()
    states = run(scene, 40)
    pressed = COMM.allreduce(contact.normal_forces().sum())
    taken = states[-1].energies["friction"] / (MU * pressed) + SLIP / 2
    assert taken == pytest.approx(R * phi, rel=5e-3)
