"""The verdict on a result, and its reasons."""

from typing import Any, NamedTuple, TypeAlias

Numbers: TypeAlias = dict[str, Any]  # as summary.json nests them
VERDICTS = OK, DOUBTFUL, INVALID = "ok", "doubtful", "invalid"  # from the best to the worst


class Reason(NamedTuple):
    """Why a result is doubtful or invalid, or what an ok one does not say. of: of a doubt, which
    quantities it is about: a part of their names; "" if it is about all. What to change is the last
    clause of a text, after a semicolon."""

    text: str
    of: str = ""
    verdict: str = DOUBTFUL


def in_a_line(summary: Numbers) -> str:
    """The verdict of a summary, and of one that is not ok what to change."""
    texts = [each["text"] for each in summary["reasons"] if each["verdict"] != OK]
    changes = dict.fromkeys(text.rpartition("; ")[2] for text in texts)
    return "; ".join([f"verdict: {summary['verdict']}", *changes])
