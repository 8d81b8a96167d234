"""Supports that only locate a sheet let go of it once friction holds it."""

import numpy as np
import pytest
from builders import COMM, said, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.scene.rigid_motions import is_held_by_friction

PULL = 4.0  # N/mm along x on the right end


def around(x, radius=1e-6):
    return lambda points: np.linalg.norm(points[:2].T - (x, 10), axis=1) < radius


def pressed(friction, where=None, nx=8):
    """A ply pressed on a table and pulled to one side."""
    blank = sheet(40, 20, nx, nx // 2, spatial=True)
    fabric = ff.load("komeili")
    below = ff.Plane((0, 0, -fabric.thickness_under(0.0) / 2), (0, 0, 1))
    table = ff.Contact(ff.Tool(below, name="table"), friction=friction, where=where)
    press = ff.BlankHolderPressure(0.5, (0, 0, -1), lambda x: np.ones(x.shape[1]))
    pull = ff.EdgeTension(lambda load: PULL * load, (1, 0, 0), lambda x: x[0] > 40 - 1e-6)
    supports = [ff.Support("centre", around(20), (0, 1), locates=True)]
    supports.append(ff.Support("end", around(40), (1,), locates=True))
    terms = [ff.Membrane(fabric), ff.Bending(modulus=100.0), table, press, pull]
    return ff.Scene(blank, terms, supports)


@pytest.mark.mpi
def test_friction_takes_over_from_supports():
    scene = pressed(friction=0.3)
    result = ff.Job(scene, steps=4).run()
    assert not scene.supports.locates
    assert COMM.allreduce(len(scene.fixed_dofs)) == 0
    assert all(row["iterations"] < 10 for row in result.rows[2:])
    assert result.force("table")[0] == pytest.approx(-20 * PULL, rel=1e-6)
    assert abs(scene.reaction("centre")).max() < 1e-4
    assert not any("keep the sheet in its place" in words for words in said(result.summary))


@pytest.mark.parametrize("where, held", [(None, True), (around(20, 1), False)])
def test_friction_near_one_place_does_not_hold_a_sheet_from_turning(where, held):
    """Of five nodes up to 0.9 mm from the middle."""
    scene = pressed(0.3, where, nx=32)
    scene.u.array[2::3] = -0.1
    scene.set(scene.u.copy())
    scene.accept()
    assert is_held_by_friction(scene.blank, scene.terms) == held
