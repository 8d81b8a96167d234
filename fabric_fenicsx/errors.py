"""The two ways in which a run ends without a result."""


class InputError(ValueError):
    """A user's mistake; the message is one sentence: what is wrong, where, and what is allowed."""


class SolverFailure(RuntimeError):
    """The solver gave up; the message is the reason in words."""
