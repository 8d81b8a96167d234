"""Pictures of formed plies."""

import csv

import matplotlib.image
import numpy as np
import pytest
import pyvista
from dome_triangles import double_dome
from formed_plies import SHEARED, formed, on_dome

from fabric_fenicsx.plot import forming_pictures, pictures, space
from fabric_fenicsx.postprocess import shape


def is_picture(path, pixels=None):
    image = matplotlib.image.imread(path)
    return image[..., :3].std() > 0.05 and (pixels is None or image.shape[1::-1] == pixels)


def test_axes_of_paths_end_with_the_ply(tmp_path, monkeypatch):
    drawn, paths = [], shape.along_paths(formed(SHEARED))
    monkeypatch.setattr(pictures.plt, "close", drawn.append)
    forming_pictures.paths_picture(
        tmp_path / "p.png", {"one": paths}, {"tool": (217, 90, 300), "other": 140}
    )
    (figure,) = (each for each in drawn if each != "all")  # which a first figure may close
    ends = [235, 135 * np.sqrt(2), 135]
    for ax, end in zip(figure.axes[::3], ends):
        assert ax.get_xlim() == pytest.approx((0, end), abs=1e-6)
    lines = [len(ax.get_lines()) for ax in figure.axes[::3]]
    assert lines == [4, 4, 2]  # the curve, 0 and what marks lie on the ply
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {"one", "tool", "other"}
    shape.write_paths(tmp_path / "paths.csv", paths)
    with open(tmp_path / "paths.csv", newline="") as file:
        at = [row for row in csv.DictReader(file) if row["path_deg"] == "45"][20]
    assert float(at["distance_mm"]) == 100
    assert float(at["shear_angle_deg"]) == pytest.approx(paths[45].shear_angle[20], rel=1e-6)


def test_plies_at_plus_and_minus_45_have_files_of_their_own(tmp_path):
    """And one of shortening, as there is some."""
    grids = {name: formed(on_dome) for name in ("+45", "-45")}
    for grid in grids.values():
        for yarns in "ab":
            grid.cell_data[f"shortening_{yarns}"] = np.full(grid.n_cells, 0.1)
    forming_pictures.draw_plies(tmp_path, grids)
    files = [f"{name}_{label}" for name in ("paths", "states") for label in ("p45", "m45")]
    files += ["formed", "shortening"]
    assert sorted(file.stem for file in tmp_path.iterdir()) == sorted(files)


def test_pictures_of_a_formed_ply(tmp_path, capfd):
    tool = pyvista.PolyData.from_regular_faces(*double_dome())
    grid = formed(on_dome, angle=np.radians(45), ranks=2)
    forming_pictures.outline_picture(tmp_path / "outline.png", {"": grid})
    forming_pictures.state_map(tmp_path / "states.png", grid, formed=True)
    assert is_picture(tmp_path / "outline.png") and is_picture(tmp_path / "states.png")
    for with_tool in (tool, None):
        path = tmp_path / "formed.png"
        space.formed_picture(path, [grid], with_tool)
        assert is_picture(path, (1600, 1000))
    assert capfd.readouterr().err == ""
