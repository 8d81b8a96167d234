"""Pairs of coupled nodes."""

import numpy as np

from fabric_fenicsx.mechanics.gathered import CoupledNodes

COLUMNS = np.array([[0, 1, 2], [2, 3, 1], [4, 0, 3]])  # of three cells
NODES = np.array([7, 2, 9, 4, 5])


def test_each_pair_of_a_cell_has_its_block():
    coupled = CoupledNodes(NODES, COLUMNS)
    blocks = np.arange(9.0).reshape(3, 3)
    found = np.zeros((30, 30))
    np.add.at(found, (coupled.rows, coupled.cols), np.tile(blocks, (coupled.count, 1, 1)).ravel())
    for cell, places in zip(COLUMNS, coupled.places):
        for i, row in zip(cell, places):
            for j, place in zip(cell, row):
                assert (coupled.ends[0][place], coupled.ends[1][place]) == (i, j)
                at = 3 * NODES[i], 3 * NODES[j]
                assert (found[at[0] : at[0] + 3, at[1] : at[1] + 3] == blocks).all()
    assert np.count_nonzero(found.any(1)) == 15 and coupled.count == 21


def test_pairs_that_do_not_count_have_no_place():
    alone = np.tile(np.eye(3, dtype=bool), (3, 1, 1))
    coupled = CoupledNodes(NODES, COLUMNS, alone, dim=2)
    assert coupled.count == 5 and (coupled.places[~alone] == -1).all()
    assert sorted({*coupled.rows}) == sorted({*np.ravel([2 * NODES, 2 * NODES + 1])})
