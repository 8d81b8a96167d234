"""The ways in which a run ends without a result."""

from typing import Any


class InputError(ValueError):
    """A user's mistake; the message is one sentence: what is wrong, where, and what is allowed."""


NOT_BELIEVED = "the result is not to be believed: "  # how the reason of such a run begins


class SolverFailure(RuntimeError):
    """The solver gave up; the message is the reason in words.

    result: of a job, what it had reached by then (`job.Result`), otherwise None.
    """

    def __init__(self, reason: str, result: Any = None) -> None:
        super().__init__(reason)
        self.result = result


class Interrupted(Exception):
    """A run was asked to end before its time; its message says how to go on."""
