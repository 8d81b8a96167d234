"""Scripts that write a mesh to a file."""

import runpy
import sys
from pathlib import Path

import pytest
import pyvista

SCRIPTS = Path(__file__).parents[2] / "meshes"


@pytest.mark.parametrize(
    "words, area", [("specimen --length 30 --width 20", 600), ("outline ply.csv --size 10", 8000)]
)
def test_flat_meshes_fill_their_outlines(tmp_path, monkeypatch, words, area):
    monkeypatch.chdir(tmp_path)
    Path("ply.csv").write_text("x,y\n0,0\n100,0\n100,80\n0,80\n")
    words = [*words.split(), "--pattern", "along", "--fibre-angle", "30", "made.vtu"]
    monkeypatch.setattr(sys, "argv", words)
    runpy.run_path(str(SCRIPTS / f"{words[0]}.py"), run_name="__main__")
    assert pyvista.read("made.vtu").area == pytest.approx(area)
