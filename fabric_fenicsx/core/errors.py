"""Errors that end a run."""

from typing import Any

NOT_VALID = "the result is not valid: "  # beginning of the reason of such a run


class InputError(ValueError):
    """An error in the input: a value, a file, or a combination of parts.

    The message says what is wrong, where, and what was expected.

    Examples
    --------
    >>> ff.Limits(viscous=-1)
    Traceback (most recent call last):
        ...
    fabric_fenicsx.core.errors.InputError: `Limits.viscous` is -1; expected a number above 0
    """


class SolverFailure(RuntimeError):
    """The requested load was not reached with a valid state. The message is the reason; `result`
    is the `Result` up to there, None outside of jobs.

    Examples
    --------
    >>> try:
    ...     raise ff.SolverFailure("gave up at load factor 0.8")
    ... except ff.SolverFailure as failure:
    ...     print(failure, failure.result, sep="; ")
    gave up at load factor 0.8; None
    """

    def __init__(self, reason: str, result: Any = None) -> None:
        super().__init__(reason)
        self.result = result


class Interrupted(Exception):
    """A run was interrupted, e.g. by Ctrl-C; the message says how to resume it.

    Examples
    --------
    >>> issubclass(ff.Interrupted, ff.SolverFailure)
    False
    """
