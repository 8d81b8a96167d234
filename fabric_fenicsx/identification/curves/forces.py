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

from ...core.errors import InputError
from .model import Response, unit_inside

Lengths = Mapping[str, float]
# right Cauchy-Green of principal strains
MEASURES = {
    "green": lambda e: np.maximum(1 + 2 * e, 1e-9),
    "hencky": lambda e: np.exp(2 * e),
    "biot": lambda e: np.maximum(1 + e, 1e-9) ** 2,
}


def response(
    column: str, values: np.ndarray, gamma: np.ndarray, test: str, lengths: Lengths, t: float
) -> Response:
    """The response of `values` (n,) of a column, in its inner unit, at shear angles gamma (n,)
    [rad]; lengths: keys of the test [mm], t: thickness [mm]. Raises InputError for lengths that no
    specimen has."""
    gain: np.ndarray = np.ones_like(values)
    half = None
    if column == "F_sh":
        gain = t / np.cos(gamma)
    elif test == "picture_frame":
        frame, fabric = lengths["frame_length"], lengths["fabric_length"]
        if fabric > frame:
            flaw = f"fabric_length is {fabric:g} mm and frame_length {frame:g} mm"
            allowed = "a fabric up to as large as its frame (are they exchanged?)"
            raise InputError(f"{flaw}; allowed is {allowed}")
        gain = t * fabric**2 / (frame * np.sin(math.pi / 4 - gamma / 2))
    elif test == "bias_extension":
        H, W = _bias_strip(lengths)
        arm = (H / W - 1) * (np.cos(gamma / 2) - np.sin(gamma / 2))
        gain, half = t * (2 * H - 3 * W) / arm, t * W / arm
    return Response(column, unit_inside(column), values, gain, half)


def image_angle(strains: np.ndarray, measure: str, test: str) -> np.ndarray:
    """Shear angle (n,) [rad] by exx, eyy and exy (n, 3) of image correlation, of a measure of
    `MEASURES`; x and y are along and across the pull of a bias test or a frame, or along the
    yarns of a plain shear test."""
    tensors = strains[:, [0, 2, 2, 1]].reshape(-1, 2, 2)
    values, axes = np.linalg.eigh(tensors)
    a, b = np.eye(2) if test == "shear" else np.array([[1, 1], [1, -1]]) / math.sqrt(2)
    C = np.einsum("nij,nj,nkj->nik", axes, MEASURES[measure](values), axes)
    sine = (C @ b @ a) / np.sqrt((C @ a @ a) * (C @ b @ b))
    return np.arcsin(sine * np.sign(sine[np.abs(sine).argmax()]))


def _bias_strip(lengths):
    """Height and width [mm] of a bias test; InputError if it has no zone of full shear."""
    H, W = lengths["height"], lengths["width"]
    if H < 2 * W:
        allowed = "allowed is a height of 2 widths or more"
        raise InputError(f"height is {H:g} mm and width {W:g} mm; {allowed}")
    return H, W


def of_fabric(column: str, values: np.ndarray, test: str, lengths: Lengths, t: float) -> np.ndarray:
    """A test's strain, shear angle [rad] or stress [MPa], (n,), from what the machine wrote: a
    `displacement` [mm] or a force `F` [N]; lengths and t as for `response`."""
    if column == "F":
        return values / (lengths["width"] * t)
    if test == "bias_extension":
        return bias_angle(values, *_bias_strip(lengths))
    return values / lengths["length"]


def bias_angle(displacement: ArrayLike, height: float, width: float) -> np.ndarray:
    """Shear angle (n,) [rad] in the middle of a bias strip whose yarns, at 45 deg, do not stretch,
    at displacements of the clamp [mm]; 90 deg where these are more than such yarns allow."""
    e = np.asarray(displacement, float) / (height - width)
    return np.arcsin(np.minimum(e * (2 + e), 1.0))  # 0 at 0, where an arc cosine is off by 1e-16


def bias_normalised(gamma: ArrayLike, force: ArrayLike, height: float, width: float) -> np.ndarray:
    """Normalised shear force F_sh (n,) [N/mm] of a bias test, by the formula of Cao et al. (2008).

    gamma: (n,) [rad], rising from above 0; force: (n,) [N]; height, width [mm] of the strip.
    F_sh(gamma/2) is interpolated linearly, from 0 at 0, so the formula is one linear system.
    """
    g, H, W = np.asarray(gamma, float), height, width
    at_half = np.array([np.interp(g / 2, np.r_[0, g], np.r_[0, hat]) for hat in np.eye(len(g))]).T
    A = np.diag((2 * H - 3 * W) * np.cos(g)) + (W * np.cos(g / 2))[:, None] * at_half
    arm = (H / W - 1) * (np.cos(g / 2) - np.sin(g / 2))
    return np.linalg.solve(A, arm * np.asarray(force))
