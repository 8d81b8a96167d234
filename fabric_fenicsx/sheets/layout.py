"""Place of a sheet and directions of its yarns."""

import math
from typing import Any, TypedDict

import numpy as np

from ..runtime.rules import BELOW_180, FINITE, Rule, unknown_key

FULL_TURN = Rule("an angle from -360 to 360 deg", lambda v: abs(v) <= 360)


class Layout(TypedDict, total=False):
    """Place of a sheet, its element and directions of its yarns, as in `Blank.rectangle`."""

    element: str | None
    fibre_angle: float
    yarn_angle: float
    turned: float
    centred: bool


def axes_of(turned: float) -> np.ndarray:
    """Directions of length and width of a sheet `turned` from x [rad], as rows (2, 2)."""
    return np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])


def blank_options(layout: Layout) -> dict[str, Any]:
    """Options of a `Blank` that lies so; InputError for an angle beyond a full turn."""
    for name in set(layout) - set(Layout.__annotations__):
        raise unknown_key(name, Layout.__annotations__, f"keyword {name}")
    fibre_angle = FULL_TURN.check("`fibre_angle`", layout.get("fibre_angle", 0.0))
    yarn_angle = BELOW_180.check("`yarn_angle`", layout.get("yarn_angle", 90.0))
    turned = FINITE.check("`turned`", layout.get("turned", 0.0))
    element = layout.get("element")
    a = math.radians(fibre_angle) + turned
    options: dict[str, Any] = {"a": a, "degree": int(element[1]) if element else None}
    if turned:
        options["frame"] = axes_of(turned)
    if yarn_angle != 90:
        options["b"] = a + math.radians(yarn_angle)
    return options
