"""How a ply is held: under the die's flange, by grippers at its edges, in single nodes."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..mechanics.load import EdgeTension
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..sheets.blank import Blank, Part
from ..tools.tool import Tool

# what holds the rim, and the field that only this way uses
HOLDERS = {
    "pressure": "holder_pressure",
    "force": "holder_force",
    "gap": "holder_gap",
    "grippers": "gripper_tension",
}
FAR = 200  # mm, over which the flange is sought
RINGS = 2.0, 4.0, 6.0  # mm about a place, in which the die must be flat for it to be held


def check_holder(scenario: Any) -> None:
    """Raise InputError if a scenario is given a field of `HOLDERS` that its `holder` does not
    use."""
    usual = {each.name: each.default for each in dataclasses.fields(scenario)}
    for holder, name in HOLDERS.items():
        if holder != scenario.holder and getattr(scenario, name) != usual[name]:
            raise InputError(
                f"`{name}` is given, but `holder` is {scenario.holder}; allowed is it with "
                f'`holder="{holder}"`'
            )


def on_flange(die: Tool, thickness: float) -> Callable[[np.ndarray], np.ndarray]:
    """Function of places (n, 3) to the share of each (n,) that lies beneath the die's flange: 0 at
    its end, 1 from `RINGS` inwards. thickness: of all that lies between die and holder [mm]."""
    angles = np.arange(8) * math.pi / 4
    shifts = np.array(
        [(r * math.cos(a), r * math.sin(a), 0) for r, a in itertools.product(RINGS, angles)]
    )

    def share(x):
        at = (x * (1, 1, 0) + shifts[:, None]).reshape(-1, 3)
        gap, normal, _ = die.evaluate(at, reach=thickness)
        flat = (abs(gap - thickness / 2) < 1e-3 * thickness) & (normal[:, 2] < -0.999)
        return np.clip(2 * flat.reshape(len(shifts), -1).sum(0) / len(shifts) - 1, 0, 1)

    return share


def loose_ends_warnings(under: Callable[[np.ndarray], np.ndarray], corner: np.ndarray) -> list[str]:
    """A warning if a sheet ends on the x or y axis over the die's opening, where no holder presses
    it. under: as `on_flange` gives it; corner (2,): largest x and y of the sheet [mm]."""
    loose = []
    for name, axis, end in zip("xy", np.eye(3), corner):
        held = np.flatnonzero(under((end + np.arange(FAR))[:, None] * axis))
        if not len(held):
            loose.append(f"at {name} = {end:.4g} mm, more than {FAR} mm from the flange")
        elif held[0]:
            loose.append(f"at {name} = {end:.4g} mm, {held[0]} mm from the flange")
    return [
        f"the smallest sheet ends over the die's opening {place}: the blank holder does not press "
        "it there"
        for place in loose
    ]


def gripped_edges(blank: Blank, tension: float, whole: bool) -> list[Term]:
    """Tension [N/mm] on each free edge of a rectangular ply, or of its quarter."""
    low, high = blank.extent()
    return [
        EdgeTension(tension, sign * np.eye(3)[axis], _at(axis, place))
        for axis in (0, 1)
        for place, sign in ((low[axis], -1.0), (high[axis], 1.0))
        if sign > 0 or whole
    ]


def nearest_nodes(
    parts: Sequence[Part], place: tuple[float, float]
) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) to a mask (n,) of one node of each part: the nearest to `place` (x,
    y) [mm], of several the one that is last by x and y."""
    found = []
    for part in parts:
        x = part.blank.coordinates()[: len(part.nodes)][part.nodes]
        away = np.hypot(*(x[:, :2] - place).T).round(6)
        order = np.lexsort((-x[:, 1], -x[:, 0], away))[:1]
        known = [(away[k], *-x[k]) for k in order]
        found.append(min(each for rank in part.blank.mesh.comm.allgather(known) for each in rank))
    nodes = -np.array(found)[:, 1:]
    return lambda x: (np.linalg.norm(x.T[:, None] - nodes, axis=2) < 1e-6).any(1)


def _at(axis, place):
    """Function of points (3, n) to whether their coordinate along `axis` is `place` [mm]."""
    return lambda x: abs(x[axis] - place) < 1e-6
