"""A law's energy and its derivatives as UFL expressions that compile to quick C."""

import ufl
from ufl import conditional, diff, gt, lt, variable
from ufl.classes import Condition, Exp, IntValue, Product, Variable
from ufl.core.expr import Expr
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

from . import functions
from .functions import negative, positive, sqrt, where
from .laws import Law
from .strains import in_invariants, nominal_strain, shear_angle

for _name, _made in (("log", ufl.ln), ("atan", ufl.atan)):
    getattr(functions, _name).register(Expr, _made)
for _name in ("exp", "sqrt", "cos", "sin", "tan"):
    getattr(functions, _name).register(Expr, getattr(ufl, _name))
where.register(Condition, conditional)
# a factor 1 or 0, not a choice of expressions, so that C has no branches
positive.register(Expr, lambda x: conditional(gt(x, 0), 1.0, 0.0) * x)
negative.register(Expr, lambda x: (1 - conditional(gt(x, 0), 1.0, 0.0)) * x)


def energy_density(I4: Expr, I6: Expr, I8: Expr, cos_angle: Expr, law: Law) -> Expr:
    """W [MPa = N mm per mm3 of undeformed fabric] of the invariants of eqs (5)-(7), scalar UFL.

    cos_angle: a0·b0, or the cosine of the weave's own angle if shear counts from that; any but
    +-1. law: one of plain numbers, or of UFL constants in their place (`Law.symbols`).
    """
    return _energy(_strains(I4, I6, I8, cos_angle), law)


def derivatives(
    I4: Expr, I6: Expr, I8: Expr, cos_angle: Expr, law: Law
) -> tuple[list[Expr], list[list[Expr]]]:
    """First, [3], and second, [3][3], derivatives of `energy_density` in (I4, I6, I8), in UFL.

    UFL derives the energy in the strains. The chain rule from these to the invariants is written
    out: the compiled kernel then has a third of the operations.
    """
    q = [variable(strain) for strain in _strains(I4, I6, I8, cos_angle)]
    W = _energy(q, law)
    W1 = [diff(W, x) for x in q]
    W2 = [[diff(W1[min(i, j)], q[max(i, j)]) for j in range(3)] for i in range(3)]
    first, second = in_invariants((I4, I6, I8), 1 / sqrt(I4 * I8 - I6**2), W1, W2)
    assert second is not None
    return first, second


def _strains(I4, I6, I8, cos_angle):
    gamma = shear_angle(I6, sqrt(I4 * I8 - I6**2), cos_angle, sqrt(1 - cos_angle**2))
    return [nominal_strain(I4), nominal_strain(I8), gamma]


def _energy(strains, law):
    return map_expr_dag(_Quick(), ufl.as_ufl(sum(law.parts(*strains))))


class _Quick(MultiFunction):
    """Rewrites an expression into an equal one that C computes faster."""

    expr = MultiFunction.reuse_if_untouched

    def variable(self, o, *operands):
        """Strains stay as they are: W is derived in them."""
        return o

    def power(self, o, base, exponent):
        """Products of squares: C's pow is quick for squares only."""
        n = exponent._value if isinstance(exponent, IntValue) else 0
        return _power(base, n) if n > 2 else self.reuse_if_untouched(o, base, exponent)

    def product(self, o, *operands):
        """One exponential in the place of several factors."""
        factors = _factors(operands)
        powers = [f.ufl_operands[0] for f in factors if isinstance(f, Exp)]
        if len(powers) < 2:
            return self.reuse_if_untouched(o, *operands)
        rest = 1
        for factor in factors:
            rest = rest if isinstance(factor, Exp) else rest * factor
        return rest * ufl.exp(sum(powers[1:], powers[0]))

    def abs(self, o, x):
        """A sign times a strain in which W is derived, where C would call a function."""
        if not isinstance(x, Variable):
            return self.reuse_if_untouched(o, x)
        return conditional(lt(x, 0), -1.0, 1.0) * x


def _factors(operands):
    found: list[Expr] = []
    for x in operands:
        found += _factors(x.ufl_operands) if isinstance(x, Product) else [x]
    return found


def _power(base, n):
    if n % 2:
        return base * _power(base, n - 1) if n > 1 else base
    return _power(base, n // 2) ** 2
