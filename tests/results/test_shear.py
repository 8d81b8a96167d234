"""How far fabric is sheared, and where it crumples, from fields that are known."""

import numpy as np
import pytest
from builders import COMM, Elastic, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.mechanics.output import Fields
from fabric_fenicsx.results.quantities import (
    fabric_doubts,
    limited,
    shear_quantities,
    shortening_quantities,
)
from fabric_fenicsx.results.result import Result

LENGTH, WIDTH = 200.0, 100.0


def sheared(spatial=True, crumpled=0.0, names=(), nx=20):
    """A `Result` of a sheet about the origin, with the shear angle 0.3 x / 100 mm and, in its
    outermost cells along x, 0.9 with yarns b shortened by `crumpled`."""
    blank = sheet(LENGTH, WIDTH, nx, nx // 2, spatial=spatial)
    if names:
        first = lambda x: x[0] < LENGTH / 2  # noqa: E731
        blank.divide({names[0]: first}, rest=names[1])
    scene = ff.Scene(blank, [Elastic()])
    x = blank.midpoints()[0] - LENGTH / 2
    fields = Fields({})
    fields |= {"shear_angle": 0.3 * x / 100, "shortening_a": 0 * x, "shortening_b": 0 * x + 0.005}
    last = abs(x) > LENGTH / 2 - LENGTH / nx / 3  # a triangle of each rectangle at either end
    fields["shear_angle"][last] = -0.9
    fields["shortening_b"][last] = crumpled
    return Result({}, [], fields, None, scene)


def found(result):
    blank = result.scene.blank
    parts = list(blank.parts.values()) or [blank.whole]
    return shear_quantities(result, parts) | shortening_quantities(result, parts)


@pytest.mark.mpi
def test_shear_and_crumpling():
    """The ends are 2 x 10 triangles of 800; of places that mirror each other the first is told."""
    q = found(sheared(crumpled=0.12))
    assert q["shear_angle_max_deg"] == pytest.approx(np.degrees(0.9))
    assert q["shear_angle_max_at_mm"] == pytest.approx([5 / 3, 5])
    assert q["shortening_max"] == q["shortening_at_shear_angle_max"] == pytest.approx(0.12)
    assert q["shortening_max_at_mm"] == q["shear_angle_max_at_mm"]
    assert q["shortened_by_5_percent_share"] == pytest.approx(20 / 800)
    assert "shear_angle_max_in" not in q


@pytest.mark.mpi
def test_what_99_percent_stay_below_is_not_of_a_few_cells():
    """Cells near the ends, whose share falls with their size, move the largest angle alone."""
    plain, coarse, fine = sheared(), sheared(nx=40), sheared(nx=80)
    for result in (plain, coarse, fine):
        result.fields["shear_angle"][:] = abs(result.fields["shear_angle"])
    below = [found(each)["shear_angle_99_percent_deg"] for each in (coarse, fine)]
    largest = [found(each)["shear_angle_max_deg"] for each in (coarse, fine)]
    assert largest == pytest.approx([np.degrees(0.9)] * 2)
    assert below[1] == pytest.approx(np.degrees(0.3), rel=0.02)
    assert below[0] > 1.2 * below[1]  # 1.25 % of the area have 0.9


@pytest.mark.mpi
def test_of_several_plies_the_one_is_named():
    q = found(sheared(crumpled=0.12, names=("left", "right")))
    assert q["shear_angle_max_in"] == q["shortening_max_in"] == "left"
    assert q["shortened_by_5_percent_share"] == pytest.approx(20 / 800)


def test_cells_that_crumple_are_told_of_wherever_they_are():
    """With the largest shear angle in one of them, and in another one."""
    result = sheared(crumpled=0.12)
    _, (words, of, _) = fabric_doubts(result)
    assert words.startswith("cells of blank crumple in 2.5 % of its area, as at (1.667, 5) mm of")
    assert "yarns are shortened by 12 %: the largest shear angle, 51.6 deg at (1.6" in words
    assert "99 % of the area stay below" in words and of == "shear_angle_max"
    middle = abs(result.scene.blank.midpoints()[0] - LENGTH / 2) < LENGTH / 40
    result.fields["shortening_b"][:] = np.where(middle, 0.06, 0.0)
    _, (words, *_) = fabric_doubts(result)
    assert "shortened by 6 %: the largest shear angle, 51.6 deg at (1.667, 5) mm" in words
    both = fabric_doubts(sheared(crumpled=0.12, names=("left", "right")))
    assert [each.text.split(" crumple")[0].split()[-1] for each in both[1::2]] == ["left", "right"]


@pytest.mark.mpi
def test_what_limits_ask_for_is_known_with_its_place():
    """Of fabric, filled by fibres in one cell."""
    result = sheared(crumpled=0.12)
    filled = result.scene.blank.midpoints()[0] > LENGTH - 4
    result.fields["fibre_volume_fraction"] = np.where(filled, 1.2, np.nan)
    ((name, values),) = limited(result)
    assert name == "" and values["shear"][0] == pytest.approx(np.degrees(0.9))
    assert values["shear"][1] == pytest.approx([5 / 3, 5])
    assert values["shortening"][0] == pytest.approx(20 / 800)
    assert values["fibre_share"][0] == 1.2 and values["fibre_share"][1][0] > 195


@pytest.mark.parametrize("options", [{"crumpled": 0.019}, {"crumpled": 0.12, "spatial": False}])
def test_what_is_not_shortened_is_not_told_of(options):
    """Yarns that are hardly shortened, and a plane sheet, which can't fold."""
    assert not fabric_doubts(sheared(**options))


@pytest.mark.mpi
@pytest.mark.parametrize("nx", [20, 44])
def test_a_yarn_loses_its_shortening_times_its_length(nx):
    """Of 200 mm along x and 100 mm along y."""
    result = sheared(nx=nx)
    y = result.scene.blank.midpoints()[1]
    result.fields["shortening_a"][:] = 0.01 * (abs(y - 30) < 20)
    result.fields["shortening_b"][:] = 0.0
    assert found(result)["excess_length_mm"] == pytest.approx(2.0, rel=0.1)
    result.fields["shortening_b"][:] = 0.03
    assert found(result)["excess_length_mm"] == pytest.approx(3.0, rel=0.1)


def test_sheets_without_yarns_are_not_asked():
    result = sheared(crumpled=0.12, names=("metal", "fabric"))
    for values in result.fields.values():
        values[result.scene.blank.part("metal").cells] = np.nan
    (other, *_), (words, *_) = fabric_doubts(result)
    assert "cells of fabric crumple" in words and "shortens yarns of fabric" in other
    assert not fabric_doubts(Result({}, [], Fields({}), None, result.scene))
    assert COMM.allreduce(len(words)) == COMM.size * len(words)
