"""Where a sheet lies over another one."""

from typing import NamedTuple

import numpy as np

from .pairs import Pairs


class Facing(NamedTuple):
    """The points of a sheet that lie over the other one, as the sheets are.

    - points (n,): their numbers; areas (n,): that they stand for [mm^2]; pairs: what they move
      with; flat: what they would move with on flat triangles, for sliding
    - gap (n,) between the faces [mm], its gradient `normal` (n, 3), its Hessian `curvature`
      (n, 3, 3) [1/mm]
    - relative, from_flat (n, 3): displacement relative to the other sheet, as the sheets are [mm],
      with `pairs` and `flat`
    """

    points: np.ndarray
    areas: np.ndarray
    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray
    pairs: Pairs
    relative: np.ndarray
    flat: Pairs
    from_flat: np.ndarray

    def moved(self) -> np.ndarray:
        """Displacement relative to the other sheet since then, (n, 3) [mm], on flat triangles."""
        return self.flat.relative() - self.from_flat
