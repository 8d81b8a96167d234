"""Errors that end a run."""

from typing import Any

NOT_VALID = "the result is not valid: "  # beginning of the reason of such a run


class InputError(ValueError):
    """A mistake in what a user gave: a value, a file, or how parts go together.

    The message says what is wrong, where, and what is allowed.

    Examples
    --------
    >>> ff.Limits(viscous=-1)
    Traceback (most recent call last):
        ...
    fabric_fenicsx.core.errors.InputError: `Limits.viscous` is -1; expected a number above 0
    """


class SolverFailure(RuntimeError):
    """No converged or no credible state at the asked load: the reason, and as `result` what a job
    had reached by then, a `Result`; None outside of jobs.

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
    """A run was asked to stop, as by Ctrl-C; the message says how to resume it.

    Examples
    --------
    >>> issubclass(ff.Interrupted, ff.SolverFailure)
    False
    """
