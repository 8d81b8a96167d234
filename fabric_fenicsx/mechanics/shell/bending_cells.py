"""A loop over cells that are bent."""

import numpy as np

from ...runtime.compiled import compiled


@compiled
def bend(operator, columns, U, offset, normal, weights, in_plane):
    """Energy [N mm], moments (cells, 3, gdim), conjugate to the curvatures by which cells are bent
    [N mm mm], and forces on the nodes (nodes, gdim) [N].

    Cells are bent by `operator` (cells, 3, 12) times the motion U (nodes, gdim) of their nodes,
    `columns` (cells, 12), plus `offset` (cells, 3, gdim). weights (cells, 3): stiffness times area,
    of curvature along `normal` (cells, gdim); across it that times `in_plane`
    """
    energy, forces, moments = 0.0, np.zeros_like(U), np.empty_like(offset)
    dim, bent = U.shape[1], np.empty(U.shape[1])
    for c in range(len(operator)):
        for k in range(3):
            out = 0.0
            for i in range(dim):
                bent[i] = offset[c, k, i]
                for n in range(12):
                    bent[i] += operator[c, k, n] * U[columns[c, n], i]
                out += bent[i] * normal[c, i]
            for i in range(dim):
                along = in_plane * bent[i] + (1 - in_plane) * out * normal[c, i]
                moments[c, k, i] = weights[c, k] * along
                energy += 0.5 * bent[i] * moments[c, k, i]
        for n in range(12):
            for i in range(dim):
                for k in range(3):
                    forces[columns[c, n], i] += operator[c, k, n] * moments[c, k, i]
    return energy, moments, forces
