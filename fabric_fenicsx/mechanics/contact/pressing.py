"""What presses: forces of points that are pressed into a face, for tools and for sheets."""

from typing import NamedTuple

import numpy as np

from .pressure_law import PressureLaw, chord

ANTICIPATED = 4.0  # times the present pressure, up to which the next one is anticipated


class Pressed(NamedTuple):
    """What a face does to n points: gap (n,) [mm] between both, below 0 where they overlap, its
    gradient `normal` (n, 3) and Hessian `curvature` (n, 3, 3) [1/mm], pressure (n,) [MPa], forces
    on the points (n, 3) [N], `blocks` (n, 3, 3) [N/mm] by which these fall as points move, and
    energy (n,) [N mm]."""

    gap: np.ndarray
    normal: np.ndarray
    curvature: np.ndarray
    pressure: np.ndarray
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
    energy, pressure, slope = law(np.maximum(0.0, shift - gap))
    if np.any(shift):
        energy = energy - law(np.asarray(shift))[0]
    force, energy = areas * pressure, areas * energy
    blocks = (areas * slope)[:, None, None] * normal[:, :, None] * normal[:, None]
    blocks -= force[:, None, None] * curvature
    return Pressed(gap, normal, curvature, pressure, force[:, None] * normal, blocks, energy)


def anticipate(law: PressureLaw, areas: np.ndarray, now: Pressed, missing: np.ndarray) -> Pressed:
    """The same points with other blocks: of the law's slope up to the pressure that balances the
    other forces. missing (n,): what is missing to that pressure [MPa].

    A point that nothing presses any more then leaves the face in one correction of Newton's method.
    With the tangent its depth is but halved, as the law starts with slope 0.
    """
    p, normal = now.pressure, now.normal
    balancing = np.clip(p + missing, 0.0, ANTICIPATED * p)
    change = areas * (chord(law, p, balancing) - law(law.depth(p))[2])
    across = change[:, None, None] * normal[:, :, None] * normal[:, None]
    return now._replace(blocks=now.blocks + across)
