"""What libraries do not look at in files of text: the end, systems of coordinates."""

import re
from pathlib import Path

from ..runtime.errors import InputError
from ..runtime.files import ending

NASTRAN = (".bdf", ".nas", ".dat", ".fem")
# how whole files end, which libraries read without a word where they are cut off
ENDS = {
    (".step", ".stp"): rb"END-ISO-10303-21\s*;",
    (".iges", ".igs"): rb"T *\d+\s*$",
    (".brep",): rb"\n[+-]\d+ \d+\s*$",
    (".mesh",): rb"\bEnd\s*$",
    (".unv",): rb"\n *-1\s*$",
    (".obj",): rb"\n$",
    NASTRAN: rb"\n$|ENDDATA\s*$",
}


def check_end(path: Path, what: str) -> None:
    """InputError for a file that ends before its format does; `what` it is, in words."""
    ends = next((end for endings, end in ENDS.items() if ending(path) in endings), b"")
    # bytes in which an end is looked for
    if not re.search(ends, path.read_bytes()[-1000:], re.IGNORECASE):
        raise InputError(
            f"{what} {path} does not end as {path.suffix} files do: it is cut off, or of another "
            "format; allowed is a whole file"
        )


def check_coordinate_systems(path: Path, what: str) -> None:
    """InputError for nodes of a Nastran deck in a coordinate system of their own, as the libraries
    take all places for basic ones."""
    with open(path, encoding="latin-1") as file:
        for line in file:
            fields = line.split(",")
            if len(fields) == 1:  # of 8 columns, or of 16
                card, wide = line.expandtabs(8), 16 if "*" in line[:8] else 8
                fields = [card[:8], card[8 : 8 + wide], card[8 + wide : 8 + 2 * wide]]
            word, _, system = (each.strip() for each in [*fields, "", ""][:3])
            if word.rstrip(" *").upper() == "GRID" and system.isdecimal() and int(system):
                raise InputError(
                    f"{what} {path} has a GRID in coordinate system {system} "
                    f"({' '.join(line.split())}); allowed are basic ones, 0 or none"
                )
