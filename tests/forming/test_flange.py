"""The share of a place that lies beneath the die's flange."""

import numpy as np

from fabric_fenicsx.forming.flange import Flange
from fabric_fenicsx.tools.primitives import Plate
from fabric_fenicsx.tools.surfaces import Flipped
from fabric_fenicsx.tools.tool import Tool

T = 2e-4
ANGLES = np.arange(8) * np.pi / 4
RING = np.concatenate([r * np.array([np.cos(ANGLES), np.sin(ANGLES)]) for r in (2, 4, 6)], 1)
EXTENT = np.array([[-50, -60, 0], [50, 60, 0]])  # some places lie beyond
PLACES = np.random.default_rng(0).uniform(-60, 60, (3, 4000))


def over_opening(at):
    """A die whose opening of radius 40 mm lies about `at` (2,), just over z = 0."""
    return Tool(Flipped(Plate(80.0)), lambda load: (*np.multiply(load, at), T / 2), name="die")


def counted(places, middle):
    """What of the rings about `places` (3, n) lies outside the opening about `middle` (2,)."""
    at = places[:2, :, None] + RING[:, None] - np.reshape(middle, (2, 1, 1))
    return np.clip(2 * (np.hypot(*at) >= 40).mean(1) - 1, 0, 1)


def test_the_share_is_what_all_rings_tell():
    """Though most places are judged by the lattice about them; whatever was asked before."""
    flange, right = Flange(over_opening((0, 0)), T, 1.0, EXTENT), counted(PLACES, (0, 0))
    assert np.array_equal(flange(PLACES), right)
    assert np.array_equal(flange(PLACES[:, ::-7]), right[::-7])
    assert {0.0, 1.0} < set(right) and ((right > 0) & (right < 1)).sum() > 100


def test_the_flange_moves_with_the_die():
    die = over_opening((3.0, 0.0))
    flange = Flange(die, T, 1.0, EXTENT)
    flange(PLACES)
    die.at(1.0)
    assert np.array_equal(flange(PLACES), counted(PLACES, (3, 0)))


def test_places_that_are_no_numbers_are_not_beneath_it():
    flange = Flange(over_opening((0, 0)), T, 1.0, EXTENT)
    assert flange(np.array([[50.0, np.nan, np.inf, 1e300], [0.0] * 4, [0.0] * 4])).tolist() == [
        1.0,
        0.0,
        0.0,
        1.0,
    ]
    assert flange(np.empty((3, 0))).shape == (0,)
