"""Pictures of formed plies."""

import matplotlib.image
import numpy as np
import pytest
import pyvista
from dome_triangles import double_dome
from formed_plies import formed, on_dome
from matplotlib.figure import Figure

from fabric_fenicsx.results import forming_pictures, space
from fabric_fenicsx.results.shape import Path


def test_pictures_of_a_formed_ply(tmp_path, capfd, monkeypatch):
    grid = formed(on_dome, angle=np.radians(45), ranks=2)
    grid["shear_angle"][7] = -0.9
    files = [tmp_path / f"{name}.png" for name in ("states", "formed")]
    drawn, save = [], Figure.savefig
    noted = lambda figure, *given, **more: drawn.append(figure) or save(figure, *given, **more)  # noqa: E731
    monkeypatch.setattr(Figure, "savefig", noted)
    forming_pictures.state_map(files[0], grid, formed=True)
    tool = pyvista.PolyData.from_regular_faces(*double_dome())
    space.formed_picture(files[1], [grid], tool)
    images = [matplotlib.image.imread(file)[..., :3] for file in files]
    assert min(image.std() for image in images) > 0.05 and images[1].shape[:2] == (1000, 1600)
    assert "largest of a cell: 51.57)" in drawn[1].axes[1].get_xlabel()
    assert capfd.readouterr().err == ""


def test_paths_are_drawn_in_per_cent_and_degrees_with_marks_that_lie_on_them(tmp_path, monkeypatch):
    figures = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: figures.append(figure.axes))
    distance = np.array([0.0, 10, 20])
    path = Path(distance, 2 * distance, 0.01 * distance, -0.001 * distance, distance / 2, None)
    marks = {"edge": [15.0, 25.0], "none": [np.nan, np.nan]}
    forming_pictures.paths_picture(tmp_path / "p.png", {"run": {0: path, 90: path}}, marks)
    for axes, mark in ((figures[0][:3], [15.0]), (figures[0][3:], [])):
        for ax, values in zip(axes, ([0, 10, 20], [0, -1, -2], [0, 5, 10])):
            drawn, *vertical, zero = ax.lines
            assert list(drawn.get_xdata()) == [0, 10, 20]
            assert list(drawn.get_ydata()) == pytest.approx(values)
            assert [line.get_xdata()[0] for line in vertical] == mark
