"""A warning of a mesh whose size may be in another unit."""

from ...runtime.formatting import rounded
from ...sheets.blank import Blank


def size_warning(blank: Blank, source: str) -> str:
    """A sentence if the sheet's size may be in another unit than mm, else ""."""
    low, high = blank.extent()
    if 20 <= (high - low).max() <= 10_000:  # a few yarns, more than looms weave
        return ""
    sides = " x ".join(rounded(side, 4) for side in high - low)
    return f"{source} is {sides} mm; lengths are in mm (metres times 1000, inches times 25.4)"
