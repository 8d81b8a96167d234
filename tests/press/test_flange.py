"""The share of a place that lies beneath the die's flange."""

import numpy as np
import pytest

from fabric_fenicsx.press.site import Flange
from fabric_fenicsx.surfaces.primitives import Plate
from fabric_fenicsx.surfaces.surfaces import Flipped
from fabric_fenicsx.surfaces.tool import Tool

T = 2e-4
EXTENT = np.array([[-50, -60, 0], [50, 60, 0]])  # some places lie beyond
PLACES = np.random.default_rng(0).uniform(-60, 60, (3, 4000))


def over_opening(at):
    """A die whose opening of radius 40 mm lies about `at` (2,), just over z = 0."""
    return Tool(Flipped(Plate(80.0)), lambda load: (*np.multiply(load, at), T / 2), name="die")


def beneath(places, middle):
    """1 outside the opening about `middle` (2,)."""
    return (np.hypot(*places[:2] - np.reshape(middle, (2, 1))) >= 40).astype(float)


def test_the_share_falls_where_the_radius_begins():
    """Of 5 mm: to half of it, 0.23 mm on."""
    die = Tool(Flipped(Plate(80.0, entry=5.0)), lambda load: (0, 0, 0.5), name="die")
    x = np.array([45.1, 45.0, 44.95, 44.77, 44.6])
    share = Flange(die, 1.0, 1.0, EXTENT)(np.array([x, 0 * x, 0 * x]))
    assert share[[0, 1, 2, 4]].tolist() == [1, 1, 1, 0] and share[3] == pytest.approx(0.49, abs=0.1)


def test_the_share_is_that_of_each_place():
    """Though most places are judged by the lattice about them; whatever was asked before, and
    where the die has moved to."""
    die = over_opening((3.0, 0.0))
    flange = Flange(die, T, 1.0, EXTENT)
    for load, places in ((0.0, PLACES), (0.0, PLACES[:, ::-7]), (1.0, PLACES)):
        die.at(load)
        right = beneath(places, (3 * load, 0))
        assert np.array_equal(flange(places), right) and {0.0, 1.0} == {*right}
