"""The strain energy density of a woven fabric in its fibre invariants: the one definition of the model.

Source: Schäfer, Werner, Henning, Kärger, eqs (5)-(30). Two readings of the paper are made here: the shear
energies (25)-(27) take |gamma|, since a weave does not care which way it is sheared (with signed odd powers the
energy would be unbounded below), and the last case of (13) is read as I8 <= 1, as in (30).
"""

from ufl import atan, conditional, exp, gt, sqrt


def shear_angle(I4, I6, I8, cos_angle):
    """Invariant I10 = gamma [rad], eq. (8), signed; `cos_angle` is a0·b0.

    As arctan of I6 over the area of the fibre pair it stays smooth where the paper's arccos does not.
    """
    return atan(I6 / sqrt(I4 * I8 - I6**2)) - atan(cos_angle / sqrt(1 - cos_angle**2))


def nominal_strain(I):
    """sqrt(I) - 1, eq. (9), without its loss of digits near I = 1."""
    return (I - 1) / (sqrt(I) + 1)


def energy_density(I4, I6, I8, cos_angle, fabric):
    """W_tot, eq. (30) [MPa = N mm per mm3 of undeformed fabric], as a UFL expression.

    I4, I6, I8: scalar UFL expressions of eqs (5)-(7); cos_angle: a0·b0 of the undeformed fabric, any but +-1;
    fabric: a `WovenFabric`, a `TabulatedFabric` or the `symbols` of one. A coupling that is off leaves no trace in the expression.
    The product form W_a + W_b + W_S k_SC,a k_SC,b equals the four cases of eq. (30).
    """
    eps_a, eps_b = nominal_strain(I4), nominal_strain(I8)
    if fabric.curves:  # the tabulated baseline: three energies of their own
        return sum(W(e) for W, e in zip(fabric.curves, (eps_a, eps_b, shear_angle(I4, I6, I8, cos_angle))))
    gamma2 = shear_angle(I4, I6, I8, cos_angle) ** 2
    gamma3 = abs(shear_angle(I4, I6, I8, cos_angle)) * gamma2

    def k_TC(yarn, eps_other):  # eqs (17), (18)
        return (1 - yarn.p_min) * exp(yarn.c * eps_other) + yarn.p_min if fabric.biaxial else 1

    def W_TC(yarn, I, eps, eps_other):  # eqs (15), (16), (19), (20) in tension, (22), (23) in compression
        W_T = (yarn.a * eps**3 + yarn.b * eps**2) * k_TC(yarn, eps_other)
        return conditional(gt(I, 1), W_T, yarn.d * eps**2)

    W_S = fabric.s1 / 2 * gamma2 + fabric.s2 / 3 * gamma3 + fabric.s3 / 4 * gamma2**2  # eq. (25)
    for yarn, I in (fabric.warp, I4), (fabric.weft, I8):
        if fabric.tension_shear:  # eqs (26), (27)
            W_S += conditional(gt(I, 1), yarn.s_T * gamma3 * (I - 1) ** 2 / 3, 0)
    for yarn, I in (fabric.warp, I4), (fabric.weft, I8):
        if fabric.compression_shear:  # eqs (28), (29)
            W_S *= conditional(gt(I, 1), 1, exp(yarn.s_C * (I - 1) ** 3))
    return W_TC(fabric.warp, I4, eps_a, eps_b) + W_TC(fabric.weft, I8, eps_b, eps_a) + W_S
