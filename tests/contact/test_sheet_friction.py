"""Coulomb friction between sheets."""

import math

import numpy as np
import pytest
from builders import COMM, Elastic, everywhere, near, off_differences, said
from builders import sheet as rectangle
from scipy.optimize import brentq

import fabric_fenicsx as ff

T, MU, SLIP, PRESSURE = 1.0, 0.3, 0.05, 2.0
LENGTH, WIDTH = 40.0, 20.0
NAMES = "lower", "middle", "upper"
PENALTY = 200.0


def everyone(x):
    return np.ones(x.shape[1])


def pull_out(path, rigid=True, cells=6, others=5, steps=8, t=T):
    """The middle of three sheets of thickness t pulled by path(load) [mm] along x, all of it if
    `rigid`, otherwise at its end, under pressure on the upper one; the other two, of `others`
    cells, held in their planes."""
    numbers = zip((others, cells, others), NAMES)
    blanks = ((rectangle(LENGTH, WIDTH, n, n // 2, spatial=True), k) for n, k in numbers)
    stack = ff.Stack([(blank, t, k) for blank, k in blanks])

    def on(name, rigid=True):
        low = (NAMES.index(name) - 0.5) * t
        return lambda x: (x[2] > low) & (x[2] < low + t) & (rigid | near(0, LENGTH)(x))

    def moved(x, load):
        return np.array([np.full(x.shape[1], path(load)), 0 * x[0], 0 * x[0]])

    rubbing = {"friction": ff.Coulomb(MU, SLIP)}
    contacts = [ff.SheetContact(*pair, PENALTY, **rubbing) for pair in (NAMES[:2], NAMES[1:])]
    press = ff.BlankHolderPressure(PRESSURE, (0, 0, -1), everyone).on("upper")
    held = [ff.Support("lower sheet", on("lower"), (0, 1, 2))]
    held += [ff.Support("upper sheet", on("upper"), (0, 1))]
    held += [ff.Support("grip", on("middle", rigid), (0,), moved)]
    held += [ff.Support("across", on("middle"), (1,))]
    scene = ff.Scene(stack, [Elastic(1e4), *contacts, press], held)
    depth = contacts[0].depth_under(PRESSURE)
    stack.u.x.array[2::3] = -depth * np.rint(stack.coordinates()[:, 2] / T)
    setup = ff.Setup(scene)
    setup.measure = lambda scene, load: (path(load), float(scene.reaction("grip")[0]))
    return ff.Job(setup, steps=steps).run()


def test_a_bent_pair_slides_where_its_mid_surfaces_keep_their_length(radius=20.0):
    """Two sheets at a distance of 0.99 mm, pressed, each node led, by some 0.5 mm: at the length s
    of sheets at the distance D by their angles s / R and s / (R + D), on the radius between
    them."""
    stack = ff.Stack([(rectangle(LENGTH / 2, 10, 10, 5, spatial=True), T, name) for name in "ab"])

    def bent(x, load):
        r, z = radius / max(load, 1e-6), 0.99 * x[2]
        angle = x[0] / (r + z)
        rise = (r + z) * -2 * np.sin(angle / 2) ** 2
        return np.array([(r + z) * np.sin(angle), x[1], z + rise]) - x

    pair = ff.SheetContact("a", "b", PENALTY, friction=ff.Coulomb(MU, SLIP))
    led = [ff.Support("led", everywhere, (0, 1, 2), bent)]
    scene = ff.Scene(stack, [Elastic(1e-6), pair], led)
    stack.u.x.array[:] = bent(stack.coordinates().T, 0.0).T.ravel()
    result = ff.Job(scene, steps=5, balance=None, limits=ff.Limits(imbalance=1e9)).run()
    sizes = np.linalg.norm(pair.sliding(), axis=1)
    areas = np.where(np.isfinite(sizes), pair.points.areas, 0.0)
    total, area = COMM.allreduce(np.array([areas @ np.nan_to_num(sizes), areas.sum()]))
    apart, s = 0.99 * T, LENGTH / 4
    slid = (radius + apart / 2) * (s / radius - s / (radius + apart))
    assert total / area == pytest.approx(slid, rel=0.03)
    told = result.summary["sheet_contacts"]["a, b"]["sliding_largest_mm"]
    assert told == pytest.approx(np.nanmax(sizes), rel=1e-9)
    in_cells = max(COMM.allgather(np.nanmax(result.fields["sliding_size"], initial=0.0)))
    assert in_cells == pytest.approx(told, rel=0.1)
    energy = MU * pair.totals[3] * (slid - SLIP / 2)
    assert result.rows[-1]["friction_energy_Nmm"] == pytest.approx(energy, rel=0.2)


@pytest.mark.mpi
def test_pull_out():
    """Force 2 mu p A u / slip where the sheets stick, 2 mu p A where they slide, the same back;
    work of the grip is what friction takes."""
    limit = 2 * MU * PRESSURE * LENGTH * WIDTH
    # steps of half the slip, so that work along lines is exact
    result = pull_out(lambda load: SLIP * float(np.interp(load, [0, 0.4, 1], [0, 2, -1])), steps=10)
    u, force = np.array([(row["displacement_mm"], row["reaction_N"]) for row in result.rows]).T
    turn = np.argmax(u)
    there = limit * np.minimum(1, u[: turn + 1] / SLIP)
    assert force[: turn + 1] == pytest.approx(there, rel=5e-3, abs=1e-6 * limit)
    back = np.maximum(-1, 1 - (u[turn] - u[turn:]) / SLIP)
    assert force[turn:] == pytest.approx(limit * back, abs=5e-3 * limit)
    assert result.summary["energy_imbalance"] < 2e-3


def pulled_at_its_end(pull, stiffness):
    """Force [N] on an elastic strip of `stiffness` E A [N], pulled at one end, that sticks up
    to `SLIP` [mm] in proportion, slides beyond: shear lag, E A u'' = traction."""
    limit = 2 * MU * PRESSURE * WIDTH
    rate = math.sqrt(limit / (SLIP * stiffness))

    def sticking(u, length):
        return stiffness * rate * u * math.tanh(rate * length)

    if pull <= SLIP:
        return sticking(pull, LENGTH)

    def force(slid):
        return sticking(SLIP, LENGTH - slid) + limit * slid

    def excess(slid):
        return SLIP + (force(slid) - limit * slid / 2) * slid / stiffness - pull

    return force(brentq(excess, 0.0, LENGTH))


@pytest.mark.parametrize("pull", [0.5 * SLIP, pytest.param(2 * SLIP, marks=pytest.mark.mpi)])
def test_shear_lag(pull):
    """An elastic sheet pulled at its end, that sticks, or slides along a part of it. Sheets are
    thin, as the moment of the forces at the faces makes the pressure uneven."""
    exact, cells = pulled_at_its_end(pull, 1e4 * WIDTH), 12
    result = pull_out(lambda load: pull * load, False, cells, cells, steps=2, t=0.25)
    assert result.rows[-1]["reaction_N"] == pytest.approx(exact, rel=1e-3)
    stuck = any("never leaves its elastic branch" in each for each in said(result.summary))
    assert stuck == (pull < SLIP)


@pytest.mark.parametrize("distance", [0.3, 1.5, 30.0])
def test_forces_and_tangent_are_derivatives(distance):
    """Where the sheets stick, in part, and slide, on bent faces that are partly open."""
    sizes = {"a": 4, "b": 6}.items()
    stack = ff.Stack([(rectangle(20, 10, n, n // 2, spatial=True), T, k) for k, n in sizes])
    contact = ff.SheetContact("a", "b", PENALTY, friction=ff.Coulomb(MU, SLIP))
    scene = ff.Scene(stack, [Elastic(), contact])
    X, u = stack.coordinates(), stack.u.x.array.reshape(-1, 3)
    on_b = X[:, 2] > T / 2
    u[:, 2] = 0.01 * (X[:, 0] - 7) ** 2 - on_b * 0.03 * X[:, 1] / 8 + on_b * 0.005
    scene.accept()
    assert 0 < (contact.normal_forces() > 0).sum() < contact.points.count
    u[on_b] += distance * SLIP * np.array([0.7, 0.4, 0.0]) * (0.5 + X[on_b, :1] / 20)
    assert off_differences(contact, 1e-3) < 1e-6


def test_stuck_strips_bend_as_one(load=0.01):
    """A cantilever of two strips that are pressed together has 1/8 of the deflection of one strip,
    that bears all of the load, on two meshes."""
    sizes = ("lower", 10), ("upper", 14)
    length, width, E, pressed = 40.0, 8.0, 1e4, 0.05
    D, clamp, tip = E * T**3 / 12, near(0, 0.0), near(0, length)
    stack = ff.Stack([(rectangle(length, width, n, 4, spatial=True), T, k) for k, n in sizes])
    pair = ff.SheetContact("lower", "upper", PENALTY, friction=ff.Coulomb(0.5))
    terms = [Elastic(E), pair, *(ff.Bending(D, D_t=2 * D, clamped=clamp).on(k) for k, _ in sizes)]
    pull = ff.EdgeTension(lambda at: load * max(0.0, 2 * at - 1), (0, 0, -1), tip).on("upper")
    p = lambda at: pressed * min(1.0, 2 * at)  # noqa: E731
    ways = ((k, (0, 0, way)) for way, (k, _) in zip((1, -1), sizes))
    terms += [ff.BlankHolderPressure(p, way, everyone).on(k) for k, way in ways]
    supports = [ff.Support("clamp", clamp, (0, 1, 2)), ff.Support("side", near(1, 0.0), (1,))]
    scene, anything = ff.Scene(stack, [*terms, pull], supports), ff.Limits(imbalance=1e9)
    result = ff.Job(scene, steps=2, balance=None, limits=anything).run()
    places, moved = stack.coordinates(), stack.nodal_displacement()
    sunk = -moved[tip(places.T), 2].mean()
    assert sunk == pytest.approx(load * length**3 / (3 * D) / 8, rel=0.05)
    assert 0.2 < result.summary["friction_used"][pair.name] < 1
