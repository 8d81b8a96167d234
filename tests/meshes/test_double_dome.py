"""The triangles of the double dome."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from double_dome import double_dome, write_step

from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.tools.checks import check_triangles
from fabric_fenicsx.tools.double_dome import DoubleDome
from fabric_fenicsx.tools.triangulated import TriangulatedSurface

SCRIPT = Path(__file__).parents[2] / "meshes" / "double_dome.py"
COARSE = ["--size", "20", "--turn", "40", "--quarter"]


@pytest.mark.parametrize(
    "dome", [DoubleDome(), DoubleDome(wall_angle=0, top_radius=30, saddle_depth=0)]
)
def test_full_is_four_quarters(dome):
    quarter, part = double_dome(dome, size=15, turn=15, quarter=True)
    points, triangles = double_dome(dome, size=15, turn=15)
    assert len(triangles) == 4 * len(part)
    assert abs(dome.evaluate(points).gap).max() <= 1e-10
    assert quarter.min() == 0 and np.allclose(np.ptp(points, 0), [520, 320, 60], rtol=0, atol=1e-9)
    edges = np.sort(np.stack([triangles, np.roll(triangles, -1, 1)], 2).reshape(-1, 2), 1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    rim = edges[count == 1]
    assert count.max() == 2 and len(points) - len(edges) + len(triangles) == 1  # one disk
    assert np.maximum(abs(points[rim, 0]) - 260, abs(points[rim, 1]) - 160) == pytest.approx(
        0, abs=1e-9
    )
    corners = points[triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", area, dome.evaluate(corners.mean(1)).normal) > 0).all()
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    assert length.max() < 2 * 15
    # no triangle is thin, nor turns much more than asked
    quality = (
        np.linalg.norm(area, axis=1)
        / (np.roll(corners, 1, 1) - corners).__pow__(2).sum((1, 2))
        * 2
        * np.sqrt(3)
    )
    assert np.quantile(quality, 0.01) > 0.5
    normals = dome.evaluate(points).normal
    turn = np.degrees(
        np.arccos(np.clip((normals[edges[:, 0]] * normals[edges[:, 1]]).sum(1), -1, 1))
    )
    assert np.quantile(turn, 0.99) < 1.5 * 15


@pytest.mark.parametrize(
    "options, words",
    [
        ({"size": 0}, "size is 0; allowed is above 0"),
        ({"turn": 45}, "turn is 45; allowed is above 0 and below 45"),
        ({"length": float("nan")}, "length is nan"),
        ({"length": 440}, "length is 440; allowed is above 459"),
        ({"width": 150}, "width is 150; allowed is above 155"),
    ],
)
def test_bad_dimensions(options, words):
    with pytest.raises(InputError, match=words):
        double_dome(**options)


@pytest.mark.parametrize(
    "dome, close",
    [
        (DoubleDome(), 1e-4),
        (DoubleDome(wall_angle=0, top_radius=30, waist=65, saddle_length=250), 1e-3),
    ],
)
def test_a_step_file_is_the_dome(dome, close, tmp_path):
    write_step(tmp_path / "DOME.STP", dome)  # which not every program knows as STEP
    (tmp_path / "DOME.STP").rename(tmp_path / "dome.step")
    warnings = []
    surface = TriangulatedSurface.read(tmp_path / "dome.step")
    check_triangles(surface, "dome.step", 1.0, warnings.append)
    assert not warnings and len(surface.rim) == len(surface.forks) == 0  # closed
    # corners of triangles lie on the file's faces and have their normals
    x = surface.points
    above = (x[:, 2] > -1e-3) & (abs(x[:, 0]) < 259) & (abs(x[:, 1]) < 159)
    right = dome.evaluate(x[above])
    assert abs(right.gap).max() < close and x[above, 2].max() == pytest.approx(60, abs=close)
    assert (right.normal * surface.normals[above]).sum(1).min() > np.cos(np.radians(0.02))
    # where the middle of a ply is, also between the corners
    u, v = np.random.default_rng(0).uniform(-1, 1, (2, 3000)) * [[235], [135]]
    x = dome.lift(u, v)
    x += 0.5 * dome.evaluate(x).normal
    found, right = surface.evaluate(x), dome.evaluate(x)
    assert abs(found.gap - right.gap).max() < 0.01
    assert (right.normal * found.normal).sum(1).min() > np.cos(np.radians(0.5))


def test_by_itself(tmp_path, hang):
    command = [sys.executable, SCRIPT, "--size", "20", "--turn", "20", "--quarter", "--depth", "50"]
    done = subprocess.run(
        [*command, "--out", tmp_path / "tool.vtp"], capture_output=True, text=True, timeout=hang
    )
    assert done.returncode == 0, done.stderr
    assert "triangles" in done.stdout
    assert TriangulatedSurface.read(tmp_path / "tool.vtp").points[:, 2].max() == pytest.approx(50)


@pytest.mark.parametrize(
    "options, words",
    [
        ([*COARSE, "--depth", "0"], "depth is 0.0; allowed is a number above 0"),
        (["--out", "none/tool.step"], "none/tool.step cannot be written"),
        (["--out", "tool.step", "--width", "150"], "width is 150; allowed is above 155"),
        (["--out", "tool.step", "--size", "20"], "--size cannot be used for tool.step, a solid"),
        (["--out", "tool.STP", "--turn", "10"], "--turn cannot be used for tool.STP, a solid"),
        (["--out", "tool.step", "--quarter"], "without triangles; allowed is a file like tool.stl"),
        ([*COARSE, "--out", "tool.step"], "--size, --turn, --quarter cannot be used for tool.step"),
        ([*COARSE, "--out", "none/tool.stl"], "none/tool.stl cannot be written"),
        ([*COARSE, "--out", "tool.abc"], "tool.abc cannot be written"),
        ([*COARSE, "--out", "none/tool.msh"], "none/tool.msh cannot be written"),
    ],
)
def test_mistakes_end_with_one_sentence(options, words, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["double_dome.py", *options])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    assert end.value.code == 2 and words in capsys.readouterr().err
