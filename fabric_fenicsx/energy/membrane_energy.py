"""The heart: the membrane's strain energy E = int W t dA, from the yarns a0, b0 to W t dx.

One formula after the other, in the symbols and equation numbers of the paper (Schäfer, Werner,
Henning, Kärger); fa, fb and the thickness t of the law are ours. W(eps_a, eps_b, gamma), the
paper's W_tot, eq. (30), is the law's: `WovenFabric.energy` in `material/laws/coupled.py`.

- To change W, write a law (docs/howto/own_law.md); all below stays.
- To change a strain, change it in `material/strains.py`, with its derivatives in `in_invariants`.
- After a change below correct `variations`, or delete the method `Membrane.variations`, so that
  UFL derives all but friction between yarns. Each run compares both with the kernel.

    a0, b0, u -> fa, fb -> I4, I6, I8 -> eps_a, eps_b, gamma -> W -> t W dx
"""

from collections.abc import Sequence

from ufl import Form, Measure, diff, dot, grad, sqrt, variable
from ufl.core.expr import Expr

from ..material.energy import Energy
from ..material.expression import energy_in_ufl
from ..material.strains import in_invariants, nominal_strain, shear_angle

# unit vectors a0, b0 along undeformed yarns; deformed ones fa, fb; or what a displacement adds
Yarns = tuple[Expr, Expr]
# shares of an energy, and where each is integrated
Quadratures = Sequence[tuple[float, Measure]]


def added(u: Expr, a0: Expr, b0: Expr) -> Yarns:
    """grad(u) a0, grad(u) b0: what a displacement u, or a variation of it, adds to the yarns."""
    return dot(grad(u), a0), dot(grad(u), b0)


def deformed(u: Expr, a0: Expr, b0: Expr) -> Yarns:
    """fa = F a0, fb = F b0, with F = 1 + grad(u)."""
    ua, ub = added(u, a0, b0)
    return a0 + ua, b0 + ub


def invariants(fa: Expr, fb: Expr) -> tuple[Expr, Expr, Expr]:
    """I4 = a0.C.a0, I6 = a0.C.b0, I8 = b0.C.b0, eqs (5) to (7), with C = F^T F."""
    return dot(fa, fa), dot(fa, fb), dot(fb, fb)


def strains(I4: Expr, I6: Expr, I8: Expr, cosine: Expr) -> tuple[Expr, Expr, Expr]:
    """eps_a = sqrt(I4) - 1, eps_b = sqrt(I8) - 1, eq. (9), and gamma = I10, eq. (8), signed.

    gamma = arccos(a0.b0) - arccos(I6 / sqrt(I4 I8)), written with arctan. cosine: of the angle
    between the yarns without shear, a0.b0 or the weave's own. The law takes |gamma|: a signed one
    would leave W without a lower bound by the odd powers of eqs (26), (27).
    """
    gamma = shear_angle(I6, sqrt(I4 * I8 - I6**2), cosine, sqrt(1 - cosine**2))
    return nominal_strain(I4), nominal_strain(I8), gamma


def energy_density(I4: Expr, I6: Expr, I8: Expr, cosine: Expr, law: Energy) -> Expr:
    """W(eps_a, eps_b, gamma), eq. (10), by the law [MPa = N mm per mm^3 of undeformed fabric]."""
    return energy_in_ufl(law, *strains(I4, I6, I8, cosine))


def energy(f: Yarns, cosine: Expr, law: Energy, rules: Quadratures) -> Form:
    """E = int t W dA over the undeformed sheet [N mm]."""
    I4, I6, I8 = invariants(*f)
    W = energy_density(I4, I6, I8, cosine, law)
    return integral(law.thickness * W, rules)


def integral(values: Expr, rules: Quadratures) -> Form:
    """The values' integral, each share of them by its own rule."""
    return sum(share * values * dx for share, dx in rules)


# -- Derivatives by hand, as tangents by `ufl.derivative` take 1.8 to 2.3 times as long to assemble;


def slopes(I: tuple[Expr, Expr, Expr], cosine: Expr, law: Energy) -> tuple[list, list]:
    """W_i [3] and W_ij [3][3], derivatives of W in I = (I4, I6, I8)."""
    I4, I6, I8 = I
    q = [variable(strain) for strain in strains(I4, I6, I8, cosine)]
    W = energy_in_ufl(law, *q)
    W1 = [diff(W, x) for x in q]  # in the strains
    # min and max, so that UFL sees one expression for both of a symmetric pair
    W2 = [[diff(W1[min(i, j)], q[max(i, j)]) for j in range(3)] for i in range(3)]
    return in_invariants(I, 1 / sqrt(I4 * I8 - I6**2), W1, W2)


def variations(
    f: Yarns, dv: Yarns, dw: Yarns, cosine: Expr, law: Energy, rules: Quadratures
) -> list[Form]:
    """E' v and v E'' w; dv, dw: what v and w add to the yarns f. With W_i = dW / dI_i of
    I = (I4, I6, I8), in all of which gamma moves (not at fixed gamma as in eqs (11), (12)),

    E' v = int t sum_i W_i dI_i(v) dA
    v E'' w = int t (sum_ij dI_i(v) W_ij dI_j(w) + sum_i W_i ddI_i(v, w)) dA
    """
    (fa, fb), (va, vb), (wa, wb) = f, dv, dw
    W_i, W_ij = slopes(invariants(fa, fb), cosine, law)
    dIv = 2 * dot(fa, va), dot(fa, vb) + dot(fb, va), 2 * dot(fb, vb)
    dIw = 2 * dot(fa, wa), dot(fa, wb) + dot(fb, wa), 2 * dot(fb, wb)
    ddI = 2 * dot(va, wa), dot(va, wb) + dot(vb, wa), 2 * dot(vb, wb)
    first = sum(W_i[i] * dIv[i] for i in range(3))
    second = sum(W_i[i] * ddI[i] for i in range(3))
    for i in range(3):
        second += dIv[i] * sum(W_ij[i][j] * dIw[j] for j in range(3))
    return [integral(law.thickness * each, rules) for each in (first, second)]
