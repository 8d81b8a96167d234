"""Scripts that write a mesh to a file."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import pyvista

from fabric_fenicsx.tools.double_dome import DoubleDome

SCRIPTS = Path(__file__).parents[2] / "meshes"
YARNS = "--pattern", "along", "--fibre-angle", "30"


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Function of a script and its options, the last the file, to the mesh that it writes."""

    def make(script, *words):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [script, *words])
        runpy.run_path(str(SCRIPTS / f"{script}.py"), run_name="__main__")
        return pyvista.read(words[-1])

    return make


def test_flat_meshes_fill_their_outlines(written, tmp_path):
    (tmp_path / "ply.csv").write_text("x,y\n0,0\n100,0\n100,80\n0,80\n")
    specimen = written("specimen", "--length", "30", "--width", "20", *YARNS, "blank.vtu")
    outline = written("outline", "ply.csv", "--size", "10", *YARNS, "ply.vtu")
    assert [mesh.area for mesh in (specimen, outline)] == pytest.approx([600, 8000])


def test_triangles_lie_on_the_dome(written):
    x = np.array(written("double_dome", "dome.stl").points, float)
    assert abs(DoubleDome().evaluate(x).gap).max() < 1e-4  # STL is of single precision
    assert np.ptp(x[:, 2]) == pytest.approx(60)
