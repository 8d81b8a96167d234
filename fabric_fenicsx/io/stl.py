"""STL files as they are met: binary ones that begin with "solid" or end in further bytes, text with
capitals, tabs, decimal commas. No library reads all of these, and some lose triangles unsaid."""

import re
from pathlib import Path

import numpy as np

from .surface_mesh import SurfaceMesh


def read_stl(path: Path) -> SurfaceMesh:
    """The triangles of an STL file [mm]; corners at one place are one point. Raises ValueError with
    the reason for one that is cut off or no STL."""
    data = path.read_bytes()
    header, facet = 84, 50  # bytes; a facet is its normal, three corners and two bytes
    count = int.from_bytes(data[header - 4 : header], "little")
    if count and len(data) >= header + facet * count:
        more, rest = (len(data) - header) // facet - count, data[header + facet * count :]
        if more and any(rest):
            raise ValueError(f"it counts {count} triangles in its header and holds {count + more}")
        facets = np.frombuffer(data, np.dtype([("x", "<f4", (4, 3)), ("-", "<u2")]), count, header)
        corners = facets["x"][:, 1:].reshape(-1, 3).astype(float)
    else:
        corners = _text(data, f"it tells of {count} triangles and holds {len(data) - header} bytes")
    points, number = np.unique(corners, axis=0, return_inverse=True)
    return SurfaceMesh.collected(points, [("triangle", number.reshape(-1, 3))], {})


def _text(data, flaw):
    """Corners (3 n, 3) of facets in text; `flaw` if it is none, but binary."""
    facets = len(re.findall(rb"(?<!\S)facet\s+normal(?!\S)", data, re.IGNORECASE))
    if b"\0" in data and not facets:
        raise ValueError(f"{flaw} of them: cut off")
    vertex = rb"(?<!\S)vertex\s+(\S+)\s+(\S+)\s+(\S+)"
    vertices = re.findall(vertex, data, re.IGNORECASE)
    # letters in which a text ends
    if not facets or len(vertices) != 3 * facets or b"endsolid" not in data[-1000:].lower():
        raise ValueError(f"it has {len(vertices)} vertices in {facets} facets, or no `endsolid`")
    spelled = bytes.maketrans(b",dD", b".ee")  # decimal commas, exponents of Fortran
    return np.array([[word.translate(spelled) for word in each] for each in vertices], float)
