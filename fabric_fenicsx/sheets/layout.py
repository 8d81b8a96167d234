"""Place of a sheet and directions of its yarns."""

import math
from collections.abc import Sequence
from typing import Any, TypedDict

import numpy as np

from ..readers.field import Field, of_place
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..runtime.rules import BELOW_180, FINITE, Rule, unknown_key

FLAT_TOLERANCE = 1e-6  # of its size, up to which a sheet is flat
FULL_TURN = Rule("an angle from -360 to 360 deg", lambda v: abs(v) <= 360)


class Layout(TypedDict, total=False):
    """Place of a sheet, its element and directions of its yarns, as in `Blank.rectangle`."""

    element: str | None
    fibre_angle: float | Field
    yarn_angle: float
    turned: float
    centred: bool | list[bool]
    planes: Sequence[int]


def axes_of(turned: float) -> np.ndarray:
    """Directions of length and width of a sheet `turned` from x [rad], as rows (2, 2)."""
    return np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])


def blank_options(layout: Layout) -> dict[str, Any]:
    """Options of a `Blank` that lies so; InputError for an angle beyond a full turn."""
    for name in set(layout) - set(Layout.__annotations__):
        raise unknown_key(name, Layout.__annotations__, f"keyword {name}")
    fibre_angle = of_place(FULL_TURN).check("`fibre_angle`", layout.get("fibre_angle", 0.0))
    layout["fibre_angle"] = fibre_angle
    yarn_angle = BELOW_180.check("`yarn_angle`", layout.get("yarn_angle", 90.0))
    turned = FINITE.check("`turned`", layout.get("turned", 0.0))
    element = layout.get("element")
    a = _direction(fibre_angle, turned)
    options: dict[str, Any] = {"a": a, "degree": int(element[1]) if element else None}
    if turned:
        options["frame"] = axes_of(turned)
    if yarn_angle != 90:
        options["b"] = _direction(fibre_angle, turned + math.radians(yarn_angle))
    return options


def _direction(angle, more):
    """An angle [deg], or one at places (3, n), and `more` [rad], in rad."""
    if isinstance(angle, Field):
        return lambda x: np.radians(angle.at(x.T)) + more
    return math.radians(angle) + more


def yarns_at(layout: Layout, place: Sequence[float]) -> tuple[float, float]:
    """Angle from the length to yarns a, and from there to yarns b, [rad] at a place (x, y)."""
    angle = layout.get("fibre_angle", 0.0)
    if isinstance(angle, Field):
        angle = float(angle.at(np.array([[*place, 0.0]]))[0])
    return math.radians(angle), math.radians(layout.get("yarn_angle", 90.0))


def moved_sheet(
    points: np.ndarray, source: str, centred: bool, height: float | None
) -> tuple[np.ndarray, list[str]]:
    """Points (n, 2 or 3) [mm] of a sheet with the middle of its extent at the origin if it is to be
    `centred`, and at z = `height` unless that is None; with a warning where z changes. Raises
    InputError for a sheet that is not flat and has a `height`."""
    points, warnings = points.copy(), list[str]()
    low, high = points.min(0), points.max(0)
    if centred:
        points[:, :2] -= (low + high)[:2] / 2
    if height is not None and len(low) == 3:
        if high[2] - low[2] > FLAT_TOLERANCE * (high - low).max():
            raise InputError(
                f"{source} reaches from z = {rounded(low[2], 4)} to {rounded(high[2], 4)} mm; "
                "allowed is a flat sheet, in a plane z = const"
            )
        points[:, 2] = height
        if abs(low[2] - height) > FLAT_TOLERANCE * (high - low).max():
            warnings.append(
                f"{source} lies in z = {rounded(low[2], 4)} mm and was put in z = {height:g}, "
                "where the blank of a press is"
            )
    return points, warnings
