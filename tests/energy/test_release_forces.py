"""Forces that fade: their potential, and what is released on them."""

import numpy as np
import pytest
from builders import Elastic, alone, march, near, rotation, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.energy.load import ReleaseForces
from fabric_fenicsx.scene import output as reports
from fabric_fenicsx.solve.newton import Newton

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


@pytest.mark.mpi
def test_what_was_released_is_remembered_on_any_node():
    scene, forces = pulled()
    march(Newton(scene), 10)
    kept, told = forces.memory(), forces.energies()["released"]
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
