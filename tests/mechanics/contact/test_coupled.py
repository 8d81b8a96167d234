"""Pairs of nodes that points couple."""

import numpy as np
import pytest

from fabric_fenicsx.mechanics.contact.coupled import Coupled

NODES = np.array([[0, 1, 2], [2, 3, 1], [4, 0, 3]])  # of three points
KNOWN = np.array([7, 2, 9, 4, 5])


def dense(coupled, values):
    found = np.zeros((30, 30))
    np.add.at(found, (coupled.rows, coupled.cols), values)
    return found


def motion(motions):
    """Matrix (9, 30) from the motion of all nodes to that of the points; motions (3, 3, 9)."""
    found = np.zeros((3, 3, 10, 3))
    for point, nodes in enumerate(KNOWN[NODES]):
        found[point][:, nodes] = motions[point].reshape(3, 3, 3)
    return found.reshape(9, 30)


@pytest.mark.parametrize("symmetric", [True, False])
def test_stiffness_is_that_of_the_points_between_their_motions(symmetric):
    random = np.random.default_rng(0)
    weights, motions, blocks = (random.normal(size=(3, *s)) for s in ((3,), (3, 9), (3, 3)))
    blocks = blocks + blocks.swapaxes(1, 2) if symmetric else blocks
    blocks[1] = 0  # a point that nothing presses
    B = np.zeros((9, 9))
    for point, block in enumerate(blocks):
        B[3 * point : 3 * point + 3, 3 * point : 3 * point + 3] = block
    coupled = Coupled(NODES, KNOWN)
    L = motion(motions)
    assert dense(coupled, coupled.moved(motions, blocks)) == pytest.approx(L.T @ B @ L)
    L = motion((weights[:, None, :, None] * np.eye(3)[:, None]).reshape(3, 3, 9))
    assert dense(coupled, coupled.weighted(weights, blocks)) == pytest.approx(L.T @ B @ L)


def test_no_points_couple_nothing():
    none = Coupled(np.empty((0, 6), dtype=int), np.empty(0, dtype=int))
    assert len(none.rows) == len(none.cols) == 0
    assert len(none.moved(np.empty((0, 3, 18)), np.empty((0, 3, 3)))) == 0
