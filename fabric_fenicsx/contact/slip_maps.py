"""Slip of the faces of sheets along tools and along each other: see `SlipMap`."""

import numpy as np

from ..energy.nodes import Nodes
from ..energy.term import Triplets
from ..surfaces.tool import Tool
from .contact_points import ContactPairs, ContactPoints, RelativeMotion
from .coulomb import turned


class ToolSlip:
    """Slip of the sheet's faces along a tool since this was made, at the nodes.

    A face slips as its node moves relative to the tool, less the change of the node's offset from
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
        self.normals, self.offsets, self._derivative = normals, offsets, derivative
        self._nodes, self._tool = nodes, tool
        self._place, self._tool_place = nodes.displacement(), tool.displacement.copy()

    def tool_moved(self) -> np.ndarray:
        """Motion of the tool (3,) [mm]."""
        return self._tool.displacement - self._tool_place

    def _moved(self):
        return self._nodes.view() - self._place - self.tool_moved()

    def slid(self) -> np.ndarray:
        return self.on_nodes(self._moved())

    def exact(self, now: "ToolSlip") -> np.ndarray:
        """As in `SlipMap`, of places less offsets."""
        return self._moved() - np.nan_to_num(now.offsets - self.offsets)

    def on_nodes(self, forces: np.ndarray) -> np.ndarray:
        """Forces on the nodes (nodes, 3) of forces on the faces (nodes, 3) [N]."""
        return turned(forces, self._derivative)

    def on_node_blocks(self, blocks: np.ndarray) -> np.ndarray:
        """Stiffness at the nodes of stiffness at the faces, (nodes, 3, 3) [N/mm]."""
        return self._derivative @ blocks @ self._derivative


class FaceSlip:
    """Slip of the faces of two sheets at points of one over the other, from the `start` on. All
    ranks make and use it together.

    - start: the `ContactPairs` from which on
    - normals (count, 3): unit vectors across the faces at all points, 0 at those that lie over
      nothing
    """

    def __init__(self, points: ContactPoints, start: ContactPairs) -> None:
        normals = start.unit_normals()
        self._points, self.start = points, start
        self.normals = points.of_all(start, normals)
        self._motion = RelativeMotion(points.blank, start.corners, normals)
        self._place = self._motion.relative()
        self._moved, self._offsets = start.moved(), self._motion.offsets()

    def slid(self) -> np.ndarray:
        return self._points.of_all(self.start, self._motion.relative() - self._place)

    def exact(self, _: "FaceSlip") -> np.ndarray:
        """As in `SlipMap`, at any angle by which the triangles turn."""
        turned = self._motion.offsets() - self._offsets
        return self._points.of_all(self.start, self.start.moved() - self._moved + turned)

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add to f, of this rank's degrees of freedom [N], forces (count, 3) [N] on the faces of
        the points, and their reactions, as forces on the nodes."""
        self._motion.add(forces[self.start.points], f)

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As of `Term.tangent`. blocks (count, 3, 3): growth of each face's force [N/mm]."""
        return self._motion.triplets(blocks[self.start.points])
