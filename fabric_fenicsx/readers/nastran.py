"""A check of Nastran's decks that the libraries leave out: nodes in other coordinate systems."""

from pathlib import Path

from ..runtime.errors import InputError

ENDINGS = (".bdf", ".nas", ".dat", ".fem")


def check_coordinate_systems(path: Path) -> None:
    """Raise InputError for a GRID of a Nastran deck whose place is in a coordinate system of its
    own, as the readers take all places for basic ones."""
    with open(path, encoding="latin-1") as file:
        for line in file:
            card = line[:8].upper()
            if not card.startswith("GRID") or not (system := _system(line)):
                continue
            if system.isdecimal() and int(system):
                raise InputError(
                    f"mesh file {path} has a GRID in coordinate system {system} "
                    f"({' '.join(line.split())}); allowed are basic ones, 0 or none"
                )


def _system(line):
    """The third field of a card in free, large or small fields."""
    if "," in line:
        return (line.split(",") + ["", ""])[2].strip()
    line = line.expandtabs(8)
    return line[24:40].strip() if line[:8].rstrip().endswith("*") else line[16:24].strip()
