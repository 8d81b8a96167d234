"""The verdict on a result, and its reasons."""

from typing import Any, NamedTuple, TypeAlias

Numbers: TypeAlias = dict[str, Any]  # as summary.json nests them
OK, DOUBTFUL, INVALID = "ok", "doubtful", "invalid"


class Reason(NamedTuple):
    """Why a result is doubtful or invalid. of: of a doubt, which quantities it is about: a part of
    their names; "" if it is about all."""

    text: str
    of: str = ""
    verdict: str = DOUBTFUL
