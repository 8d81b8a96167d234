"""Where a sheet passes through itself."""

import numpy as np
import pytest
from builders import COMM, Elastic, everywhere, said
from builders import sheet as rectangle

import fabric_fenicsx as ff
from fabric_fenicsx.contact.self_contact import crossing_warning, crossings, self_crossings

pytestmark = pytest.mark.versions

LENGTH, WIDTH, RADIUS = 40.0, 8.0, 5.0


def rolled(growth, **options):
    """A strip rolled up by more than a turn, on a radius that grows by `growth` in one."""
    blank = rectangle(LENGTH, WIDTH, 20, 4, spatial=True, **options)
    x, u = blank.coordinates()[:, 0], blank.u.x.array.reshape(-1, 3)
    turn = x / RADIUS
    r = RADIUS * (1 + growth * turn / (2 * np.pi))
    u[:, 0], u[:, 2] = r * np.sin(turn) - x, -r * np.cos(turn)
    return blank


def test_edges_through_a_triangle():
    """In each of its corners, near to each of their ends; not beside it nor before its plane."""
    for x, y, low, high, through in [
        (0.05, 0.05, -0.1, 2, True),
        (0.9, 0.05, -2, 0.1, True),
        (0.05, 0.9, -1, 1, True),
        (0.6, 0.6, -1, 1, False),
        (-0.05, 0.5, -1, 1, False),
        (0.5, -0.05, -1, 1, False),
        (0.2, 0.2, 0.1, 1, False),
        (0.2, 0.2, -1, -0.1, False),
    ]:
        needle = [[x, y, low], [x, y, high], [x - 1e-3, y, 2 * high]]  # two edges go through
        places = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], *needle], float)
        found = crossings(places, np.array([[0, 1, 2], [3, 4, 5]]))
        at_it = np.linalg.norm(found - [x, y, 0], axis=1) < 1e-12
        assert at_it.sum() == through and len(found) == 2 * through


@pytest.mark.mpi
@pytest.mark.parametrize("options", [{}, {"cell": "quadrilateral"}, {"degree": 2}])
def test_a_sheet_that_is_rolled_into_itself(options):
    """On the first radius the second turn lies in the first; it is beside it on a growing one, and
    comes through it on one that falls after half a turn."""
    assert not len(self_crossings(rolled(0.2, **options).whole))
    part = rolled(0.0, **options)
    x = part.u.x.array.reshape(-1, 3)
    x[:, 0] += 0.1 * (part.coordinates()[:, 0] - LENGTH / 2)
    found = self_crossings(part.whole)
    assert len(found) and np.array_equal(found, COMM.bcast(found))


def test_neighbours_do_not_count():
    """Nor does a sheet that is bent on itself by 170 deg along a line of nodes."""
    blank = rectangle(LENGTH, WIDTH, 20, 4, spatial=True)
    x, u = blank.coordinates(), blank.u.x.array.reshape(-1, 3)
    over = np.maximum(x[:, 0] - LENGTH / 2, 0.0)
    u[:, 0], u[:, 2] = (np.cos(np.radians(170)) - 1) * over, np.sin(np.radians(170)) * over
    assert not len(self_crossings(blank.whole))


@pytest.mark.mpi
def test_sheets_that_pass_through_one_another_are_told_of():
    """The lower one, led to tilt, reaches through the upper one, that no contact keeps away."""
    names = "lower", "upper"
    sheets = [(rectangle(LENGTH, WIDTH, 4, 2, spatial=True), 1.0, name) for name in names]
    stack = ff.Stack(sheets)
    between = np.mean([end[2] for end in stack.extent()])

    def led(x, load):
        is_lower = x[2] < between
        return load * np.array([0 * x[0], 0 * x[0], is_lower * 0.1 * (x[0] - LENGTH / 2)])

    scene = ff.Scene(stack, [Elastic()], [ff.Support("all", everywhere, (0, 1, 2), led)])
    assert crossing_warning(stack) == ""
    result = ff.Job(scene, steps=1, limits=ff.Limits(imbalance=2.0)).run()
    found = crossing_warning(stack)
    assert found.startswith("lower and upper pass through each other at ")
    assert COMM.rank > 0 or found in said(result.summary)
