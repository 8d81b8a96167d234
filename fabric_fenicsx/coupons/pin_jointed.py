"""A strip pulled by clamped ends whose yarns do not stretch and turn freely where they cross.

In the plane such a net is x = p(alpha) + q(beta), with alpha and beta measured along yarns a and b
of the flat strip: both derivatives are unit vectors, so the mixed one is normal to both and
vanishes (Rivlin, J. Rational Mech. Anal. 4, 1955). So p' is the direction of yarns a all along a
yarn b, and is the initial one where that yarn ends in a clamp. What is left are the stretches of
alpha and beta between those of both clamps. With one direction in each, they are two sides of a
triangle whose third side lengthens with the clamps' distance.
"""

import math

import numpy as np
from numpy.typing import ArrayLike


class PinJointedStrip:
    """Strip of `length` and `width` [mm], clamped at x = 0 and x = length; a, b: angles of its
    yarns to x [rad]."""

    def __init__(self, length: float, width: float, a: float, b: float) -> None:
        self.length, self.width, self.a, self.b = length, width, a, b
        # from (x, y) to (alpha, beta)
        yarns = [[math.cos(a), math.cos(b)], [math.sin(a), math.sin(b)]]
        self._coordinates = np.linalg.inv(yarns)
        along, across = abs(self._coordinates).T
        self._gaps = length * along - width * across  # of alpha and of beta between the clamps

    @property
    def locked(self) -> str:
        """Reason why the strip can't lengthen, if it can't: yarns from clamp to clamp; else ""."""
        small = 1e-9 * self.length
        # alpha is constant along yarns b
        names = [name for name, gap in zip("ba", self._gaps) if gap <= small]
        return f"yarns {' and '.join(names[::-1])} run from clamp to clamp" if names else ""

    def turns(self, displacement: float) -> tuple[float, float]:
        """Angles [rad], anticlockwise, by which yarns a and b turn where both are free, at a
        displacement of the clamp [mm]; nan if the strip is `locked` or that is beyond its reach."""
        if self.locked:
            return math.nan, math.nan
        la, lb = self._gaps
        # directions as complex numbers, both from clamp to clamp
        a, b = np.exp([1j * self.a, 1j * self.b]) * np.sign(self._coordinates[:, 0])
        third = la * a + lb * b + displacement
        cosine = (abs(third) ** 2 - la * la - lb * lb) / (2 * la * lb)
        if abs(cosine) > 1:
            return math.nan, math.nan
        between = cosine + 1j * math.copysign(math.sqrt(1 - cosine**2), (b / a).imag)
        turned = third / (la + lb * between)  # yarns a, of any length
        return float(np.angle(turned / a)), float(np.angle(turned * between / b))

    def shear_angle(self, displacement: float, rest: float | None = None) -> float:
        """Shear angle of eq. (8) where both yarns are free [rad], nan as in `turns`.

        rest: angle between the yarns without shear [rad], by default the initial one. For yarns at
        t and t + 90 deg: sin|gamma| = d (2 (L - W sin 2t) + d) / (2 (L cos t - W sin t) (L sin t -
        W cos t)).
        """
        return self._sheared(*self.turns(displacement), rest)

    def shear_angles(
        self, x: ArrayLike, y: ArrayLike, displacement: float, rest: float | None = None
    ) -> np.ndarray:
        """The same at places x, y (n,) of the flat strip [mm], all over it, (n,)."""
        (a_held, b_held), _ = self.held(x, y)
        turn_a, turn_b = self.turns(displacement)
        return self._sheared(np.where(b_held, 0, turn_a), np.where(a_held, 0, turn_b), rest)

    def _sheared(self, turn_a, turn_b, rest):
        initial = math.acos(math.cos(self.b - self.a)) if rest is None else rest
        return initial - np.arccos(np.cos(self.b + turn_b - self.a - turn_a))

    def held(self, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Mask (2, n) of yarns a and b through places x, y (n,) that end in a clamp, and distances
        of the places to the lines where that changes, (n,) [mm]."""
        places = self._coordinates @ np.stack(np.broadcast_arrays(x, y))
        of_length = self.length * self._coordinates[:, :1]
        of_width = self.width * self._coordinates[:, 1:]
        low, high = np.minimum(0, of_width), np.maximum(0, of_width)
        from_clamps = places, places - of_length
        clamped, other = [(low <= place) & (place <= high) for place in from_clamps]
        off = [abs(place - edge) for edge in (low, high) for place in from_clamps]
        # alpha tells which yarn b it is, beta which yarn a
        return (clamped | other)[::-1], np.min(off, axis=(0, 1)) * abs(math.sin(self.b - self.a))
