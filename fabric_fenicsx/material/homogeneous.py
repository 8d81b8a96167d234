"""Stresses of homogeneous states of a fabric whose yarns start at right angles, by the kernel, and the state of free
tension."""

from types import SimpleNamespace
from typing import Literal, overload

import numpy as np

from ..errors import SolverFailure
from .baseline import Fabric
from .pointwise import evaluate

NARROWEST = -0.99  # strain across a free tension


@overload
def nominal(fabric: Fabric | SimpleNamespace, strains: np.ndarray, tangent: Literal[False] = ...) -> np.ndarray: ...
@overload
def nominal(
    fabric: Fabric | SimpleNamespace, strains: np.ndarray, tangent: Literal[True]
) -> tuple[np.ndarray, np.ndarray]: ...
def nominal(
    fabric: Fabric | SimpleNamespace, strains: np.ndarray, tangent: bool = False
) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
    """Stresses (n, 3) [MPa] conjugate to strains (n, 3) = eps_a, eps_b, gamma, for yarns that start at right angles.

    From dW = S11 dI4/2 + S22 dI8/2 + S12 dI6: sigma_a = S11 la + S12 lb sin g (the nominal stress P = F S along yarn a),
    sigma_b alike, and tau = S12 la lb cos g. With tangent=True also (n, 3), right at gamma = 0: d(sigma_a)/d(eps_a),
    d(sigma_b)/d(eps_b), d(sigma_a)/d(eps_b).
    """
    la, lb = 1 + strains[:, 0], 1 + strains[:, 1]
    sin, cos = np.sin(strains[:, 2]), np.cos(strains[:, 2])
    C = np.stack([la**2, la * lb * sin, la * lb * sin, lb**2], -1).reshape(-1, 2, 2)
    state = evaluate(fabric, cauchy_green=C, tangent=tangent)
    S11, S12, S22 = state.S[:, 0, 0], state.S[:, 0, 1], state.S[:, 1, 1]
    stress = np.stack([S11 * la + S12 * lb * sin, S22 * lb + S12 * la * sin, S12 * la * lb * cos], -1)
    if not tangent:
        return stress
    D = state.tangent
    assert D is not None
    return stress, np.stack([S11 + la**2 * D[:, 0, 0], S22 + lb**2 * D[:, 1, 1], la * lb * D[:, 0, 1]], -1)


def lateral_strain(
    fabric: Fabric | SimpleNamespace, along: int, strain: np.ndarray, start: np.ndarray | None = None
) -> np.ndarray:
    """Strain (n,) across a tension of `strain` (n,) along yarn a (0) or b (1), where the stress across is zero.

    The stress across is convex and rises with the strain across, so Newton from any start comes down on the root
    monotonically after one step. Fabrics that would contract by more than 99 %, or grow, count as at that bound. Raises
    SolverFailure if no root is found.
    """
    across = 1 - along
    e = np.zeros((len(strain), 3))
    e[:, along] = strain
    e[:, across] = 0 if start is None else np.clip(start, -0.8, 0)
    for _ in range(200):
        stress, stiffness = nominal(fabric, e, tangent=True)
        before = e[:, across].copy()
        e[:, across] = np.clip(before - stress[:, across] / stiffness[:, across], NARROWEST, 0)
        if np.all(np.abs(e[:, across] - before) < 1e-8):  # quadratic, so the next step would be below rounding
            return e[:, across]
    raise SolverFailure("the strain across a free tension was not found in 200 Newton steps")
