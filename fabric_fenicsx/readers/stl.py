"""STL files as they are met: binary ones that begin with "solid" or end in further bytes, text with
capitals, tabs, decimal commas. No library reads all of these, and some lose triangles unsaid."""

import re
from pathlib import Path

import numpy as np

from ..runtime.errors import InputError
from .surface_mesh import SurfaceMesh

HEADER, FACET = 84, 50  # bytes
FACETS = re.compile(r"(?<!\S)facet\s+normal(?!\S)", re.IGNORECASE)
VERTICES = re.compile(r"(?<!\S)vertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def read_stl(path: Path) -> SurfaceMesh:
    """The triangles of an STL file [mm]; corners at one place are one point. Raises InputError,
    without the file's name, for one that is cut off or no STL, ValueError for what is no number."""
    data = path.read_bytes()
    count = int.from_bytes(data[HEADER - 4 : HEADER], "little")
    if count and len(data) >= HEADER + FACET * count:
        more, rest = (len(data) - HEADER) // FACET - count, data[HEADER + FACET * count :]
        if more and any(rest):
            raise InputError(
                f"counts {count} triangles in its header and holds {count + more}; allowed is the "
                "same number: save it again"
            )
        # a facet is its normal, three corners and two bytes
        facets = np.frombuffer(data, np.dtype([("x", "<f4", (4, 3)), ("-", "<u2")]), count, HEADER)
        corners = facets["x"][:, 1:].reshape(-1, 3).astype(float)
    elif FACETS.search(text := data.decode("latin-1")):
        corners = _text(text)
    elif b"\0" in data:
        raise InputError(
            f"tells of {count} triangles and holds {max(0, len(data) - HEADER)} "
            f"bytes of them; allowed are {FACET} bytes a triangle: it may be cut off"
        )
    else:
        raise InputError("cannot be read as .stl (it has no facets); allowed is an STL file")
    points, number = np.unique(corners, axis=0, return_inverse=True)
    return SurfaceMesh.collected(points, [("triangle", number.reshape(-1, 3))], {})


def _text(text):
    facets, vertices = len(FACETS.findall(text)), VERTICES.findall(text)
    # letters in which a text ends
    if len(vertices) != 3 * facets or "endsolid" not in text[-1000:].lower():
        raise InputError(
            f"has {len(vertices)} vertices in {facets} facets; allowed are three "
            "in each, and `endsolid` at the end: it may be cut off"
        )
    spelled = str.maketrans(",dD", ".ee")  # decimal commas, exponents of Fortran
    return np.array([[word.translate(spelled) for word in each] for each in vertices], float)
