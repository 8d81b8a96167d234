"""How a ply of fabric loses thickness under pressure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..runtime.rules import Rule, above_zero
from .parameters import Parameters


@dataclass(frozen=True)
class Compaction(Parameters):
    """Pressure p over the thickness h of a ply: p = p_0 ((h_0 / h)^n - 1).

    So the fibre volume fraction grows with the power 1/n of pressure, once that is well above p_0.

    - exponent: n; onset: p_0 [MPa], from which on the power law holds
    - pressure [MPa], under which the fabric has its thickness; h_0 is that without pressure

    Raises InputError for an exponent up to 1, and pressures not above 0.
    """

    rules: ClassVar[Mapping[str, Rule]] = {
        "exponent": Rule("a number above 1", lambda v: v > 1),
        "onset": above_zero("stress"),
        "pressure": above_zero("stress"),
    }

    exponent: float = 16.0
    onset: float = 1e-3
    pressure: float = 1e-3

    def thickness(self, p: ArrayLike) -> np.ndarray:
        """Thickness under pressures p from 0 [MPa], over the fabric's."""
        ratio = (self.onset + self.pressure) / (self.onset + np.asarray(p, dtype=float))
        return ratio ** (1 / self.exponent)
