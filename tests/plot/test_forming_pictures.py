"""Pictures of formed plies."""

import matplotlib.image
import numpy as np
import pyvista
from dome_triangles import double_dome
from formed_plies import formed, on_dome

from fabric_fenicsx.plot import forming_pictures, space


def is_picture(path, pixels=None):
    image = matplotlib.image.imread(path)
    return image[..., :3].std() > 0.05 and (pixels is None or image.shape[1::-1] == pixels)


def test_pictures_of_a_formed_ply(tmp_path, capfd, monkeypatch):
    tool = pyvista.PolyData.from_regular_faces(*double_dome())
    grid = formed(on_dome, angle=np.radians(45), ranks=2)
    forming_pictures.outline_picture(tmp_path / "outline.png", {"": grid})
    forming_pictures.state_map(tmp_path / "states.png", grid, formed=True)
    assert is_picture(tmp_path / "outline.png") and is_picture(tmp_path / "states.png")
    bar, labels = space.shear_bar, []
    monkeypatch.setattr(
        space, "shear_bar", lambda *given, **more: labels.append(given[1:3]) or bar(*given, **more)
    )
    grid["shear_angle"][7] = -0.9
    for with_tool in (tool, None):
        path = tmp_path / "formed.png"
        space.formed_picture(path, [grid], with_tool)
        assert is_picture(path, (1600, 1000))
    assert all("largest of a cell: 51.57)" in label for _, label in labels)
    assert capfd.readouterr().err == ""
