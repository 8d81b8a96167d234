"""Displacement and force of a curve."""

import numpy as np
import pytest
from builders import Elastic, sheet

import fabric_fenicsx as ff


def test_a_tool_is_measured_along_its_motion(monkeypatch):
    """The first one that moves, by 5 mm along (3, 0, 4); a support that moves, too, is not."""
    ways = {"a": (0, 0, 0), "b": lambda load: (3 * load + 1, 2, 4 * load)}
    tools = [ff.Tool(ff.Sphere(5, (0, 0, -20)), way, name=k) for k, way in ways.items()]
    terms = [Elastic(), *(ff.Contact(tool, 1.0, 100.0) for tool in tools)]
    scene = ff.Scene(sheet(20, 10, 2, 1, spatial=True), terms, ff.clamped_ends(1.0))
    forces = {"a": (9.0, 9.0, 9.0), "b": (1.0, 2.0, 3.0)}
    monkeypatch.setattr("fabric_fenicsx.scene.output.tool_force", lambda _, tool: forces[tool.name])
    assert ff.Setup(scene).measure(scene, 0.5) == pytest.approx((2.5, 3.0))


def test_of_supports_the_one_that_moves_furthest_is_measured(monkeypatch):
    """Along the mean motion of its nodes, which goes to 3 and 4 mm at y = 5 mm."""
    pulled = lambda x, load: load * np.array([0.6 * x[1], 4 + 0 * x[1]])  # noqa: E731
    supports = [
        ff.Support("small", lambda x: x[0] < 1e-6, (0, 1), (-1.0, 0.0)),
        ff.Support("large", lambda x: x[0] > 20 - 1e-6, (0, 1), pulled),
    ]
    scene = ff.Scene(sheet(20, 10, 2, 2), [Elastic()], supports)
    monkeypatch.setattr(ff.Scene, "reaction", lambda _, name: {"large": [1.0, 2.0]}[name])
    assert ff.Setup(scene).measure(scene, 0.5) == pytest.approx((2.5, 0.6 + 1.6))
    still = ff.Scene(sheet(20, 10, 2, 2), [Elastic()])
    assert ff.Setup(still).measure(still, 1.0) == (0.0, 0.0)
