"""The strain energy density of a woven fabric in its fibre invariants: the one definition of the model.

Source: Schäfer, Werner, Henning, Kärger, eqs (5)-(30). Two readings of the paper are made here: the shear
energies (25)-(27) take |gamma|, since a weave does not care which way it is sheared (with signed odd powers the
energy would be unbounded below), and the last case of (13) is read as I8 <= 1, as in (30).
"""

from types import SimpleNamespace

from ufl import atan, conditional, diff, exp, gt, lt, sqrt, variable
from ufl.core.expr import Expr

from .parameters import WovenFabric

Law = WovenFabric | SimpleNamespace  # the latter: the `symbols` of one, or of a `TabulatedFabric`


def shear_angle(I4: Expr, I6: Expr, I8: Expr, cos_angle: Expr) -> Expr:
    """Invariant I10 = gamma [rad], eq. (8), signed; `cos_angle` is a0·b0, or the cosine of the weave's own angle if
    shear counts from that.

    As arctan of I6 over the area of the fibre pair it stays smooth where the paper's arccos does not.
    """
    return atan(I6 / sqrt(I4 * I8 - I6**2)) - atan(cos_angle / sqrt(1 - cos_angle**2))


def nominal_strain(I: Expr) -> Expr:
    """sqrt(I) - 1 [-], eq. (9), without its loss of digits near I = 1."""
    return (I - 1) / (sqrt(I) + 1)


def tension_and_compression(eps: Expr) -> tuple[Expr, Expr]:
    """The parts of a yarn's strain above and below zero, which add up to it: the cases of eqs (13) and (30)."""
    stretched = conditional(gt(eps, 0), 1.0, 0.0)
    return stretched * eps, (1 - stretched) * eps


def energy_of_strains(eps_a: Expr, eps_b: Expr, gamma: Expr, fabric: Law) -> Expr:
    """W_tot, eq. (30) [MPa = N mm per mm3 of undeformed fabric], as a UFL expression.

    eps_a, eps_b: nominal strains of the yarns, gamma: magnitude of the shear angle, scalar UFL expressions; fabric: a
    `WovenFabric`, or the `symbols` of one or of a `TabulatedFabric`. A coupling that is off leaves no trace in the
    expression. The product form W_a + W_b + W_S k_SC,a k_SC,b equals the four cases of eq. (30), as each factor is 1 and
    each term 0 in the cases that lack it.
    """
    if fabric.curves:  # the tabulated baseline: three energies of their own
        return sum(W(e) for W, e in zip(fabric.curves, (eps_a, eps_b, gamma)))
    gamma2, gamma3 = gamma**2, gamma * gamma**2
    warp = fabric.warp, *tension_and_compression(eps_a), eps_b
    weft = fabric.weft, *tension_and_compression(eps_b), eps_a
    W, W_S, k_SC = 0, fabric.s1 * gamma2 / 2 + fabric.s2 * gamma3 / 3 + fabric.s3 * gamma2**2 / 4, 0  # eq. (25)
    for yarn, tension, compression, eps_other in (warp, weft):
        k_TC = (1 - yarn.p_min) * exp(yarn.c * eps_other) + yarn.p_min if fabric.biaxial else 1  # eqs (17), (18)
        W += (yarn.a * tension + yarn.b) * tension**2 * k_TC  # eqs (15), (16), (19), (20)
        W += yarn.d * compression**2  # eqs (22), (23)
        if fabric.tension_shear:  # eqs (26), (27), with I - 1 = eps (2 + eps)
            W_S += yarn.s_T * gamma3 * (tension * (2 + tension)) ** 2 / 3
        if fabric.compression_shear:  # eqs (28), (29): the logarithm of their product
            I_1 = compression * (2 + compression)
            k_SC += yarn.s_C * I_1 * I_1**2  # C's pow is quick for squares only
    return W + W_S * (exp(k_SC) if fabric.compression_shear else 1)


def energy_density(I4: Expr, I6: Expr, I8: Expr, cos_angle: Expr, fabric: Law) -> Expr:
    """W_tot of the invariants of eqs (5)-(7), scalar UFL expressions; cos_angle: as in `shear_angle`, any
    but +-1; the rest as in `energy_of_strains`."""
    gamma = shear_angle(I4, I6, I8, cos_angle)
    return energy_of_strains(nominal_strain(I4), nominal_strain(I8), abs(gamma), fabric)


def derivatives(I4: Expr, I6: Expr, I8: Expr, cos_angle: Expr, fabric: Law) -> tuple[list[Expr], list[list[Expr]]]:
    """First, [3], and second, [3][3], derivatives of `energy_density` in (I4, I6, I8), as UFL expressions.

    Those of eq. (30) in the strains are UFL's; the chain rule to the invariants is written out, as the compiled kernel
    then has a third of the operations that UFL's own makes.
    """
    q = [variable(e) for e in (nominal_strain(I4), nominal_strain(I8), shear_angle(I4, I6, I8, cos_angle))]
    W = energy_of_strains(q[0], q[1], conditional(lt(q[2], 0), -1.0, 1.0) * q[2], fabric)  # cheaper than abs
    W1 = [diff(W, x) for x in q]
    W2 = [[diff(W1[min(i, j)], q[max(i, j)]) for j in range(3)] for i in range(3)]
    A = 1 / sqrt(I4 * I8 - I6**2)
    a, b, g = 1 / sqrt(I4), 1 / sqrt(I8), I6 * A / 2
    J = [[a / 2, 0, 0], [0, 0, b / 2], [-g * a**2, A, -g * b**2]]  # dq/dI
    A3 = A**2 * A
    g44, g48, g88 = g * a**2 * (a**2 + I8 * A**2 / 2), g * A**2 / 2, g * b**2 * (b**2 + I4 * A**2 / 2)
    H = [
        [[-a * a**2 / 4, 0, 0], [0, 0, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [0, 0, -b * b**2 / 4]],
        [[g44, -I8 * A3 / 2, g48], [-I8 * A3 / 2, I6 * A3, -I4 * A3 / 2], [g48, -I4 * A3 / 2, g88]],
    ]  # d2q/dI2
    first = [sum(W1[k] * J[k][i] for k in range(3)) for i in range(3)]
    moved = [[sum(W2[k][m] * J[m][i] for m in range(3)) for i in range(3)] for k in range(3)]
    second = [[sum(J[k][i] * moved[k][j] + W1[k] * H[k][i][j] for k in range(3)) for j in range(3)] for i in range(3)]
    return first, second
