"""Forces of points that are pressed into a face, and where a tool that is moved by force stands."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .pressure_law import FaceLaw

MAX_SECANT_PRESSURE = 4.0  # of the present one, up to which a secant stiffness looks


class ContactResponse(NamedTuple):
    """n points pressed into a face: gap (n,) [mm] between both, below 0 where they overlap, its
    gradient `normal` (n, 3) and Hessian `curvature` (n, 3, 3) [1/mm], depth (n,) [mm] to which the
    face is pressed in, pressure (n,) [MPa] and its slope (n,) [N/mm^3], forces (n, 3) [N], `blocks`
    (n, 3, 3) [N/mm] by which these fall as points move, and energy (n,) [N mm]."""

    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray
    depth: np.ndarray
    pressure: np.ndarray
    slope: np.ndarray
    forces: np.ndarray
    blocks: np.ndarray
    energy: np.ndarray


def contact_response(
    law: FaceLaw, areas: np.ndarray, gap: np.ndarray, normal: np.ndarray, curvature: np.ndarray
) -> ContactResponse:
    """Points of `areas` (n,) [mm^2] pressed at gaps (n,) [mm], with gradients and Hessians."""
    depth = np.maximum(0.0, -gap)
    energy, pressure, slope = np.zeros((3, len(gap)))
    at = np.flatnonzero(depth != 0)  # those that are not numbers among them
    energy[at], pressure[at], slope[at] = law.at(at)(depth[at])
    forces, blocks = np.zeros((len(gap), 3)), np.zeros((len(gap), 3, 3))
    force, n = (areas * pressure)[at, None], normal[at]
    forces[at] = force * n
    blocks[at] = _across((areas * slope)[at], n) - force[:, None] * curvature[at]
    return ContactResponse(
        gap, normal, curvature, depth, pressure, slope, forces, blocks, areas * energy
    )


def with_secant_stiffness(
    law: FaceLaw, areas: np.ndarray, now: ContactResponse, missing: np.ndarray
) -> ContactResponse:
    """The same points with other blocks: of the law's slope up to the pressure that balances the
    other forces. missing (n,): what is missing to that pressure [MPa].

    A point that nothing presses any more then leaves the face in one correction of Newton's method.
    With the tangent its depth is but halved, as the law starts with slope 0.
    """
    at = np.flatnonzero(now.pressure > 0)
    p = now.pressure[at]
    balancing = np.clip(p + missing[at], 0.0, MAX_SECANT_PRESSURE * p)
    changes = abs(balancing - p) > 1e-6 * p
    at, p, balancing = at[changes], p[changes], balancing[changes]
    chord = (balancing - p) / (law.at(at).depth(balancing) - now.depth[at])
    blocks = now.blocks.copy()
    blocks[at] += _across(areas[at] * (chord - now.slope[at]), now.normal[at])
    return now._replace(blocks=blocks)


class Resistance(NamedTuple):
    """Force along a tool's direction [N], its growth [N/mm], and the distance to touch [mm]."""

    force: float
    stiffness: float
    free: float


def find_balance(
    force: float, look: Callable[[float], Resistance], start: float, reach: float, soft: float
) -> bool:
    """Seek the travel at which `look(travel)` resists with `force` [N], by Newton's method between
    bounds; true if found. `look` was then called last there.

    start: travel to begin with; reach: what the tool may pass a point by, or go back, in one step;
    soft: step where it touches nothing and none is ahead [mm].
    """
    travel, back, low, high = start, reach, -np.inf, np.inf
    for _ in range(100):
        resistance = look(travel)
        missing = force - resistance.force
        if abs(missing) <= 1e-12 * force:
            return True
        low, high = (travel, high) if missing > 0 else (low, travel)
        is_stiff = resistance.stiffness > 0  # without contact as far as no point is passed
        step = missing / resistance.stiffness if is_stiff else resistance.free + soft
        new = travel + float(np.clip(step, -back, resistance.free + reach))
        back = 2 * back if np.isfinite(high) and np.isinf(low) else back
        if np.isfinite(low + high) and not low < new < high:
            new = 0.5 * (low + high)
            if new in (low, high):
                return True
        travel = new
    return False


def _across(stiffness, normal):
    """Blocks (n, 3, 3) that are stiff (n,) along `normal` (n, 3)."""
    return stiffness[:, None, None] * normal[:, :, None] * normal[:, None]
