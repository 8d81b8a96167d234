"""Meshes in Abaqus' input files, which CalculiX shares: nodes and elements as lists, in parts and
their instances. meshio reads few types of elements and the last block of nodes alone."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy


@dataclass
class _Part:
    nodes: dict[int, list[float]] = field(default_factory=dict)
    blocks: list[tuple[int, np.ndarray]] = field(default_factory=list)
    others: dict[str, int] = field(default_factory=dict)


def read_abaqus(path: Path) -> tuple[np.ndarray, list[tuple[int, np.ndarray]], dict[str, int]]:
    """Points (n, 3) [mm] of an Abaqus input file, instances where the assembly has them; numbers of
    corners and nodes (m, k) of its surface elements in blocks; and {kind: dimension} of others.
    Raises ValueError and OSError with the reason."""
    parts: dict[str, _Part] = {"": _Part()}
    placed: list[tuple[_Part, list[np.ndarray]]] = []
    part = own = parts[""]
    for keyword, options, rows in _blocks(path):
        if keyword in ("ELCOPY", "ELGEN", "NCOPY", "NFILL", "NGEN", "NMAP", "SYSTEM"):
            raise ValueError(f"it uses *{keyword}, not nodes and elements as lists")
        if keyword in ("PART", "INSTANCE"):
            part = parts.setdefault(options.get("NAME", "").upper(), _Part())
            if keyword == "INSTANCE":
                part = parts.setdefault(options.get("PART", "").upper(), part)
                placed.append((part, [_numbers([row], _length) for row in rows]))
        elif keyword in ("END PART", "END INSTANCE"):
            part = own
        elif keyword == "NODE":
            if (system := options.get("SYSTEM", "R")).upper() != "R":
                raise ValueError(f"it has *NODE, SYSTEM={system}, not rectangular coordinates")
            for row in rows:
                number, *place = _numbers([row], _length)
                part.nodes[int(number)] = [*place[:3], 0.0, 0.0, 0.0][:3]
        elif keyword == "ELEMENT":
            _add_elements(part, options.get("TYPE", "").upper(), rows)
    if part is not own:
        raise ValueError("it has a part or instance without *END")
    if not placed:
        placed = [(each, []) for each in parts.values() if each is not own]
    return _assembled([(own, []), *placed])


def _blocks(path: Path) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    """Keyword, options and rows of data of each block, also of files that are included."""
    lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    lines = [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("**")]
    heads = [i for i, line in enumerate(lines) if line.startswith("*")]
    for head, following in zip(heads, [*heads[1:], len(lines)]):
        start, text = head + 1, lines[head]
        while text.endswith(",") and start < following:  # the options go on
            text, start = text + lines[start], start + 1
        keyword, *words = (word.strip() for word in text[1:].split(","))
        pairs = (word.partition("=") for word in words)
        options = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
        keyword, rows = " ".join(keyword.upper().split()), lines[start:following]
        file = path.parent / options.get("INPUT", "")
        if keyword == "INCLUDE" and "INPUT" in options:
            yield from _blocks(file)
            continue
        if keyword in ("NODE", "ELEMENT") and file.is_file():
            rows = file.read_text("utf-8-sig", "replace").splitlines()
        yield keyword, options, rows


def _numbers(rows, of):
    return np.array([of(word.strip()) for row in rows for word in row.rstrip(" ,").split(",")])


def _length(word):
    """A number, 0 if it is left out; Fortran has exponents with D."""
    return float(re.sub("[dD]", "e", word)) if word else 0.0


def _add_elements(part, of, rows):
    # membranes, shells, rigid and surface elements, plane ones; then the number of nodes
    surface = r"(?:M3D|S|STRI|DS|R3D|SFM3D|CPS|CPE|CPEG|DC2D|AC2D|F3D)([34689])[A-Z0-9]*"
    if not (known := re.fullmatch(surface, of)):
        part.others[of] = 3 if re.match(r"(?:C3D|SC|CSS|DC3D|AC3D|CCL)\d", of) else 1
        return
    nodes = int(known[1])
    cells = _numbers(rows, int).reshape(-1, nodes + 1)[:, 1:]  # behind the element's own number
    part.blocks.append((3 if nodes in (3, 6) else 4, cells))


def _assembled(placed):
    """The mesh of parts where the rows of their instances have them: shifted, by zeros where
    numbers are left out, and turned about an axis of two points by an angle [deg]."""
    points, blocks, others, start = [], [], dict[str, int](), 0
    for part, rows in placed:
        own, order = np.array(list(part.nodes), dtype=np.int64), np.argsort(list(part.nodes))
        for corners, cells in part.blocks:
            if (lost := np.setdiff1d(cells, own)).size:
                raise ValueError(f"it lacks node {lost[0]} of an element")
            at = order[np.searchsorted(own, cells, sorter=order)]
            blocks.append((corners, at + start))
        x = np.array(list(part.nodes.values())).reshape(-1, 3)
        x = x + [*(rows[0] if rows else ()), 0, 0, 0][:3]
        for row in rows[1:]:
            foot, axis = row[:3], row[3:6] - row[:3]
            vector = np.radians(row[6]) * axis / np.linalg.norm(axis)
            turn = scipy.spatial.transform.Rotation.from_rotvec(vector)
            x = turn.apply(x - foot) + foot
        points.append(x)
        others |= part.others
        start += len(own)
    return np.vstack(points), blocks, others
