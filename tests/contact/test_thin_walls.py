"""Tools with thin walls press as their outer faces alone, however far a step takes them."""

import numpy as np
import pytest
import pyvista
from builders import Elastic, alone, displacement, run, sheet

import fabric_fenicsx as ff

T, K = 0.4, 1000.0  # thickness [mm], penalty [N/mm^3]
BALL = pyvista.Sphere(radius=10.0, theta_resolution=24, phi_resolution=24)


def ball(*walls):
    """Triangles of a ball of 10 mm, hollow from a wall on."""
    points, cells = np.array(BALL.points, float), BALL.regular_faces
    parts = [points, *(points * (1 - wall / 10) for wall in walls)]
    faces = [cells, *(cells[:, ::-1] + len(points) for _ in walls)]
    return ff.TriangulatedSurface(np.vstack(parts) + [20, 20, -10 - T / 2], np.vstack(faces))


def plate(height):
    return ff.Block(20, 14, height, 0.4, 3.0, centre=(20, 20, -T / 2))


def pushed(surface, rise):
    """Force [N] and shape of a clamped sheet that a tool under its middle pushes up in one step."""
    blank = sheet(40, 40, 10, 10, spatial=True)
    contact = ff.Contact(ff.Tool(surface, path=(0, 0, rise), name="tool"), T, K, friction=0.2)
    on_rim = lambda x: (abs(x[:2] - 20) > 20 - 1e-6).any(0)  # noqa: E731
    rim = ff.Support("rim", on_rim, (0, 1, 2))
    run(ff.Scene(blank, [Elastic(1e3), contact], [rim]), 1)
    assert contact.behind_walls() == (0, 0.0)
    return contact.force()[2], displacement(blank)


@pytest.mark.parametrize(
    "thin, solid, rise", [(plate(0.9), plate(40), 6.0), (ball(0.5), ball(), 4.0)]
)
def test_a_wall_presses_as_a_solid(thin, solid, rise):
    (force, shape), (right, same) = pushed(thin, rise), pushed(solid, rise)
    assert right > 100 and force == pytest.approx(right, rel=1e-6)
    assert abs(shape - same).max() < 1e-5


@pytest.mark.parametrize(
    "way, up, deep",
    [
        ([(28, 1.0), (28, -0.8)], 1, 0.6),  # beyond the middle of the wall
        ([(28, 1.0), (28, -1.2)], 1, 1.0),  # beneath it
        ([(28, 1.0), (31, 1.0), (31, -1.2), (28, -1.2)], -1, 0.0),  # round its edge at x = 30
        ([(28, 1.0), (31, -0.6), (28, -1.2)], -1, 0.0),
    ],
)
def test_a_node_goes_round_a_wall_but_not_through_it(way, up, deep):
    """Of a plate from z = -1.1 to -0.2; nodes that are all in one place are pressed up or down."""
    blank = sheet(4, 4, 1, 1, spatial=True)
    contact = alone(blank, ff.Contact(ff.Tool(plate(0.9), name="plate"), T, K))
    for x, z in way:
        blank.u.x.array[:] = ([x, 20, z] - blank.coordinates()).ravel()
        contact.set_load(1.0)
        force, (count, depth) = contact.force()[2], contact.behind_walls()
        contact.accept()
    assert np.sign(force) == up and depth == pytest.approx(deep)
    assert contact.nodes.comm.allreduce(contact.nodes.count) == (count or 5)
