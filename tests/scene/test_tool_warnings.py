"""What is doubted of a scene's tools, and what is not."""

import builders
import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.material.presets import load
from fabric_fenicsx.mechanics.contact.tool_contact import Contact
from fabric_fenicsx.mechanics.shell.membrane import Membrane
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.scene.supports import clamped_ends
from fabric_fenicsx.scene.tool_warnings import tool_warnings
from fabric_fenicsx.tools.primitives import Sphere
from fabric_fenicsx.tools.tool import Tool
from fabric_fenicsx.tools.triangulated import TriangulatedSurface

KOMEILI = load("komeili")


def sheet():
    return builders.sheet(20, 20, 16, 16, "crossed", MPI.COMM_WORLD, spatial=True)


def with_hole(width, unit=1.0):
    """A plate of triangles of 2 mm with an opening in its middle; unit: a millimetre."""
    side = np.arange(-30.0, 31, 2)
    x = np.stack([*(each.ravel() for each in np.meshgrid(side, side)), np.zeros(31 * 31)], 1)
    i = (31 * np.arange(30)[:, None] + np.arange(30)).ravel()
    cells = np.vstack([np.stack([i, i + 1, i + 32], 1), np.stack([i, i + 32, i + 31], 1)])
    return TriangulatedSurface(unit * x, cells[(abs(x[cells].mean(1)) > width / 2).any(1)])


@pytest.mark.mpi
@pytest.mark.parametrize(
    "surface, mu, words",
    [
        (Sphere(30, (10, 10, -30.5)), 0.25, []),
        (Sphere(30, (10, 10, -30.5)), 25.0, ["friction on tip has a coefficient of 25, which is"]),
        (with_hole(0), 0.25, []),
        (with_hole(4), 0.25, ["the surface of tip has a hole 4 mm wide at (0, 0, 0) mm in"]),
        (with_hole(12), 0.25, []),  # as of a die
        (with_hole(0, 0.06), 0.25, ["the surface of tip is 3.6 mm large beside a sheet of 20 mm"]),
    ],
)
def test_what_is_doubted_of_tools(surface, mu, words):
    blank = sheet()
    tool = Tool(surface, lambda load: (0, 0, -1), name="tip")
    terms = [Membrane(KOMEILI), Contact(tool, friction=mu)]
    told = tool_warnings(Scene(blank, terms, clamped_ends()))
    assert len(told) == len(words) and all(map(str.startswith, told, words))
