"""Numbers of the summary from fields that are known, on cells of unequal area."""

from types import SimpleNamespace

import numpy as np
import pytest
from builders import COMM, Elastic, sheet
from formed_plies import halves
from made_results import made, strip
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.energy.output import Fields
from fabric_fenicsx.results import quantities

SHEAR = -0.9, 0.1, 0.2, 0.3, 0.4, 0.6
SHORT = (0.0099, 0, 0.0199, 0, 0.0499, 0), (0, 0.0101, 0, 0.0201, 0, 0.0501)


def fabric(blank=None, shear=SHEAR, short=SHORT, **more):
    more |= {"shear_angle": shear, "shortening_a": short[0], "shortening_b": short[1]}
    return made(blank, **more)


def twice_mean(cell):
    """Of the shear angle: of means of neighbours by area at edges, and then of a cell's edges."""
    values, areas = np.array(SHEAR), 2.0 ** np.arange(6)
    for _ in range(2):
        edges = np.convolve(areas * values, (1, 1)) / np.convolve(areas, (1, 1))
        values = (edges[1:] + edges[:-1]) / 2
    return values[cell]


def test_numbers_of_fabric_are_those_of_its_area():
    """Weights are 1, 2, 4, 8, 16, 32 of 63; 99 %, 62.37 of them, lie between the middles of those
    of 0.6 rad, 46, and of 0.9 rad, 62.5."""
    result = fabric(
        log_eps_11=(-0.11, 0.02, 0.03, 0, 0, 0.01),
        log_eps_22=(0.04, -0.2, 0, 0.01, 0, 0),
        stability_ellipticity=(0.3, -0.2, 0.5, -0.1, 0.0, 0.4),
        strain_state=(1, 2, 3, 4, 1, 2),
        thickness_under_pressure=(np.nan, 0.4, 0.3, 0.5, 0.6, np.nan),
        fibre_volume_fraction=(np.nan, 0.4, 0.3, 0.5, 0.45, np.nan),
    )
    result.scene.blank.u.x.array.reshape(-1, 3)[:] = 1.0, 2.0, 3.0
    found = quantities.fabric_quantities(result, [result.scene.blank.whole])
    states = found.pop("share_of_state_1_to_4")
    assert states == pytest.approx([17 / 63, 34 / 63, 4 / 63, 8 / 63])
    assert found.pop("excess_length_mm") > 0
    assert found == {
        "shear_angle_deg": pytest.approx((-51.566202, 34.377468)),
        "shear_angle_max_deg": pytest.approx(51.566202),
        "shear_angle_max_at_mm": [0.5, 5.0],
        "shear_angle_max_formed_at_mm": [1.5, 7.0, 3.0],
        "shear_angle_99_percent_deg": pytest.approx(34.377468 + 17.188734 * 16.37 / 16.5),
        "shear_angle_99_percent_of_means_deg": pytest.approx(np.degrees(twice_mean(5))),
        "shortening_at_shear_angle_max": 0.0099,
        "shortening_max": 0.0501,
        "shortening_max_at_mm": [47.0, 5.0],
        "shortening_max_formed_at_mm": [48.0, 7.0, 3.0],
        "shortened_by_1_percent_share": pytest.approx(62 / 63),
        "shortened_by_2_percent_share": pytest.approx(56 / 63),
        "shortened_by_5_percent_share": pytest.approx(32 / 63),
        "log_eps_11": (-0.11, 0.03),
        "log_eps_22": (-0.2, 0.04),
        "stability_ellipticity_min": -0.2,
        "cells_that_lost_ellipticity": 2,
        "thickness_min_mm": 0.3,
        "fibre_volume_fraction_max": 0.5,
    }
    del result.fields["thickness_under_pressure"]
    result.fields["fibre_volume_fraction"][:] = np.nan
    found = quantities.fabric_quantities(result, [result.scene.blank.whole])
    assert found["thickness_min_mm"] is None and found["fibre_volume_fraction_max"] is None


def test_numbers_of_metal_are_over_its_own_thickness():
    """The lower sheet of 0.5 mm is thinner by a fifth, the upper one of 1 mm by 0.15."""
    stack = ff.Stack([(strip((1, 2)), 0.5, "lower"), (strip((1, 2)), 1.0, "upper")])
    result = made(
        stack,
        metal_thickness=(0.4, 0.51, 0.85, 1.02),
        equivalent_plastic_strain=(0.1, 0.2, 0.3, 0.0),
        von_mises_top=(100, 250, 120, 130),
        von_mises_bottom=(90, 110, 280, np.nan),
    )
    assert quantities.metal_quantities(result, list(stack.parts.values())) == {
        "plastic_strain_max": 0.3,
        "thinning_max": pytest.approx(0.2),
        "thickness_mm": (0.4, 1.02),
        "von_mises_max_MPa": 280.0,
    }
    upper = quantities.metal_quantities(result, [stack.parts["upper"]])
    assert upper["thinning_max"] == pytest.approx(0.15) and upper["thickness_mm"] == (0.85, 1.02)


def test_shapes_of_a_stack_are_the_largest_of_its_plies():
    waves = {"height_mm": 1.0, "ripples_mm": 0.5, "rim_mm": 3.0, "folds": 2, "height_rms_mm": 0.3}
    plies = {"lower": {"draw_in": {"largest_mm": 2.0, "corner_mm": 9.0}, "wrinkles": waves}}
    others = waves | {"height_mm": 0.8, "ripples_mm": 0.7, "folds": 4}
    plies["upper"] = {"draw_in": {"largest_mm": 1.5}, "wrinkles": others}
    assert quantities.stack_quantities(None, plies, [], []) == {
        "draw_in": {"largest_mm": 2.0},
        "wrinkles": {"height_mm": 1.0, "ripples_mm": 0.7, "rim_mm": 3.0, "folds": 4},
    }
    plies["lower"]["wrinkles"] = None
    assert quantities.stack_quantities(None, plies, [], [])["wrinkles"] is None


def test_the_middle_sheet_is_fabric_between_metal():
    sheets = [SimpleNamespace(name=k, fabric=k != "m", metal=k == "m") for k in "mabcm"]
    assert quantities.middle_of(sheets) == "b" and quantities.middle_of(sheets[1:]) == ""
    assert quantities.middle_of(sheets[:2]) == quantities.middle_of(sheets[::2][:2]) == ""


def test_shear_of_the_middle_ply():
    """Means at nodes are -0.5, -0.35 and 0.1 rad, so cells of -0.5 and 0.1 are 0.1 and 0.3 off the
    means about them; most on the path is at its beginning, 2/9 of the way from -0.35 to -0.5."""
    grid = halves(shear_angle=[-0.5, 0.1], log_eps_11=[0, 0], log_eps_22=[0, 0])
    result = SimpleNamespace(grids={"b": grid}, scene=SimpleNamespace(comm=MPI.COMM_SELF))
    found = quantities.middle_quantities(result, "b")
    on_path = np.degrees(0.35 + 0.15 * 2 / 9)
    assert found["shear_angle_on_45_deg_path_deg"] == pytest.approx(on_path, rel=1e-6)
    assert found["shear_contrast_deg"] == pytest.approx(np.degrees(np.sqrt(0.05)))


@pytest.mark.mpi
@pytest.mark.parametrize("nx", [20, 44])
def test_a_yarn_loses_its_shortening_times_its_length(nx):
    """Of 200 mm along x and 100 mm along y, of the part that loses most."""
    blank = sheet(200.0, 100.0, nx, nx // 2, spatial=True)
    blank.divide({"left": lambda x: x[0] < 120}, rest="right")
    x, y = blank.midpoints()[:2]
    result = ff.Result({}, [], Fields({}), None, ff.Scene(blank, [Elastic()]))
    result.fields |= {"shortening_a": 0.01 * (abs(y - 30) < 20), "shortening_b": 0 * y}
    whole, parts = [blank.whole], list(blank.parts.values())
    found = [quantities.shortening_quantities(result, of) for of in (whole, parts)]
    result.fields["shortening_b"][:] = 0.03 * (abs(x - 160) < 25)
    found.append(quantities.shortening_quantities(result, whole))
    lost = [each["excess_length_mm"] for each in found]
    assert lost == pytest.approx([2.0, 1.2, 3.0], rel=0.02)


@pytest.mark.mpi
def test_of_several_plies_and_of_places_that_mirror_each_other_the_first_is_named():
    blank = sheet(200.0, 100.0, 20, 10, spatial=True)
    blank.divide({"left": lambda x: x[0] < 100}, rest="right")
    x = abs(blank.midpoints()[0] - 100)
    result = ff.Result({}, [], Fields({}), None, ff.Scene(blank, [Elastic()]))
    result.fields |= {"shear_angle": -x, "shortening_a": 0 * x, "shortening_b": x / 1000}
    parts = list(blank.parts.values())
    for name in ("shear_angle", "shortening"):
        found = quantities.shear_quantities(result, parts)
        found |= quantities.shortening_quantities(result, parts)
        assert found[f"{name}_max_at_mm"] == pytest.approx([5 / 3, 5])
        assert found[f"{name}_max_in"] == "left"


def test_what_limits_ask_for_is_known_with_its_place():
    """Shear of one cell and of 99 % of the area, what 5 % shorten, and fibres of one cell."""
    result = fabric(fibre_volume_fraction=(np.nan, np.nan, 1.2, 0.5, 0.5, 0.6))
    ((name, values),) = quantities.limited(result)
    first, last = [0.5, 5.0], [47.0, 5.0]
    assert name == "" and values == {
        "shear": (pytest.approx(51.566202), first),
        "shear_99_percent": (pytest.approx(34.377468 + 17.188734 * 16.37 / 16.5), first),
        "shortening": (pytest.approx(32 / 63), last),
        "fibre_share": (1.2, [5.0, 5.0]),
    }


@pytest.mark.parametrize(
    "there, share, crumpled", [(0.0501, 0.0, True), (0.0499, 0.0099, False), (0.0, 0.0101, True)]
)
def test_cells_crumple_from_5_percent_on_there_or_in_1_percent_of_the_area(there, share, crumpled):
    found = {"shortening_at_shear_angle_max": there, "shortened_by_5_percent_share": share}
    assert quantities.crumples(found) == crumpled


@pytest.mark.parametrize("length, told", [(1.02, True), (0.98, False)])
def test_yarns_shortened_by_2_percent_in_1_percent_of_the_area_are_told_of(length, told):
    ply = fabric(strip((length, 100 - length)), (0, 0), ((0.0201, 0.0199), (0, 0)))
    doubts = quantities.fabric_doubts(ply)
    assert bool(doubts) == told
    plane = fabric(strip((2, 98), spatial=False), (0, 0), ((0.06, 0), (0, 0)))
    assert not quantities.fabric_doubts(plane)  # it can't fold


def test_sheets_without_yarns_are_not_asked():
    blank = sheet(40, 20, 4, 2, spatial=True)
    blank.divide({"metal": lambda x: x[0] < 20}, rest="fabric")
    values = np.where(blank.midpoints()[0] < 20, np.nan, 0.12)
    result = ff.Result({}, [], Fields({}), None, ff.Scene(blank, [Elastic()]))
    result.fields |= dict.fromkeys(("shear_angle", "shortening_a", "shortening_b"), values)
    (other, *_), (words, *_) = quantities.fabric_doubts(result)
    assert "cells of fabric crumple" in words and "yarns of fabric are shortened" in other
    assert not quantities.fabric_doubts(ff.Result({}, [], Fields({}), None, result.scene))
    assert COMM.allreduce(len(words)) == COMM.size * len(words)


@pytest.mark.parametrize("length, told", [(58.0, 0), (62.0, 1)])
def test_waves_longer_than_60_mm_are_told_before_the_run(length, told):
    """Euler's 2 pi sqrt(D / P) at 2 % of shortening, P = 2 d t eps, of the stiffer yarns."""
    D = (length / 2 / np.pi) ** 2 * 2 * 0.65 * 0.02
    terms = [ff.Membrane(ff.load("komeili")), ff.Bending(D_a=0.1 * D, D_b=D)]
    scene = ff.Scene(sheet(20, 10, 2, 1, spatial=True), terms)
    found = quantities.shortest_wave_of(scene, scene.blank.whole)
    assert found == pytest.approx(length, rel=0.02)
    assert len(quantities.waves_that_do_not_form(scene)) == told
