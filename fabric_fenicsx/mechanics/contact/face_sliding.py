"""Sliding of the touching faces of two sheets."""

import numpy as np

from ..term import Triplets
from .relative_motion import RelativeMotion
from .sheet_points import ContactPairs, SheetPoints


class FaceSliding:
    """Sliding of the faces of two sheets at points of one over the other, from the `start` on. All
    ranks make and use it together.

    - start: the `ContactPairs` from which on
    - normals (count, 3): unit vectors across the faces at all points, 0 at those that lie over
      nothing
    """

    def __init__(self, points: SheetPoints, start: ContactPairs) -> None:
        normals = start.unit_normals()
        self._points, self.start = points, start
        self.normals = points.of_all(start, normals)
        self._motion = RelativeMotion(points.blank, start.corners, normals)
        self._place = self._motion.relative()
        self._moved, self._offsets = start.moved(), self._motion.offsets()

    def slid(self) -> np.ndarray:
        """See `Sliding`, 0 at points that lay over nothing."""
        return self._points.of_all(self.start, self._motion.relative() - self._place)

    def exact(self) -> np.ndarray:
        """As `slid`, at any angle by which the triangles turn."""
        turned = self._motion.offsets() - self._offsets
        return self._points.of_all(self.start, self.start.moved() - self._moved + turned)

    def add(self, forces: np.ndarray, f: np.ndarray) -> None:
        """Add to f, of this rank's degrees of freedom [N], forces (count, 3) [N] on the faces of
        the points, and their reactions, as forces on the nodes."""
        self._motion.add(forces[self.start.points], f)

    def triplets(self, blocks: np.ndarray) -> Triplets:
        """As `Term.tangent` gives them. blocks (count, 3, 3): growth of the force on each point's
        face as it slides [N/mm]."""
        return self._motion.triplets(blocks[self.start.points])
