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


def test_what_is_drawn_of_one_ply_is_named(tmp_path, monkeypatch):
    drawn, grid = [], formed(SHEARED)
    monkeypatch.setattr(pictures.plt, "close", drawn.append)
    paths = {"": shape.along_paths(grid)}
    forming_pictures.paths_picture(tmp_path / "p.png", paths, {"outline of the punch": 90})
    forming_pictures.outline_picture(tmp_path / "o.png", {"": grid})
    named = [
        [text.get_text() for text in each.legends[0].get_texts()] for each in drawn if each != "all"
    ]
    assert named == [["outline of the punch"], ["flat", "formed"]]


def test_tables_and_diagrams(tmp_path):
    runs = {
        "all couplings": formed(on_dome),
        "without biaxial": formed(lambda x, y: on_dome(1.01 * x, y)),
    }
    paths = {label: shape.along_paths(grid) for label, grid in runs.items()}
    shape.write_paths(tmp_path / "paths.csv", paths["all couplings"])
    with open(tmp_path / "paths.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 48 + 40 + 28
    at = [row for row in rows if row["path_deg"] == "45"][20]
    assert float(at["distance_mm"]) == 100
    assert float(at["shear_angle_deg"]) == pytest.approx(
        paths["all couplings"][45].shear_angle[20], rel=1e-6
    )
    forming_pictures.paths_picture(
        tmp_path / "paths.png", paths, marks={"punch": (217, 90, 55), "blank": 135}
    )
    forming_pictures.outline_picture(tmp_path / "outline.png", runs)
    forming_pictures.state_map(tmp_path / "states.png", runs["all couplings"])
    forming_pictures.state_map(tmp_path / "states_formed.png", runs["all couplings"], formed=True)
    assert all(
        is_picture(tmp_path / f"{name}.png")
        for name in ("paths", "outline", "states", "states_formed")
    )


@pytest.mark.parametrize("shortening", [0.0, 0.1])
def test_plies_at_plus_and_minus_45_have_files_of_their_own(tmp_path, shortening):
    """And one of shortening, if there is some."""
    grids = {name: formed(on_dome) for name in ("+45", "-45")}
    for grid in grids.values():
        for yarns in "ab":
            grid.cell_data[f"shortening_{yarns}"] = np.full(grid.n_cells, shortening)
    forming_pictures.draw_plies(tmp_path, grids)
    files = [f"{name}_{label}" for name in ("paths", "states") for label in ("p45", "m45")]
    files += ["formed"] + (["shortening"] if shortening else [])
    assert sorted(file.stem for file in tmp_path.iterdir()) == sorted(files)


@pytest.mark.parametrize("angle", [0, 45])
def test_picture_of_the_formed_ply(tmp_path, angle, capfd):
    tool = pyvista.PolyData.from_regular_faces(*double_dome())
    grid = formed(on_dome, angle=np.radians(angle), ranks=2)
    for with_tool in (tool, None):
        path = tmp_path / "formed.png"
        space.formed_picture(path, [grid], with_tool)
        assert is_picture(path, (1600, 1000))
        path.rename(tmp_path / f"formed_{with_tool is not None}.png")
    assert capfd.readouterr().err == ""
