"""STL files as CAD programs write them."""

import struct

import numpy as np
import pytest

from fabric_fenicsx.io.read import read_stl

CORNERS = np.array([[[0, 0, 0], [2, 0, 0], [2, 1.5, 0]], [[0, 0, 0], [2, 1.5, 0], [0, 1, -0.5]]])


def text(number="{:e}"):
    lines = ["solid plate"]
    for corners in CORNERS:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += [" ".join(["vertex", *map(number.format, x)]) for x in corners]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid plate", ""])


def binary(header=b"", count=2, end=b""):
    facets = [struct.pack("<12fH", 0, 0, 1, *corners.ravel(), 0) for corners in CORNERS]
    return header.ljust(80) + struct.pack("<I", count) + b"".join(facets) + end


# what the net's drawn files have not: tests/invariance/test_readers.py
FILES = {
    "decimal commas": text("{:.3f}").replace(".", ",").encode(),
    "exponents of Fortran": text().replace("e+", "D+").replace("e-", "D-").encode(),
    "a name in Latin 1": text().replace("plate", "Größe").encode("latin-1"),
    "a mark of Unicode": text().encode("utf-8-sig"),
    "a byte behind": binary(end=b"\n"),
    "bytes behind": binary(b"solid", end=bytes(100)),
}


@pytest.mark.parametrize("case", FILES)
def test_stl_with(tmp_path, case):
    (tmp_path / "plate.stl").write_bytes(FILES[case])
    mesh = read_stl(tmp_path / "plate.stl")
    x = mesh.points[mesh.cells["triangle"][:2]]
    np.testing.assert_allclose(x, CORNERS, atol=1e-7)
    assert len(mesh.points) == 4


def test_stl_that_is_cut_off_or_wrong(tmp_path):
    for content, words in (
        (text()[:-60].encode(), "has 5 vertices in 2 facets"),
        (binary(count=3), "tells of 3 triangles and holds 100 bytes of them"),
    ):
        (tmp_path / "plate.stl").write_bytes(content)
        with pytest.raises(ValueError, match=words):
            read_stl(tmp_path / "plate.stl")
