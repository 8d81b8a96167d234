"""Sliding of faces, alone: two bent sheets that touch."""

import numpy as np
import pytest
from builders import COMM
from builders import sheet as rectangle

import fabric_fenicsx as ff

FABRIC = ff.load("komeili")
T = FABRIC.thickness_under(0.0)


@pytest.fixture
def pair():
    """Contact of two bent sheets of different cells, 0.9 thicknesses apart."""
    sheets = [
        (rectangle(20, 10, n, n // 2, spatial=True), T, name) for n, name in ((8, "a"), (10, "b"))
    ]
    stack = ff.Stack(sheets)
    contact = ff.SheetContact("a", "b", friction=ff.Coulomb(0.3, 0.5))
    ff.Scene(stack, [*(ff.Membrane(FABRIC).on(name) for name in "ab"), contact])
    X = stack.coordinates()
    u = 0.01 * (X[:, 0] - 7) ** 2 - 0.1 * X[:, 2]
    stack.u.x.array.reshape(-1, 3)[:, 2] = u
    contact.accept()
    return contact


def displaced(contact, motion):
    """Move the sheets by motion(places) (n, 3), of the places where they are."""
    blank = contact.blank
    x = blank.coordinates() + blank.nodal_displacement()
    blank.u.x.array[:] += motion(x).ravel()
    return contact.friction_state.sliding.slid()


def test_a_small_turn_of_both_is_no_sliding(pair):
    axis = np.array([0.3, -0.5, 0.2])
    slid = displaced(pair, lambda x: 1e-6 * np.cross(axis, x) + [1.0, 2.0, 3.0])
    normals = pair.friction_state.sliding.normals
    along = slid - (slid * normals).sum(1, keepdims=True) * normals
    assert abs(along).max(initial=0) < 0.01 * 1e-6 * T  # normals are the smooth face's


@pytest.mark.mpi
def test_forces_at_faces_have_neither_sum_nor_moment(pair):
    pairs, blank = pair.faces.accepted, pair.blank
    along = np.array([1.0, 0.4, 0.0]) + 0 * pairs.normal
    along -= (along * pairs.unit_normals()).sum(1, keepdims=True) * pairs.unit_normals()
    f = np.zeros(len(blank.u.x.array))
    pair.friction_state.sliding.add(pair.points.of_all(pairs, along), f)
    owned = 3 * pair.points.nodes.count
    forces = f[:owned].reshape(-1, 3)
    x = (blank.coordinates() + blank.nodal_displacement())[: len(forces)]
    total, moment = COMM.allreduce(np.array([forces.sum(0), np.cross(x, forces).sum(0)]))
    size = COMM.allreduce(np.linalg.norm(along, axis=1).sum())
    assert abs(total).max() < 1e-12 * size
    # flat triangles are not where the smooth face is
    assert abs(moment).max() < 0.02 * T * size
