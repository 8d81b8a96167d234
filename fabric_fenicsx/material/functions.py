"""The functions in which laws are written, for NumPy, hyper-dual numbers and UFL alike.

`exp`, `log`, `sqrt`, `cos`, `sin`, `tan` and `atan` are those of mathematics. What they do with UFL
expressions is registered by `expression`.
"""

from functools import singledispatch

import numpy as np

from .hyperdual import HyperDual, Number

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
