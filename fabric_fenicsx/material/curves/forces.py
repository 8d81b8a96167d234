"""Shear forces of tests and the stress that does the same work; t is the thickness, g the shear
angle.

- Frame of side L_f with fabric of side L: its diagonal 2 L_f cos(pi/4 - g/2) is pulled by F, so F
  L_f sin(pi/4 - g/2) = tau t L^2. With F_s = F / (2 cos(pi/4 - g/2)) and F_sh = F_s L_f / L^2 that
  is tau t = F_sh cos g.
- Bias strip: F (H - W)/2 (cos g/2 - sin g/2) = t [tau(g) W (2H - 3W)/2 + tau(g/2) W^2/2], which is
  the formula of Cao et al. (2008) with the same tau t = F_sh cos g. F_sh / t is the part of the
  traction along the yarn (S_12), and only at small g also the stress conjugate to g.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError
from .model import Response, unit_inside


def response(
    column: str,
    values: np.ndarray,
    gamma: np.ndarray,
    test: str,
    lengths: Mapping[str, float],
    t: float,
) -> Response:
    """How the law predicts `values` (n,) of a column, in its inner unit, at shear angles gamma (n,)
    [rad]; lengths: keys of the test [mm], t: thickness [mm]. Raises InputError for lengths that no
    specimen has."""
    gain: np.ndarray = np.ones_like(values)
    half = None
    if column == "F_sh":
        gain = t / np.cos(gamma)
    elif test == "picture_frame":
        frame, fabric = lengths["frame_length"], lengths["fabric_length"]
        if fabric > frame:
            raise InputError(
                f"fabric_length is {fabric:g} mm and frame_length {frame:g} mm; "
                "allowed is a fabric up to as large as its frame (are they exchanged?)"
            )
        gain = t * fabric**2 / (frame * np.sin(math.pi / 4 - gamma / 2))
    elif test == "bias_extension":
        H, W = lengths["height"], lengths["width"]
        if H < 2 * W:
            raise InputError(
                f"height is {H:g} mm and width {W:g} mm; allowed is a height of 2 widths or "
                "more, for a zone of full shear"
            )
        lever = (H / W - 1) * (np.cos(gamma / 2) - np.sin(gamma / 2))
        gain, half = t * (2 * H - 3 * W) / lever, t * W / lever
    return Response(column, unit_inside(column), values, gain, half)


def bias_normalised(gamma: ArrayLike, force: ArrayLike, height: float, width: float) -> np.ndarray:
    """Normalised shear force F_sh (n,) [N/mm] of a bias test, by the formula of Cao et al. (2008).

    gamma: (n,) [rad], rising from above 0; force: (n,) [N]; height, width [mm] of the strip.
    F_sh(gamma/2) is interpolated linearly, from 0 at 0, so the formula is one linear system.
    """
    g, H, W = np.asarray(gamma, float), height, width
    at_half = np.array([np.interp(g / 2, np.r_[0, g], np.r_[0, hat]) for hat in np.eye(len(g))]).T
    A = np.diag((2 * H - 3 * W) * np.cos(g)) + (W * np.cos(g / 2))[:, None] * at_half
    return np.linalg.solve(A, (H / W - 1) * np.asarray(force) * (np.cos(g / 2) - np.sin(g / 2)))
