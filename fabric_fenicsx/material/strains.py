"""The strains of a weave from its invariants, for NumPy and UFL alike."""

import math
from typing import Any

from ..runtime.rules import Rule
from .functions import atan, sqrt

# nominal strain by which yarns are shorter under compression where a real ply rather wrinkles
SHORTENED = 0.02
WEAVE_ANGLE = Rule("an angle above 0 and below pi", lambda v: 0 < v < math.pi)


def share_name(strain: float) -> str:
    """Name of the share of the area with yarns shortened by more than `strain`."""
    return f"shortened_by_{100 * strain:g}_percent_share"


def nominal_strain(I: Any) -> Any:
    """sqrt(I) - 1 [-] of I4 or I8, eq. (9), without its loss of digits near I = 1."""
    return (I - 1) / (sqrt(I) + 1)


def shear_angle(I6: Any, area: Any, cos_angle: Any, sin_angle: Any) -> Any:
    """Invariant I10 = gamma [rad], eq. (8), signed.

    As arctan of I6 over the area of the fibre pair, sqrt(I4 I8 - I6^2), it stays smooth where the
    paper's arccos does not. cos_angle, sin_angle: of the angle between the yarns without shear,
    which is the initial one, a0·b0, or the weave's own.
    """
    return atan(I6 / area) - atan(cos_angle / sin_angle)


def check_weave_angle(angle: float) -> float:
    """`angle` between the yarns of a weave without shear [rad]; InputError unless it is above 0
    and below pi."""
    return WEAVE_ANGLE.check("`weave_angle` [rad]", angle)
