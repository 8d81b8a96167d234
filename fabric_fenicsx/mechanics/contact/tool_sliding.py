"""Sliding of nodes' faces along a tool."""

import numpy as np

from ...runtime.compiled import compiled
from ...tools.tool import Tool
from .nodes import Nodes


class ToolSliding:
    """Sliding of the sheet's faces along a tool since this was made, at the nodes.

    A face slides as its node moves relative to the tool, less the change of the node's offset from
    the tool, which turns with the surface. The linear part uses the offsets' derivatives in the
    first state.

    - normals (nodes, 3): unit vectors; offsets (nodes, 3) [mm]: NaN where the tool is far off
    - derivative (nodes, 3, 3): of the face's place in the node's, symmetric
    """

    def __init__(
        self,
        nodes: Nodes,
        tool: Tool,
        normals: np.ndarray,
        offsets: np.ndarray,
        derivative: np.ndarray,
    ) -> None:
        self.normals = np.ascontiguousarray(normals)
        self._nodes, self._tool, self._offsets = nodes, tool, offsets
        self._derivative = np.ascontiguousarray(derivative)
        self._place, self._tool_place = nodes.displacement(), tool.displacement.copy()

    def tool_moved(self) -> np.ndarray:
        """Motion of the tool (3,) [mm]."""
        return self._tool.displacement - self._tool_place

    def slid(self) -> np.ndarray:
        """See `Sliding`."""
        return _times(self._derivative, self._moved())

    def exact(self, offsets: np.ndarray) -> np.ndarray:
        """Sliding that is not linear, to a state with these offsets (nodes, 3) [mm]."""
        return self._moved() - np.nan_to_num(offsets - self._offsets)

    def _moved(self):
        """Motion of the nodes relative to the tool."""
        return self._nodes.view() - self._place - self.tool_moved()

    def on_nodes(self, forces: np.ndarray) -> np.ndarray:
        """Forces on the nodes (nodes, 3) of forces on the faces (nodes, 3) [N]."""
        return _times(self._derivative, forces)

    def on_node_blocks(self, blocks: np.ndarray) -> np.ndarray:
        """Stiffness at the nodes of stiffness at the faces, (nodes, 3, 3) [N/mm]."""
        return _congruent(self._derivative, blocks)


@compiled
def _times(matrices, vectors):
    """Products (n, 3) of matrices (n, 3, 3) and vectors (n, 3)."""
    found = np.empty_like(vectors)
    for i in range(len(vectors)):
        A, x = matrices[i], vectors[i]
        for j in range(3):
            found[i, j] = A[j, 0] * x[0] + A[j, 1] * x[1] + A[j, 2] * x[2]
    return found


@compiled
def _congruent(matrices, blocks):
    """Products A B A (n, 3, 3) of symmetric matrices A and blocks B."""
    found = np.zeros_like(blocks)
    for n in range(len(blocks)):
        B, A = blocks[n], matrices[n]
        if not B.any():
            continue
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    for m in range(3):
                        found[n, i, j] += A[i, k] * B[k, m] * A[m, j]
    return found
