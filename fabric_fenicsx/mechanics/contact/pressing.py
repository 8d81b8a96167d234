"""What presses: forces of points that are pressed into a face, for tools and for sheets."""

from typing import NamedTuple

import numpy as np

from ...runtime.compiled import compiled
from .pressure_law import PressureLaw, only

ANTICIPATED = 4.0  # times the present pressure, up to which the next one is anticipated


class Pressed(NamedTuple):
    """What a face does to n points: gap (n,) [mm] between both, below 0 where they overlap, its
    gradient `normal` (n, 3) and Hessian `curvature` (n, 3, 3) [1/mm], depth (n,) [mm] to which the
    raised face is pressed in, pressure (n,) [MPa] and its slope (n,) [N/mm^3], forces on the points
    (n, 3) [N], `blocks` (n, 3, 3) [N/mm] by which these fall as points move, and energy (n,)
    [N mm]."""

    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray
    depth: np.ndarray
    pressure: np.ndarray
    slope: np.ndarray
    forces: np.ndarray
    blocks: np.ndarray
    energy: np.ndarray


def press(
    law: PressureLaw,
    areas: np.ndarray,
    gap: np.ndarray,
    normal: np.ndarray,
    curvature: np.ndarray,
    shift: float | np.ndarray = 0.0,
) -> Pressed:
    """Points of `areas` (n,) [mm^2] pressed by a law at gaps (n,) [mm], with the gaps' gradients
    (n, 3) and Hessians (n, 3, 3) [1/mm]. shift: by which the face is raised, one or for each point
    (n,) [mm]; the energy is that beyond the shift's own."""
    depth = np.maximum(0.0, shift - gap)
    energy, pressure, slope = np.zeros((3, len(gap)))
    at = np.flatnonzero(depth != 0)  # those that are not numbers among them
    energy[at], pressure[at], slope[at] = only(law, at)(depth[at])
    if np.any(shift):
        energy -= law(np.broadcast_to(shift, len(gap)))[0]
    normal, curvature = np.ascontiguousarray(normal), np.ascontiguousarray(curvature)
    forces, blocks = _pushed(areas * pressure, areas * slope, normal, curvature)
    return Pressed(gap, normal, curvature, depth, pressure, slope, forces, blocks, areas * energy)


def anticipate(law: PressureLaw, areas: np.ndarray, now: Pressed, missing: np.ndarray) -> Pressed:
    """The same points with other blocks: of the law's slope up to the pressure that balances the
    other forces. missing (n,): what is missing to that pressure [MPa].

    A point that nothing presses any more then leaves the face in one correction of Newton's method.
    With the tangent its depth is but halved, as the law starts with slope 0.
    """
    at = np.flatnonzero(now.pressure > 0)
    p, change = now.pressure[at], np.zeros(len(areas))
    balancing = np.clip(p + missing[at], 0.0, ANTICIPATED * p)
    changes = abs(balancing - p) > 1e-6 * p
    at, p, balancing = at[changes], p[changes], balancing[changes]
    chord = (balancing - p) / (only(law, at).depth(balancing) - now.depth[at])
    change[at] = areas[at] * (chord - now.slope[at])
    return now._replace(blocks=_stiffened(now.blocks, change, now.normal))


@compiled
def _pushed(force, stiffness, normal, curvature):
    """Forces (n, 3) of sizes `force` (n,), and by how much they fall as points move (n, 3, 3)."""
    forces, blocks = np.zeros((len(force), 3)), np.zeros((len(force), 3, 3))
    for n in range(len(force)):
        if force[n] == 0 and stiffness[n] == 0:
            continue
        for i in range(3):
            forces[n, i] = force[n] * normal[n, i]
            for j in range(3):
                across = stiffness[n] * normal[n, i] * normal[n, j]
                blocks[n, i, j] = across - force[n] * curvature[n, i, j]
    return forces, blocks


@compiled
def _stiffened(blocks, change, normal):
    """Blocks (n, 3, 3) that are by `change` (n,) stiffer along `normal` (n, 3)."""
    found = blocks.copy()
    for n in range(len(change)):
        if change[n] != 0:
            for i in range(3):
                for j in range(3):
                    found[n, i, j] += change[n] * normal[n, i] * normal[n, j]
    return found
