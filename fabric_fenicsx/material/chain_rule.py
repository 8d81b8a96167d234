"""Derivatives of the energy in the invariants from those in the strains, for NumPy and UFL alike.

W depends on I4, I6, I8 by eps_a(I4), eps_b(I8), eq. (9), and gamma(I4, I6, I8), eq. (8).
"""

from typing import Any

from .functions import sqrt


def in_invariants(
    first: Any, second: Any, I4: Any, I6: Any, I8: Any, area: Any
) -> tuple[tuple[Any, Any, Any], dict[tuple[int, int], Any]]:
    """First derivatives of W in (I4, I6, I8), and second ones {(i, j): value} for i <= j, empty if
    `second` is None.

    first: in eps_a, eps_b, gamma; second: aa, ab, bb, ag, bg, gg, as `Law.derivatives` orders them;
    area: sqrt(I4 I8 - I6^2), of the fibre pair.
    """
    Wa, Wb, Wg = first
    a, b, A = 1 / sqrt(I4), 1 / sqrt(I8), 1 / area
    g = I6 * A / 2
    a4, b8 = a / 2, b / 2  # d eps_a / d I4, d eps_b / d I8
    g4, g6, g8 = -g * a**2, A, -g * b**2  # d gamma / d (I4, I6, I8)
    slopes = Wa * a4 + Wg * g4, Wg * g6, Wb * b8 + Wg * g8
    if second is None:
        return slopes, {}
    Waa, Wab, Wbb, Wag, Wbg, Wgg = second
    A3 = A**2 * A
    a44, b88 = -a * a**2 / 4, -b * b**2 / 4
    g44, g88 = g * a**2 * (a**2 + I8 * A**2 / 2), g * b**2 * (b**2 + I4 * A**2 / 2)
    g46, g66, g68, g48 = -I8 * A3 / 2, I6 * A3, -I4 * A3 / 2, g * A**2 / 2
    # d (dW/d gamma) / d (I4, I6, I8)
    Wg4, Wg6, Wg8 = Wag * a4 + Wgg * g4, Wgg * g6, Wbg * b8 + Wgg * g8
    return slopes, {
        (0, 0): (Waa * a4 + Wag * g4) * a4 + Wa * a44 + Wg4 * g4 + Wg * g44,
        (0, 1): Wag * g6 * a4 + Wg6 * g4 + Wg * g46,
        (0, 2): (Wab * b8 + Wag * g8) * a4 + Wg8 * g4 + Wg * g48,
        (1, 1): Wg6 * g6 + Wg * g66,
        (1, 2): Wg8 * g6 + Wg * g68,
        (2, 2): (Wbb * b8 + Wbg * g8) * b8 + Wb * b88 + Wg8 * g8 + Wg * g88,
    }
