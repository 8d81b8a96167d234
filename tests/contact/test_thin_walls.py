"""Tools with thin walls press as their outer faces alone, however far a step takes them."""

import re

import numpy as np
import pytest
import pyvista
from builders import Elastic, displacement, run, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.job.space_validity import passed_through

T, K = 0.4, 1000.0  # thickness [mm], penalty [N/mm^3]


def ball(radius_within=None):
    """Triangles of a ball of 10 mm, hollow if a radius is given."""
    outer = pyvista.Sphere(radius=10.0, theta_resolution=24, phi_resolution=24)
    points, cells = np.array(outer.points, float), outer.regular_faces
    if radius_within:
        points = np.vstack([points, points * radius_within / 10])
        cells = np.vstack([cells, cells[:, ::-1] + len(points) // 2])
    return ff.TriangulatedSurface(points + [20, 20, -10 - T / 2], cells)


def pushed(surface):
    """Force [N] and shape of a clamped sheet that a tool pushes up by 4 mm in one step."""
    blank = sheet(40, 40, 10, 10, spatial=True)
    contact = ff.Contact(ff.Tool(surface, path=(0, 0, 4.0), name="tool"), T, K, friction=0.2)
    on_rim = lambda x: (abs(x[:2] - 20) > 20 - 1e-6).any(0)  # noqa: E731
    scene = ff.Scene(blank, [Elastic(1e3), contact], [ff.Support("rim", on_rim, (0, 1, 2))])
    run(scene, 1)
    assert not passed_through(scene)
    return contact.force()[2], displacement(blank)


def test_a_wall_presses_as_a_solid():
    (force, shape), (right, same) = pushed(ball(9.5)), pushed(ball())
    assert right > 100 and force == pytest.approx(right, rel=1e-6)
    assert abs(shape - same).max() < 1e-5


@pytest.mark.parametrize(
    "way, up, sentence",
    [
        ([(28, 1.0), (28, -0.8)], 1, "5 nodes of blank went through .* up to 0.6 mm behind .*"),
        ([(28, 1.0), (28, -1.2)], 1, "5 nodes of blank went through .* up to 1 mm behind .*"),
        ([(28, 1.0), (31, 1.0), (31, -1.2), (28, -1.2)], -1, ""),  # round its edge at x = 30
    ],
)
def test_a_node_goes_round_a_wall_but_not_through_it(way, up, sentence):
    """Of a plate from z = -1.1 to -0.2; nodes that are all in one place are pressed up or down."""
    blank = sheet(4, 4, 1, 1, spatial=True)
    plate = ff.Block(20, 14, 0.9, 0.4, 3.0, centre=(20, 20, -T / 2))
    contact = ff.Contact(ff.Tool(plate, name="plate"), T, K)
    scene = ff.Scene(blank, [Elastic(), contact], [])
    for x, z in way:
        blank.u.x.array[:] = ([x, 20, z] - blank.coordinates()).ravel()
        scene.set_load(1.0)
        force, told = contact.force()[2], "".join(passed_through(scene))
        scene.accept()
    assert np.sign(force) == up and re.fullmatch(sentence, told)
