"""Work of forces, and what is released."""

import numpy as np
import pytest
from builders import Elastic, alone, march, near, rotation, sheet
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.energy.load import ReleaseForces
from fabric_fenicsx.energy.work import Work
from fabric_fenicsx.scene import output as reports
from fabric_fenicsx.solve.newton import Newton

LOADS = 0.0, 0.2, 0.3, 0.7, 1.0  # steps of several sizes
SPEED = np.array([1.0, -2.0, 0.5])


def state(load):
    """Load, force and place."""
    return load, np.array([load**2, 3 * load - load**2, 1.0]), load * SPEED


def done(work, states):
    """Work from the first of the states to the last, a step at a time."""
    total = 0.0
    for last, now in zip(states, states[1:]):
        work.accept(*last)
        total += work.since(*now)
    return total


def exact(low, high):
    squares, cubes = high**2 - low**2, high**3 - low**3
    return np.array([cubes / 3, 1.5 * squares - cubes / 3, high - low]) @ SPEED


def test_forces_of_second_degree_do_their_exact_work_from_the_second_step_on():
    work, states = Work(), [state(load) for load in LOADS]
    first = done(work, states[:2])
    assert first == pytest.approx(0.1 * (states[0][1] + states[1][1]) @ SPEED)
    assert done(work, states[1:]) == pytest.approx(exact(0.2, 1.0), rel=1e-12)


def test_forces_that_turn_with_what_they_move():
    """A tangential force along a quarter of a circle: its work is the arc, where chords alone are
    of second order."""
    errors = []
    for steps in (8, 16):
        angles = np.linspace(0, np.pi / 2, steps + 1)
        arms = np.column_stack([np.cos(angles), np.sin(angles)])
        tangents = np.column_stack([-np.sin(angles), np.cos(angles)])
        errors.append(abs(done(Work(), [*zip(angles, tangents, arms)]) - np.pi / 2))
    assert errors[1] < 3e-4 and errors[1] < errors[0] / 7


@pytest.mark.mpi
def test_work_depends_neither_on_axes_nor_on_the_ranks_that_share_the_forces():
    """Nor where a bend is bounded."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    forces = np.array([[0.0, 0, 0], [1, 2, 0], [1.2, 2.1, 0.1], [9, 1, -4], [9.5, 2, -4]])
    places = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0.1, 0], [2.5, 1, 0.3], [4, 1, 2]])
    turns = np.eye(3), turn.T
    found = [done(Work(), [*zip(range(5), forces @ Q, places @ Q)]) for Q in turns]
    mine = slice(MPI.COMM_WORLD.rank, None, MPI.COMM_WORLD.size)
    shared = Work(comm=MPI.COMM_WORLD)
    part = done(shared, [*zip(range(5), forces[:, mine], places[:, mine])])
    assert [found[1], MPI.COMM_WORLD.allreduce(part)] == pytest.approx([found[0]] * 2, rel=1e-12)


@pytest.mark.parametrize("power", [2, 3])
def test_a_first_step_looked_at_on_the_way_has_its_exact_work(power):
    work = Work()
    work.accept(0.0, np.zeros(1), np.zeros(1))
    loads = (1.0, 0.5, 1.0, 0.25, 1.0)
    found = [work.since(load, np.array([load**power]), np.array([load])) for load in loads]
    assert found[0] == pytest.approx(0.5)
    assert [found[2], found[4]] == pytest.approx([1 / (power + 1)] * 2)


@pytest.mark.parametrize("power", [1, 2, 3])
def test_travel_that_follows_from_a_first_load(power):
    """A dead load on what hardens as a power of the travel, as a flat sheet does."""
    work = Work(follows=True)
    work.accept(0.0, np.zeros(1), np.zeros(1))
    for load in (0.5, 0.25, 0.75, 1.0):
        found = work.since(load, np.array([load]), np.array([load ** (1 / power)]))
    assert found == pytest.approx(1 / (power + 1), rel=0.02)


def test_what_was_rejected_accepted_twice_or_let_go_does_no_work():
    once, twice, work = Work(), Work(), Work()
    for load in LOADS[:3]:
        for each in (once, twice, twice):
            each.accept(*state(load))
    assert twice.since(*state(1.0)) == once.since(*state(1.0))
    work.accept(0.0, np.zeros(1), np.zeros(1))
    work.since(0.05, np.full(1, 9.0), np.ones(1))
    work.reject()
    assert work.since(0.1, np.ones(1), np.ones(1)) == pytest.approx(0.5)
    work.accept(0.0, np.ones(2), np.zeros(2))
    work.keep(np.array([True, False]))
    assert work.since(1.0, np.ones(1), np.full(1, 3.0)) == pytest.approx(3.0)


@pytest.mark.parametrize("last, bend", [(0.85, 0.075), (2.7, 1.0), (10.7, 1.0), (0.5, 0.0)])
def test_a_parabola_is_bent_at_most_ten_times_as_much_and_to_the_same_side(last, bend):
    """Second divided differences: 0.1 of the forces before, (last - 0.7) / 2 of those with the
    last one, which counts up to 1 and not below 0."""
    work = Work()
    for load, force in ((0.0, 0.0), (1.0, 0.1), (2.0, 0.4)):
        work.accept(load, np.array([force]), np.array([load]))
    found = work.since(3.0, np.array([last]), np.array([3.0]))
    assert found == pytest.approx((0.4 + last) / 2 - bend / 6, rel=1e-12)


LENGTH, WIDTH, REACH = 40.0, 10.0, 0.3


def pulled():
    """A strip in its plane, stretched by 1 %, and the forces that hold it so."""
    blank, forces = sheet(LENGTH, WIDTH, 8, 2, "left"), ReleaseForces(REACH)
    held = [ff.Support("grip", near(0, 0.0), (0,)), ff.Support("side", near(1, 0.0), (1,))]
    scene = ff.Scene(blank, [Elastic(), forces], held)
    x = blank.coordinates()
    blank.u.x.array[::2] = 0.01 * x[:, 0]
    scene.accept()
    scene.residual(scene.u.duplicate())
    forces.take(scene.forces.array)
    return scene, forces


@pytest.mark.mpi
def test_a_stretched_strip_gives_back_what_it_stored():
    scene, forces = pulled()
    assert "agree" in ff.check_derivatives(forces, scene, load=0.3)
    stored, states = scene.energies()["strain"], []
    outcome = march(Newton(scene), 20, on_accept=states.append)
    assert not outcome.reason and outcome.rejected == 0
    assert [states[0].energies[kind] for kind in ("strain", "released")] == [stored, 0.0]
    assert states[-1].energies["strain"] == pytest.approx(0, abs=1e-12 * stored)
    assert states[-1].energies["released"] == pytest.approx(stored, rel=5e-3)
    assert {state.external_work for state in states} == {stored}
    back = reports.nodal_fields(scene)["springback"]
    assert back[:, 0] == pytest.approx(-0.01 * scene.blank.coordinates()[:, 0], abs=1e-9)
    kept, told = forces.memory(), forces.energies()["released"]  # of which it is told on any node
    other = alone(sheet(LENGTH, WIDTH, 8, 2, "left"), ReleaseForces(REACH))
    other.blank.u.x.array[:] = scene.blank.u.x.array
    other.take(forces.applied_forces())
    other.set_load(1.0)
    other.recall(kept)
    assert other.energies()["released"] == told
    assert np.array_equal(other.springback(), forces.springback())


@pytest.mark.parametrize("load, share", [(0.0, 1.0), (0.45, 1 / 64), (0.81, 1e-6), (0.9, 0.0)])
def test_forces_and_their_bed_fade(load, share):
    """By the sixth power of what is left of the load up to 0.9; the bed is as stiff as if all
    forces, at each of 27 nodes alike, were gone at a motion of `reach`."""
    turn = rotation()
    blank = sheet(LENGTH, WIDTH, 8, 2, "left", spatial=True, turn=turn, a=turn[:, 0])
    forces = alone(blank, ReleaseForces(REACH))
    given = np.zeros((27, 3))
    given[3], given[7] = (3.0, 0, 4), (0, 0, -2)
    forces.take(given.ravel())
    forces.set_load(load)
    blank.u.x.array[:] = np.tile([0.1, 0.0, -0.2], 27)
    bed = 7 / (27 * REACH)
    assert forces.remaining() == pytest.approx(7 * share)
    f = np.zeros(81)
    forces.add_forces(f)
    moved = np.array([0.1, 0, -0.2])
    assert f.reshape(-1, 3) == pytest.approx(-share * (given - bed * moved), abs=1e-15)
    work = given[3] @ moved + given[7] @ moved - 27 * bed * moved @ moved / 2
    assert forces.stored() == pytest.approx(-share * work)
    back = forces.nodal_fields()["springback"].value
    assert back == pytest.approx(np.tile(turn @ moved, (27, 1)))
