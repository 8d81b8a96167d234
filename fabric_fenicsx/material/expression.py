"""A law's energy as a UFL expression that compiles to quick C."""

import ufl
from ufl import conditional, gt, lt
from ufl.classes import Condition, Exp, IntValue, Product, Variable
from ufl.core.expr import Expr
from ufl.corealg.map_dag import map_expr_dag
from ufl.corealg.multifunction import MultiFunction

from . import functions
from .energy import Energy
from .functions import negative, positive, where

for _name, _made in (("log", ufl.ln), ("atan", ufl.atan)):
    getattr(functions, _name).register(Expr, _made)
for _name in ("exp", "sqrt", "cos", "sin", "tan"):
    getattr(functions, _name).register(Expr, getattr(ufl, _name))
where.register(Condition, conditional)
# a factor 1 or 0, not a choice of expressions, so that C has no branches
positive.register(Expr, lambda x: conditional(gt(x, 0), 1.0, 0.0) * x)
negative.register(Expr, lambda x: (1 - conditional(gt(x, 0), 1.0, 0.0)) * x)


def energy_in_ufl(law: Energy, eps_a: Expr, eps_b: Expr, gamma: Expr) -> Expr:
    """W of a law [MPa] as a scalar UFL expression of the strains. The law is one of plain numbers,
    or of UFL constants in their place (`Law.symbols`)."""
    return map_expr_dag(_Quick(), ufl.as_ufl(sum(law.parts(eps_a, eps_b, gamma))))


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
    factors: list[Expr] = []
    for x in operands:
        factors += _factors(x.ufl_operands) if isinstance(x, Product) else [x]
    return factors


def _power(base, n):
    if n % 2:
        return base * _power(base, n - 1) if n > 1 else base
    return _power(base, n // 2) ** 2
