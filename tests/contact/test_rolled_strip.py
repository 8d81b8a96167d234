"""A strip that is rolled up: its turns bear each other, the top of one the bottom of the next."""

import numpy as np
import pytest
from builders import Elastic, march, near, off_differences, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.solve.newton import Newton

T, CORE, PULL, D = 2.0, 10.0, 0.3, 8.33  # thickness, radius [mm], pull [N/mm], bending [N mm]
LENGTH, WIDTH, NX, TURNS, STEPS = 120.0, 4.0, 60, 1.35, 36
RADII = (CORE + T / 2) + np.array([0, T])  # radii of the middle surfaces of both turns


def test_a_strip_rolled_up_lies_on_itself():
    """A core pulls it in and lays it around itself; a smooth bar stands for the core, and the first
    cells turn. Turns are a thickness apart, and bending takes D / (2 R^2) of each length that is
    laid on the turn of radius R. Energies and work agree to a part of what the strip's end did."""
    blank = sheet(LENGTH, WIDTH, NX, 1, "left", spatial=True)

    def turned(x, load):
        c, s = np.cos(2 * np.pi * TURNS * load), np.sin(2 * np.pi * TURNS * load)
        return np.array([(c - 1) * x[0] - s * RADII[0], 0 * x[1], s * x[0] + (c - 1) * RADII[0]])

    bar = ff.Tool(ff.Cylinder((0, 0, -RADII[0]), (0, 1, 0), CORE), name="bar")
    contact, states = ff.SelfContact(T, penalty=10.0, friction=0.3), []
    pull = ff.EdgeTension(PULL, (1, 0, 0), near(0, LENGTH))
    terms = [Elastic(500.0), ff.Bending(D, D_t=2 * D), ff.Contact(bar, T, 10.0), contact, pull]
    core = ff.Support("core", lambda x: x[0] < 1.001 * LENGTH / NX, (0, 2), turned)
    scene = ff.Scene(blank, terms, [core, ff.Support("side", near(1, 0.0), (1,))])
    outcome = march(Newton(scene), STEPS, on_accept=states.append, path_tolerance=1e-5)
    assert not outcome.reason
    X, u = scene.blank.coordinates(), scene.blank.nodal_displacement()
    _, row = np.unique(X[:, 0], return_index=True)
    x, z = (X + u)[row][:, ::2].T + [[0], [RADII[0]]]
    radius, angle = np.hypot(x, z), np.unwrap(np.arctan2(x, z))
    angle -= angle[0]
    under = angle < 0.25 * 2 * np.pi
    above = np.interp(angle[under] + 2 * np.pi, angle, radius)
    assert above - radius[under] == pytest.approx(T, rel=0.04)
    load, bending = np.array([[s.load, s.energies["bending"] / WIDTH] for s in states]).T
    for R, turns in zip(RADII, [(0.5, 0.9), (1.23, TURNS)]):
        ends = np.interp(turns, TURNS * load, bending)
        assert np.diff(ends) / np.diff(turns) / (2 * np.pi) == pytest.approx(D / (2 * R), rel=0.01)
    missing = sum(states[-1].energies.values()) - states[-1].external_work
    assert abs(missing) < 0.005 * PULL * WIDTH * (LENGTH - x[-1])
    assert off_differences(contact, 0.01) < 1e-6
