"""The strain energy density of a woven fabric in its fibre invariants: the one definition of the model.

Source: Schäfer, Werner, Henning, Kärger, eqs (5)-(30). Two readings of the paper are made here: the shear
energies (25)-(27) take |gamma|, since a weave does not care which way it is sheared (with signed odd powers the
energy would be unbounded below), and the last case of (13) is read as I8 <= 1, as in (30).
"""

from types import SimpleNamespace

from ufl import atan, conditional, diff, exp, gt, sqrt, variable
from ufl.core.expr import Expr

from .parameters import WovenFabric

Law = WovenFabric | SimpleNamespace  # the latter: the `symbols` of one, or of a `TabulatedFabric`


def shear_angle(I4: Expr, I6: Expr, I8: Expr, cos_angle: Expr) -> Expr:
    """Invariant I10 = gamma [rad], eq. (8), signed; `cos_angle` is a0·b0.

    As arctan of I6 over the area of the fibre pair it stays smooth where the paper's arccos does not.
    """
    return atan(I6 / sqrt(I4 * I8 - I6**2)) - atan(cos_angle / sqrt(1 - cos_angle**2))


def nominal_strain(I: Expr) -> Expr:
    """sqrt(I) - 1 [-], eq. (9), without its loss of digits near I = 1."""
    return (I - 1) / (sqrt(I) + 1)


def energy_of_strains(eps_a: Expr, eps_b: Expr, gamma: Expr, fabric: Law) -> Expr:
    """W_tot, eq. (30) [MPa = N mm per mm3 of undeformed fabric], as a UFL expression.

    eps_a, eps_b: nominal strains of the yarns, gamma: shear angle, scalar UFL expressions; fabric: a `WovenFabric`, or
    the `symbols` of one or of a `TabulatedFabric`. A coupling that is off leaves no trace in the expression.
    The product form W_a + W_b + W_S k_SC,a k_SC,b equals the four cases of eq. (30).
    """
    if fabric.curves:  # the tabulated baseline: three energies of their own
        return sum(W(e) for W, e in zip(fabric.curves, (eps_a, eps_b, gamma)))
    gamma2 = gamma**2
    gamma3 = abs(gamma) * gamma2

    def k_TC(yarn, eps_other):  # eqs (17), (18)
        return (1 - yarn.p_min) * exp(yarn.c * eps_other) + yarn.p_min if fabric.biaxial else 1

    def W_TC(yarn, eps, eps_other):  # eqs (15), (16), (19), (20) in tension, (22), (23) in compression
        W_T = (yarn.a * eps + yarn.b) * eps**2 * k_TC(yarn, eps_other)
        return conditional(gt(eps, 0), W_T, yarn.d * eps**2)

    W_S = fabric.s1 / 2 * gamma2 + fabric.s2 / 3 * gamma3 + fabric.s3 / 4 * gamma2**2  # eq. (25)
    yarns = (fabric.warp, eps_a), (fabric.weft, eps_b)
    for yarn, eps in yarns:
        if fabric.tension_shear:  # eqs (26), (27), with I - 1 = eps (2 + eps)
            W_S += conditional(gt(eps, 0), yarn.s_T * gamma3 * (eps * (2 + eps)) ** 2 / 3, 0)
    for yarn, eps in yarns:
        if fabric.compression_shear:  # eqs (28), (29)
            W_S *= conditional(gt(eps, 0), 1, exp(yarn.s_C * (eps * (2 + eps)) * (eps * (2 + eps)) ** 2))
    return W_TC(fabric.warp, eps_a, eps_b) + W_TC(fabric.weft, eps_b, eps_a) + W_S


def energy_density(I4: Expr, I6: Expr, I8: Expr, cos_angle: Expr, fabric: Law) -> Expr:
    """W_tot of the invariants of eqs (5)-(7), scalar UFL expressions; cos_angle: a0·b0 of the undeformed fabric, any
    but +-1; the rest as in `energy_of_strains`."""
    return energy_of_strains(nominal_strain(I4), nominal_strain(I8), shear_angle(I4, I6, I8, cos_angle), fabric)


def derivatives(I4: Expr, I6: Expr, I8: Expr, cos_angle: Expr, fabric: Law) -> tuple[list[Expr], list[list[Expr]]]:
    """First, [3], and second, [3][3], derivatives of `energy_density` in (I4, I6, I8), as UFL expressions.

    Those of eq. (30) in the strains are UFL's; the chain rule to the invariants is written out, as the compiled kernel
    then has a third of the operations that UFL's own makes.
    """
    q = [variable(e) for e in (nominal_strain(I4), nominal_strain(I8), shear_angle(I4, I6, I8, cos_angle))]
    W = energy_of_strains(q[0], q[1], q[2], fabric)
    W1 = [diff(W, x) for x in q]
    W2 = [[diff(W1[min(i, j)], q[max(i, j)]) for j in range(3)] for i in range(3)]
    A = 1 / sqrt(I4 * I8 - I6**2)
    a, b, g = 1 / sqrt(I4), 1 / sqrt(I8), I6 * A / 2
    J = [[a / 2, 0, 0], [0, 0, b / 2], [-g * a**2, A, -g * b**2]]  # dq/dI
    A3 = A**2 * A
    g44, g48, g88 = g * (a**4 + I8 * A**2 * a**2 / 2), g * A**2 / 2, g * (b**4 + I4 * A**2 * b**2 / 2)
    H = [
        [[-a * a**2 / 4, 0, 0], [0, 0, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [0, 0, -b * b**2 / 4]],
        [[g44, -I8 * A3 / 2, g48], [-I8 * A3 / 2, I6 * A3, -I4 * A3 / 2], [g48, -I4 * A3 / 2, g88]],
    ]  # d2q/dI2
    first = [sum(W1[k] * J[k][i] for k in range(3)) for i in range(3)]
    moved = [[sum(W2[k][m] * J[m][i] for m in range(3)) for i in range(3)] for k in range(3)]
    second = [[sum(J[k][i] * moved[k][j] + W1[k] * H[k][i][j] for k in range(3)) for j in range(3)] for i in range(3)]
    return first, second
