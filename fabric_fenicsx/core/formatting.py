"""Numbers in sentences: few digits, and no exponent where none is needed."""

import math
from collections.abc import Collection, Iterable
from decimal import Decimal

TINY = 1e-300  # instead of 0 below a line


def rounded(number: float, digits: int = 3) -> str:
    """A number with so many significant digits: 1230 for 1.23e+03; 2e6 from 1e6 on, 2e-5 below
    1e-4."""
    text = f"{float(number) + 0.0:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    return f"{Decimal(text):f}" if 0 < int(exponent) < 6 else f"{mantissa}e{int(exponent)}"


def share(part: float, whole: float) -> float:
    """A part over the size of a whole that may be 0: 0 of nothing is 0, all else is immense."""
    return part / max(abs(whole), TINY)


def with_error(text: str, number: float, error: float | None, digits: int = 2) -> str:
    """The text of a number, with its error behind it: 2033.42 +- 0.29; +- 0 if that is rounding,
    and +- unknown for None."""
    if error is None:
        return f"{text} +- unknown"
    exact = abs(error) <= 1e-12 * max(1.0, abs(number))
    return f"{text} +- {rounded(0.0 if exact else error, digits)}"


def percent(share: float, digits: int = 2) -> str:
    """A share as 12 %, or as more than 1000 %."""
    if 10 < share < math.inf:
        return "more than 1000 %"
    return f"{rounded(100 * share, digits)} %"


def of_sheet(point: Collection[float]) -> str:
    """A place of an undeformed sheet: x and y if that is flat, otherwise also z [mm]."""
    return f"{coordinates(point)} mm of the {'flat' if len(point) == 2 else 'undeformed'} sheet"


def coordinates(point: Iterable[float]) -> str:
    """Coordinates as (1, 2, 3), without rounding's -0."""
    return f"({', '.join(rounded(round(float(each), 9), 4) for each in point)})"
