"""The verdict on a result, and its reasons."""

from typing import Any, NamedTuple, TypeAlias

Numbers: TypeAlias = dict[str, Any]  # as summary.json nests them
VERDICTS = OK, DOUBTFUL, INVALID = "ok", "doubtful", "invalid"  # from the best to the worst


class Reason(NamedTuple):
    """Why a result is doubtful or invalid, or what an ok one does not say; its last clause, after a
    semicolon, says what to change. of: of a doubt, a part of the names of the quantities that it is
    about; "" if it is about all."""

    text: str
    of: str = ""
    verdict: str = DOUBTFUL
