"""What is doubted of a scene's tools, and what is not."""

import builders
import pytest

from fabric_fenicsx import Contact, Membrane, Scene, Sphere, Support, Tool, clamped_ends, load
from fabric_fenicsx.scene.tool_warnings import (
    cells_over_radius,
    few_cells_warning,
    tool_warnings,
    untouched_warning,
)

KOMEILI = load("komeili")


@pytest.mark.mpi
@pytest.mark.parametrize(
    "surface, mu, words",
    [
        (Sphere(30, (10, 10, -30.5)), 1.99, []),
        (Sphere(30, (10, 10, -30.5)), 2.01, ["friction on tip has a coefficient of 2.01, which"]),
        (Sphere(0.81, (10, 10, -1.3)), 0.25, []),  # cells of 1.25 mm span 88 deg of it, or 92 deg
        (Sphere(0.78, (10, 10, -1.3)), 0.25, ["cells are 1.25 mm long where the tip has a radius"]),
    ],
)
def test_what_is_doubted_of_tools(surface, mu, words):
    blank = builders.sheet(20, 20, 16, 16, "crossed", spatial=True)
    tool = Tool(surface, lambda load: (0, 0, -1), name="tip")
    terms = [Membrane(KOMEILI), Contact(tool, friction=mu)]
    told = tool_warnings(Scene(blank, terms, clamped_ends()))
    assert len(told) == len(words) and all(map(str.startswith, told, words))


def over_balls(n, degree=1, held=()):
    """A sheet of n columns of crossed cells over 20 mm, and contacts of two balls at rest."""
    blank = builders.sheet(20, 20, n, n, "crossed", spatial=True, degree=degree)
    balls = [Tool(Sphere(r, (10, 10, -r - 0.5)), name=f"ball {r}") for r in (30, 4)]
    contacts = [Contact(ball, 1.0, penalty=9.0) for ball in balls]
    return Scene(blank, [Membrane(KOMEILI), *contacts], held)


QUARTER = [Support("x", lambda x: x[0] < 1e-6, (0,)), Support("y", lambda x: x[1] < 1e-6, (1,))]


@pytest.mark.parametrize(
    "n, degree, held, cells",
    [(5, 1, [], ""), (4, 1, [], "4 cells"), (3, 2, [], ""), (2, 2, [], "4 cells")]
    + [(3, 1, QUARTER, ""), (2, 1, QUARTER[1:], "4 cells"), (2, 1, [], "2 cells")],
)
def test_few_cells_along_a_sheet_on_tools(n, degree, held, cells):
    """Halves of quadratic ones, and of a quarter twice as many, count."""
    told = few_cells_warning(over_balls(n, degree, held))
    assert told.startswith(cells) and bool(told) == bool(cells)


def test_radii_and_gaps_of_tools_that_touch_and_that_do_not():
    """A cell over the least radius of those touched; the least distance of one that has moved."""
    scene = over_balls(5)
    scene.blank.u.x.array[2::3] = -0.2
    scene.accept()
    assert cells_over_radius(scene) == pytest.approx(4 / 4)
    aside = Tool(Sphere(4, (10, 10, -9)), lambda load: (0, 0, 3.0 * load - 1), name="ball")
    scene = Scene(scene.blank, [Membrane(KOMEILI), Contact(aside, 1.0, penalty=9.0)])
    scene.set_load(1.0)
    scene.accept()
    words = "a tool never touched the sheet: ball moved by 3 mm, and is still 2.3 mm off;"
    assert untouched_warning(scene).startswith(words)
