"""Numbers and functions in which laws are written, for NumPy, hyper-dual numbers and UFL alike.

Hyper-dual numbers carry their first and second derivatives through arithmetic, exact to rounding
(Fike and Alonso, AIAA paper 2011-886). Unlike complex steps they give second derivatives, too,
without cancellation. `exp`, `log`, `sqrt`, `cos`, `sin`, `tan` and `atan` are those of mathematics.
What they do with UFL expressions is registered by `expression`.
"""

from functools import singledispatch
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

Number = Any  # a float, an array, a `HyperDual`, or an expression of UFL

# which two variables each second derivative belongs to: aa, ab, bb, ag, bg, gg
FIRST, SECOND = [0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]


class HyperDual:
    """`value` (...), with `first` derivatives (3, ...) in three variables and `second` (6, ...),
    in the order of `FIRST` and `SECOND`. Sums, products, quotients, powers by a plain number, abs
    and comparisons work as with arrays."""

    __array_ufunc__ = None  # so that array * HyperDual comes here

    def __init__(self, value, first, second):
        self.value, self.first, self.second = value, first, second

    @classmethod
    def variables(cls, *values: ArrayLike) -> "list[HyperDual]":
        """The three variables themselves, at values of one shape."""
        x = np.broadcast_arrays(*(np.asarray(v, float) for v in values))
        variables = []
        for k, value in enumerate(x):
            first = np.zeros((3, *value.shape))
            first[k] = 1
            variables.append(cls(value, first, np.zeros((6, *value.shape))))
        return variables

    def chain(self, f: Number, f1: Number, f2: Number) -> "HyperDual":
        """A function of this number, from its value and derivatives there."""
        d = self.first
        return HyperDual(f, f1 * d, f1 * self.second + f2 * (d[FIRST] * d[SECOND]))

    def __add__(self, other):
        if not isinstance(other, HyperDual):
            return HyperDual(self.value + other, self.first, self.second)
        return HyperDual(
            self.value + other.value, self.first + other.first, self.second + other.second
        )

    def __mul__(self, other):
        if not isinstance(other, HyperDual):
            return HyperDual(self.value * other, self.first * other, self.second * other)
        x, d, y, e = self.value, self.first, other.value, other.first
        crossed = d[FIRST] * e[SECOND] + d[SECOND] * e[FIRST]
        return HyperDual(x * y, d * y + e * x, self.second * y + other.second * x + crossed)

    def __pow__(self, n):
        x = self.value
        if n == 2:
            return self.chain(x * x, 2 * x, 2.0)
        second = n * (n - 1) * x ** (n - 2) if n != 1 else 0.0 * x
        return self.chain(x**n, n * x ** (n - 1), second)

    def __truediv__(self, other):
        return self * (other**-1.0 if isinstance(other, HyperDual) else 1 / other)

    def __rtruediv__(self, other):
        return self**-1.0 * other

    def __neg__(self):
        return self * -1.0

    def __sub__(self, other):
        return self + -other

    def __rsub__(self, other):
        return -self + other

    def __abs__(self):
        return self * np.where(self.value < 0, -1.0, 1.0)

    def __gt__(self, other):
        return self.value > getattr(other, "value", other)

    def __lt__(self, other):
        return self.value < getattr(other, "value", other)

    __radd__, __rmul__ = __add__, __mul__


exp = singledispatch(np.exp)
log = singledispatch(np.log)
sqrt = singledispatch(np.sqrt)
cos = singledispatch(np.cos)
sin = singledispatch(np.sin)
tan = singledispatch(np.tan)
atan = singledispatch(np.arctan)


@singledispatch
def where(condition: Number, x: Number, y: Number) -> Number:
    """`x` where the condition holds, such as `eps > 0`, and `y` elsewhere."""
    if not isinstance(x, HyperDual) and not isinstance(y, HyperDual):
        return np.where(condition, x, y)
    x, y = (v if isinstance(v, HyperDual) else HyperDual(v, 0.0, 0.0) for v in (x, y))
    pairs = (x.value, y.value), (x.first, y.first), (x.second, y.second)
    return HyperDual(*(np.where(condition, u, v) for u, v in pairs))


@singledispatch
def positive(x: Number) -> Number:
    """The part of a number above 0: x where x > 0, and 0 elsewhere."""
    return where(x > 0, x, 0.0)


@singledispatch
def negative(x: Number) -> Number:
    """The part of a number up to 0: x where x <= 0, and 0 elsewhere."""
    return where(x > 0, 0.0, x)


def curve_through(x: ArrayLike, y: ArrayLike, on: ArrayLike = (True, True)) -> tuple[Any, Any, Any]:
    """Integral from 0, value and slope of a monotone cubic (SciPy's PCHIP) through points (n,), as
    piecewise polynomials. Beyond either end the slope goes `on` unless it is below 0, else the
    value stays."""
    from scipy.interpolate import PchipInterpolator, PPoly  # take long to import

    inner, x, y = PchipInterpolator(x, y), np.asarray(x), np.asarray(y)
    low, high = np.where(on, np.maximum(inner.derivative()(x[[0, -1]]), 0), 0)
    c = np.column_stack([[0, 0, low, y[0] - low], inner.c, [0, 0, high, y[-1]]])
    value = PPoly(c, [x[0] - 1, *x, x[-1] + 1])
    integral = value.antiderivative()
    integral.c[-1] -= integral(0.0)
    return integral, value, value.derivative()


def _of_hyper_dual(function, slopes):
    """Let a function f take hyper-dual numbers; slopes: (x, f(x)) to its first two derivatives."""

    def chained(x):
        f = function(x.value)
        return x.chain(f, *slopes(x.value, f))

    function.register(HyperDual, chained)


_of_hyper_dual(exp, lambda x, f: (f, f))
_of_hyper_dual(log, lambda x, f: (1 / x, -1 / (x * x)))
_of_hyper_dual(sqrt, lambda x, f: (0.5 / f, -0.25 / (f * x)))
_of_hyper_dual(cos, lambda x, f: (-np.sin(x), -f))
_of_hyper_dual(sin, lambda x, f: (np.cos(x), -f))
_of_hyper_dual(tan, lambda x, f: (1 + f * f, 2 * f * (1 + f * f)))
_of_hyper_dual(atan, lambda x, f: (1 / (1 + x * x), -2 * x / (1 + x * x) ** 2))
