"""A loop over cells that are bent."""

import numpy as np

from ...runtime.compiled import compiled


@compiled
def bend(
    operator: np.ndarray,
    columns: np.ndarray,
    U: np.ndarray,
    offset: np.ndarray,
    axes: np.ndarray,
    weights: np.ndarray,
    shares: np.ndarray,
) -> tuple[float, np.ndarray, np.ndarray]:
    """Energy [N mm], moments (cells, 3, gdim), conjugate to the curvatures by which cells are bent
    [N mm mm], and forces on the nodes (nodes, gdim) [N].

    Cells are bent by `operator` (cells, 3, 12) times the motion U (nodes, gdim) of their nodes,
    `columns` (cells, 12), plus `offset` (cells, 3, gdim). What counts of it are components along
    unit vectors `axes` (cells, k, gdim), with `weights` (cells, 3), stiffness times area, times
    `shares` (k,).
    """
    energy, forces, moments = 0.0, np.zeros_like(U), np.zeros_like(offset)
    moved, m = np.empty(operator.shape[2]), np.empty(3)
    for c in range(len(operator)):
        L, nodes = operator[c], columns[c]
        for a in range(len(shares)):
            axis = axes[c, a]
            for n in range(len(nodes)):
                moved[n] = 0.0
                for i in range(len(axis)):
                    moved[n] += U[nodes[n], i] * axis[i]
            for k in range(3):
                bent = 0.0
                for i in range(len(axis)):
                    bent += offset[c, k, i] * axis[i]
                for n in range(len(nodes)):
                    bent += L[k, n] * moved[n]
                m[k] = shares[a] * weights[c, k] * bent
                energy += 0.5 * bent * m[k]
                for i in range(len(axis)):
                    moments[c, k, i] += m[k] * axis[i]
            for n in range(len(nodes)):
                force = L[0, n] * m[0] + L[1, n] * m[1] + L[2, n] * m[2]
                for i in range(len(axis)):
                    forces[nodes[n], i] += force * axis[i]
    return energy, moments, forces
