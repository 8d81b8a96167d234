"""Wrinkles of formed plies whose waves are known."""

import numpy as np
import pytest
from formed_plies import formed

from fabric_fenicsx.postprocess.wrinkles import HEIGHT, height_map, wrinkles
from fabric_fenicsx.tools.double_dome import DoubleDome
from fabric_fenicsx.tools.primitives import Cylinder, Plane

SIZE = {"length": 240.0, "width": 120.0}


def nowhere(x):
    return np.full(len(x), np.inf)


def over(*surfaces, thickness=0.0):
    return lambda x: np.min([s.evaluate(x).gap for s in surfaces], axis=0) - thickness / 2


def rippled(length, amplitude=2.0, rise=0.0005, **options):
    """A ply that waves as its ends come nearer."""

    def ripple(x, y):
        z = rise * x * x + amplitude * np.cos(2 * np.pi * x / length)
        return np.column_stack([x * (1 - (np.pi * amplitude / length) ** 2), y, z])

    return formed(ripple, **SIZE, **options)


@pytest.mark.parametrize("length, full", [(20.0, False), (20.0, True), (30.0, False)])
def test_a_sine_on_a_curved_ply(length, full):
    """Amplitude and length, seen nearly in full; cells are 2.5 mm, but for the ends of the ply."""
    found = wrinkles(height_map(rippled(length, nx=96, ny=48, full=full), nowhere))
    assert found["height_rms_mm"] == pytest.approx(2 / np.sqrt(2), rel=0.06)
    assert 1.9 < found["height_mm"] < 2.6
    assert found["wavelength_mm"] == pytest.approx(length, rel=0.06)
    assert found["cells_a_wave"] == pytest.approx(length / 2.0, rel=0.1)  # edges of 2.5 and 1.8 mm


def test_what_lies_on_a_tool_or_between_tools_is_no_wrinkle():
    """Though the ply is bent about a small radius; between plates a wave is as high as they let."""

    def wrapped(x, y, r=10.5):
        far = np.maximum(x - 15, 0)
        angle = np.minimum(x, 15) / 10
        along, down = np.cos(1.5), np.sin(1.5)
        return np.column_stack([r * np.sin(angle) + along * far, y, r * np.cos(angle) - down * far])

    grid = formed(wrapped, nx=96, ny=24, **SIZE)
    bar = over(Cylinder((0, 0, 0), (0, 1, 0), 10.0), thickness=1.0)
    bent = abs(height_map(grid, nowhere)[HEIGHT]).max()
    on_bar = height_map(grid, bar)
    wound = on_bar.points[:, 0] < 14
    assert bent > 0.3 and abs(on_bar[HEIGHT][wound]).max() < 1e-6
    flat = rippled(30.0, nx=48, ny=24, rise=0.0)
    plates = over(Plane((0, 0, -2.5), (0, 0, 1)), Plane((0, 0, 2.5), (0, 0, -1)), thickness=1.0)
    assert wrinkles(height_map(flat, plates))["height_mm"] <= 2.0


def test_what_bridges_two_tools_all_round_is_shape():
    """A ring that stands out by 2 mm is shortened along its circles, and the same there; waves
    along these are wrinkles."""

    def ring(x, y, lobes=0.0):
        r, angle = np.hypot(x, y), np.arctan2(y, x)
        z = np.exp(-(((r - 60) / 10) ** 2)) * (2 + lobes * np.cos(12 * angle))
        share = 1 - 3 * (1 - np.exp(-((r / 20) ** 2))) / np.maximum(r, 1e-9)  # drawn in by 3 mm
        return np.column_stack([share * x, share * y, z])

    size = {"nx": 60, "ny": 60, "length": 240.0, "width": 240.0}
    even = wrinkles(height_map(formed(ring, **size), nowhere))
    lobes = height_map(formed(lambda x, y: ring(x, y, 1.0), **size), nowhere)
    waved, in_plane = wrinkles(lobes), abs(lobes.points[:, 0]) < 1e-6
    assert even["height_mm"] < 0.4
    assert 0.8 < waved["height_mm"] < 1.4
    assert abs(lobes[HEIGHT][in_plane]).max() == pytest.approx(waved["height_mm"], rel=0.2)


def test_a_ply_over_a_double_dome_has_no_wrinkles():
    dome = DoubleDome()
    grid = formed(dome.lift, 94, 54)
    found = wrinkles(height_map(grid, over(dome)))
    assert found["height_mm"] < 1e-9 and found["wavelength_mm"] is None


def test_folds_of_the_rim():
    """Eight around a ply whose rim waves by 3 mm up and down."""

    def lobes(x, y):
        z = 3 * np.cos(8 * np.arctan2(y, x)) * np.minimum(np.hypot(x, y) / 100, 1)
        return np.column_stack([x, y, z])

    grid = formed(lobes, nx=80, ny=80, length=240.0, width=240.0, full=True)
    found = wrinkles(height_map(grid, nowhere))
    assert found["folds"] == 8
    assert found["rim_mm"] == pytest.approx(6, rel=0.01)
