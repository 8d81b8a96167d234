"""What libraries do not look at in files of text: the end, the unit, systems of coordinates."""

import math
import re
from pathlib import Path

import numpy as np

from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from .surface_mesh import SurfaceMesh

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
TAIL = 1000  # bytes in which an end is looked for
LARGEST = 1e4  # mm, above which a file's unit is not believed: some programs write metres always


def check_end(path: Path, what: str) -> None:
    """InputError for a file that ends before its format does; `what` it is, in words."""
    ends = next((end for endings, end in ENDS.items() if path.suffix.lower() in endings), b"")
    if not re.search(ends, path.read_bytes()[-TAIL:], re.IGNORECASE):
        raise InputError(
            f"{what} {path} does not end as {path.suffix} files do: it is cut off, or of another "
            "format; allowed is a whole file"
        )


def check_coordinate_systems(path: Path) -> None:
    """InputError for nodes of a Nastran deck in a coordinate system of their own, or of GRDSET, as
    the libraries take all places for basic ones."""
    with open(path, encoding="latin-1") as file:
        for line in file:
            fields = line.split(",")
            if len(fields) == 1:  # of 8 columns, or of 16
                card, wide = line.expandtabs(8), 16 if "*" in line[:8] else 8
                fields = [card[:8], card[8 : 8 + wide], card[8 + wide : 8 + 2 * wide]]
            word, _, system = (each.strip() for each in [*fields, "", ""][:3])
            name = word.rstrip(" *").upper()
            if name in ("GRID", "GRDSET") and system.isdecimal() and int(system):
                raise InputError(
                    f"mesh file {path} has a {name} in coordinate system {system} "
                    f"({' '.join(line.split())}); allowed are basic ones, 0 or none"
                )


def in_mm(mesh: SurfaceMesh, path: Path, what: str) -> SurfaceMesh:
    """A mesh of a file with lengths in mm and a note on its unit, if it is a universal file with
    another unit (dataset 164). InputError for one that makes it larger than any sheet or tool."""
    text = path.read_text("latin-1") if path.suffix.lower() == ".unv" else ""
    unit = re.search(r"^ *-1\s*\n *164\s*\n.{10}(.{20}).*\n *(\S+)", text, re.MULTILINE)
    if not unit:
        return mesh
    factor = 1000 / float(re.sub("[dD]", "e", unit[2]))
    if math.isclose(factor, 1, rel_tol=1e-6):
        return mesh
    points = factor * mesh.points
    size, name = rounded(np.ptp(points, axis=0).max(), 4), f"{unit[1].strip()} (dataset 164)"
    if np.ptp(points, axis=0).max() > LARGEST:
        raise InputError(
            f"{what} {path} is in the unit {name}, and so {size} mm large; allowed is the unit "
            "that it is in, or a file without dataset 164 in mm"
        )
    note = f"{what} {path} is in the unit {name}, so it is {size} mm large"
    return mesh._replace(points=points, note=note)
