"""The strains of a weave from its invariants, as the elements take them, in UFL and NumPy."""

from .functions import Number, atan, sqrt

# nominal strain by which yarns are shorter under compression where a real ply rather wrinkles
SHORTENED = 0.02
CRUMPLED = 0.05  # shortening of yarns beyond which a cell crumples


def share_name(strain: float) -> str:
    """Name of the share of the area with yarns shortened by more than `strain`."""
    return f"shortened_by_{100 * strain:g}_percent_share"


def nominal_strain(I: Number) -> Number:
    """sqrt(I) - 1 [-] of I4 or I8, eq. (9), without its loss of digits near I = 1."""
    return (I - 1) / (sqrt(I) + 1)


def shear_angle(I6: Number, area: Number, cos_angle: Number, sin_angle: Number) -> Number:
    """Invariant I10 = gamma [rad], eq. (8), signed; area: of the fibre pair, sqrt(I4 I8 - I6^2);
    cos_angle, sin_angle: of the angle between the yarns without shear."""
    # smooth where the paper's arccos is not
    return atan(I6 / area) - atan(cos_angle / sin_angle)


def in_invariants(
    I: Number, A: Number, W1: Number, W2: Number
) -> tuple[list[Number], list[list[Number]]]:
    """First, [3], and second, [3][3], derivatives of an energy in I = (I4, I6, I8), from W1 [3] and
    W2 [3][3] in (eps_a, eps_b, gamma). A: 1 / sqrt(I4 I8 - I6^2)."""
    I4, I6, I8 = I
    depend = (0, 2), (2,), (1, 2)  # strains, of (eps_a, eps_b, gamma), on I4, on I6 and on I8
    three, a, b, g = range(3), 1 / sqrt(I4), 1 / sqrt(I8), I6 * A / 2
    # dq/dI
    J = {(0, 0): a / 2, (1, 2): b / 2, (2, 0): -g * a**2, (2, 1): A, (2, 2): -g * b**2}
    first = [sum(W1[k] * J[k, i] for k in depend[i]) for i in three]
    A3 = A**2 * A
    H = {  # d2q/dI2
        (0, 0, 0): -a * a**2 / 4,
        (1, 2, 2): -b * b**2 / 4,
        (2, 0, 0): g * a**2 * (a**2 + I8 * A**2 / 2),
        (2, 2, 2): g * b**2 * (b**2 + I4 * A**2 / 2),
        (2, 0, 2): g * A**2 / 2,
        (2, 0, 1): -I8 * A3 / 2,
        (2, 1, 2): -I4 * A3 / 2,
        (2, 1, 1): I6 * A3,
    }
    moved = [[sum(W2[k][m] * J[m, j] for m in depend[j]) for j in three] for k in three]

    def second(i, j):
        return sum(J[k, i] * moved[k][j] + W1[k] * H.get((k, i, j), 0) for k in depend[i])

    return first, [[second(min(i, j), max(i, j)) for j in three] for i in three]
