"""The ways in which a run ends without a result."""


class InputError(ValueError):
    """A user's mistake; the message is one sentence: what is wrong, where, and what is allowed."""


class SolverFailure(RuntimeError):
    """The solver gave up; the message is the reason in words."""


class Interrupted(Exception):
    """A run was asked to end before its time; its message says how to go on."""
