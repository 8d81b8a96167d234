"""The functions in which laws are written, for NumPy, hyper-dual numbers and UFL alike.

`exp`, `log`, `sqrt`, `cos`, `sin`, `tan` and `atan` are those of mathematics. What they do with UFL
expressions is registered by `expression`.
"""

from functools import singledispatch
from typing import Any

import numpy as np

from .hyperdual import HyperDual

exp = singledispatch(np.exp)
log = singledispatch(np.log)
sqrt = singledispatch(np.sqrt)
cos = singledispatch(np.cos)
sin = singledispatch(np.sin)
tan = singledispatch(np.tan)
atan = singledispatch(np.arctan)


@singledispatch
def where(condition: Any, x: Any, y: Any) -> Any:
    """`x` where the condition holds, such as `eps > 0`, and `y` elsewhere."""
    if isinstance(x, HyperDual) or isinstance(y, HyperDual):
        return HyperDual.where(condition, x, y)
    return np.where(condition, x, y)


@singledispatch
def positive(x: Any) -> Any:
    """The part of a number above 0: x where x > 0, and 0 elsewhere."""
    return where(x > 0, x, 0.0)


@singledispatch
def negative(x: Any) -> Any:
    """The part of a number up to 0: x where x <= 0, and 0 elsewhere."""
    return where(x > 0, 0.0, x)


def _chain(function: Any, derivatives: Any) -> None:
    """Let a function of one argument take hyper-dual numbers; derivatives: x to f, f', f''."""
    function.register(HyperDual, lambda x: x.chain(*derivatives(x.value)))


def _exp(x):
    f = np.exp(x)
    return f, f, f


def _sqrt(x):
    f = np.sqrt(x)
    return f, 0.5 / f, -0.25 / (f * x)


def _tan(x):
    f = np.tan(x)
    return f, 1 + f * f, 2 * f * (1 + f * f)


_chain(exp, _exp)
_chain(sqrt, _sqrt)
_chain(tan, _tan)
_chain(log, lambda x: (np.log(x), 1 / x, -1 / (x * x)))
_chain(cos, lambda x: (np.cos(x), -np.sin(x), -np.cos(x)))
_chain(sin, lambda x: (np.sin(x), np.cos(x), -np.sin(x)))
_chain(atan, lambda x: (np.arctan(x), 1 / (1 + x * x), -2 * x / (1 + x * x) ** 2))
