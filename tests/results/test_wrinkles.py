"""Wrinkles of formed plies whose waves are known."""

import numpy as np
import pytest
from formed_plies import formed, halves

from fabric_fenicsx.results.wrinkles import HEIGHT, LENGTH, RIPPLE, SEEN, height_map, wrinkles
from fabric_fenicsx.surfaces.primitives import Cylinder, Plane

SIZE = {"length": 240.0, "width": 120.0}


def nowhere(x):
    return np.full(len(x), np.inf)


def over(*surfaces, thickness=0.0):
    return lambda x: np.min([s.evaluate(x).gap for s in surfaces], axis=0) - thickness / 2


def on(base, length, height=1.0, share=lambda x, y: 1.0):
    """A sine along x, normal to the surface base(x, y): places and normals (n, 3)."""

    def place(x, y):
        places, normals = base(x, y)
        wave = height * share(x, y) * np.sin(2 * np.pi * x / length)
        return places + wave[:, None] * np.array(normals)

    return place


def flat(x, y):
    return np.column_stack([x, y, 0 * x]), np.column_stack([0 * x, 0 * x, 1 + 0 * x])


def cylinder(radius, axis):
    """Bent about an axis: the waves' crests are along 1, y, or across."""

    def base(x, y):
        p, angle = (x, y / radius) if axis == 0 else (y, x / radius)
        out, up = np.sin(angle), np.cos(angle)
        places, normals = (p, radius * out, radius * up), (0 * p, out, up)
        return (np.stack(each, 1)[:, [axis, 1 - axis, 2]] for each in (places, normals))

    return base


def sphere(x, y, radius=100.0):
    r = np.maximum(np.hypot(x, y), 1e-9)
    out, up = np.sin(r / radius) / r, np.cos(r / radius)
    normal = np.column_stack([out * x, out * y, up])
    return radius * normal, normal


def bent(*radii, angle=1.05, wall=14.0):
    """A ply that turns along x by an angle about each radius in turn, this way and that."""

    def place(x, y):
        s = np.linspace(x.min(), x.max(), 20001)
        begins = np.cumsum([0.0, *(angle * r + wall for r in radii)])
        turns = [np.clip((s - at) / r, 0, angle) for r, at in zip(radii, begins)]
        turn = np.sum(turns[::2], 0) - np.sum(turns[1::2], 0)
        run = np.stack([np.cos(turn), np.sin(turn)], 1)
        sums = np.vstack([[0, 0], np.cumsum((run[1:] + run[:-1]) / 2 * (s[1] - s[0]), axis=0)])
        return np.column_stack([np.interp(x, s, sums[:, 0]), y, np.interp(x, s, sums[:, 1])])

    return place


def within(share, side=240.0):
    """1 in the middle of a ply, on a share of its area."""
    return lambda x, y: np.exp(-(((x * x + y * y) * np.pi / share / side**2) ** 2))


def at_edge(x, y):
    return np.exp(-(((75 - y) / 20) ** 2))


# place, wavelength and height that is found
TRUTHS = {f"{length} mm": (on(flat, length), length, 1.0) for length in (20, 40, 120)}
TRUTHS |= {f"R {r} axis {k}": (on(cylinder(r, k), 30), 30, 1.0) for r in (50, 200) for k in (0, 1)}
TRUTHS |= {"sphere": (on(sphere, 30), 30, 1.0), "edge": (on(flat, 30, share=at_edge), 30, 1.0)}
# two crests: a tenth is taken for shape
TRUTHS |= {"0.05 of area": (on(flat, 30, share=within(0.05)), 30, 0.9)}
TRUTHS |= {f"bend {r}": (bent(*r), 30, 0.0) for r in ((10,), (20,), (60,), (8, 8))}
TRUTHS |= {f"no waves on {r}": (on(cylinder(r, 1), 30, 0.0), 30, 0.0) for r in (50, 200)}
TRUTHS |= {"no waves": (on(sphere, 30, 0.0), 30, 0.0)}
TRUTHS |= {"hidden by the bend": (on(cylinder(50, 1), 30, 0.3), 30, 0.0)}


@pytest.mark.parametrize("name", TRUTHS)
def test_heights_of_known_waves(name):
    """Waves of eight cells, five or eight of them, are within 5 %; what bends one way has none, and
    hides a wave that bends less."""
    place, length, height = TRUTHS[name]
    pattern = ("crossed", "left", "right")[[*TRUTHS].index(name) % 3]
    count = 8 if "of area" in name else 5
    size = 8 * count, 8 * count, count * length, count * length
    found = wrinkles(height_map(formed(place, *size, full=True, pattern=pattern), nowhere))
    assert found["height_mm"] == pytest.approx(height, rel=0.05, abs=0.05 * (height == 0))
    if height and "of area" not in name:
        assert found["wavelength_mm"] == pytest.approx(length, rel=0.1)


def cosine(length):
    return lambda x, y: np.column_stack([x, y, np.cos(2 * np.pi * x / length)])


def test_ripples_are_no_wrinkles():
    """Waves that the fabric can't form, or cells can't make, have a number of their own."""
    size = {"nx": 32, "ny": 32, "length": 120.0, "width": 120.0, "full": True}
    law = wrinkles(height_map(formed(on(flat, 30.0), **size), nowhere, 36.0))
    cells = wrinkles(height_map(formed(cosine(7.5), **size), nowhere))
    assert law["height_mm"] < 0.05 and law["ripples_mm"] == pytest.approx(1, rel=0.05)
    # four times the mean edge of the cells, halves of diagonals of squares of 3.75 mm
    assert cells["seen_mm"][0] == pytest.approx(4 * 3.75 * (1 + np.sqrt(2)) / 3)
    assert law["seen_mm"] == pytest.approx([36.0, 40.0])
    assert cells["height_mm"] < 0.05 and cells["ripples_mm"] > 0.5


def test_waves_of_a_quarter_are_those_of_the_whole():
    """On a ply that is symmetric to both planes."""
    sizes = (48, 180.0, True), (24, 90.0, False)
    plies = (formed(cosine(30), n, n, s, s, full=full) for n, s, full in sizes)
    whole, quarter = (wrinkles(height_map(each, nowhere)) for each in plies)
    for name in ("height_mm", "height_rms_mm", "wavelength_mm", "cells_a_wave"):
        assert quarter[name] == pytest.approx(whole[name], rel=0.02)


def test_numbers_of_heights_that_are_known():
    """Of two triangles of 6 and 2 mm2: nodes have 8/3, 2, 8/3 and 2/3 mm2."""
    heights = halves(np.outer([0, 0.31, 0, 0.301], [0, 0, 1]))
    w, length = np.array([1, -2, 0, 0.5]), [10.0, 20, 30, 40]
    heights.point_data.update({HEIGHT: w, LENGTH: length, RIPPLE: [0.1, -0.7, 0, 0.2]})
    heights.field_data[SEEN] = [8.0, 50.0]
    mean = (8 / 3 * 10 + 8 * 20 + 1 / 6 * 40) / (8 / 3 + 8 + 1 / 6)
    found = wrinkles(heights)
    assert found.pop("seen_mm") == [8.0, 50.0] and found == pytest.approx(
        {
            "height_mm": 2.0,
            "height_rms_mm": np.sqrt((8 / 3 + 8 + 1 / 6) / 8),
            "wavelength_mm": mean,
            "cells_a_wave": mean / ((3 + 4 + 5 + 5 + 1 + np.sqrt(20)) / 6),
            "ripples_mm": 0.7,
            "rim_mm": 0.31,
            "folds": 2,
        }
    )
    for height, known in ((0.101, True), (0.099, False)):
        heights.point_data[HEIGHT] = height / 2 * w
        assert (wrinkles(heights)["wavelength_mm"] is not None) == known
    heights.point_data["u"] *= 0.96
    assert wrinkles(heights)["folds"] == 0  # of less than 0.3 mm


def test_what_lies_on_a_tool_or_between_tools_is_no_wrinkle():
    """Though the ply is bent about a small radius; between plates a wave is as high as they let."""
    grid = formed(bent(10.5, angle=1.5), 48, 12, **SIZE)
    on_bar = height_map(grid, over(Cylinder((0, 0, -10.5), (0, 1, 0), 10.0), thickness=1.0))
    assert abs(on_bar[HEIGHT][on_bar.points[:, 0] < 14]).max() < 1e-6
    waved = formed(on(flat, 30.0, 2.5), nx=48, ny=24, full=True, **SIZE)
    plates = over(Plane((0, 0, -2.5), (0, 0, 1)), Plane((0, 0, 2.5), (0, 0, -1)), thickness=1.0)
    assert wrinkles(height_map(waved, plates))["height_mm"] <= 2.0


def ring(lobes):
    """The map of a ply with a ring that stands out by 2 mm, and is shortened along its circles."""

    def place(x, y):
        r, angle = np.hypot(x, y), np.arctan2(y, x)
        z = np.exp(-(((r - 60) / 10) ** 2)) * (2 + lobes * np.cos(12 * angle))
        share = 1 - 3 * (1 - np.exp(-((r / 20) ** 2))) / np.maximum(r, 1e-9)  # drawn in by 3 mm
        return np.column_stack([share * x, share * y, z])

    return height_map(formed(place, nx=20, ny=20, length=120.0, width=120.0), nowhere)


def test_what_bridges_two_tools_all_round_is_shape():
    """It is the same along the circles; waves along these are wrinkles."""
    assert wrinkles(ring(0.0))["height_mm"] < 0.05
    assert 0.8 < wrinkles(ring(1.0))["height_mm"] < 1.4


@pytest.mark.parametrize("full", [True, False])
def test_folds_of_the_rim(full):
    """Eight around a ply whose rim waves by 3 mm up and down; a dip of 0.2 mm, as on a plane of
    symmetry, makes no two of one."""

    def lobes(x, y):
        angle = np.arctan2(y, x)
        z = 3 * np.cos(8 * angle) - 0.2 * np.exp(-((angle / 0.03) ** 2))
        return np.column_stack([x, y, z * np.minimum(np.hypot(x, y) / 100, 1)])

    n = 40 if full else 20
    grid = formed(lobes, nx=n, ny=n, length=240.0, width=240.0, full=full)
    found = wrinkles(height_map(grid, nowhere))
    assert found["folds"] == 8
    assert found["rim_mm"] == pytest.approx(6, rel=0.01)


def test_the_rim_is_the_outer_edge_of_a_ply_with_a_hole():
    """The hole's edge rises by 9 mm from one end to the other, the outer one by 2 mm."""
    grid = formed(lambda x, y: np.column_stack([x, y, 0 * x]), 12, 8, 240.0, 160.0, full=True)
    x = grid.cell_centers().points
    grid = grid.extract_cells(np.flatnonzero(abs(x[:, :2]).max(1) > 40.0))
    at = grid.points
    inside = abs(at[:, :2]).max(1) < 45.0
    u = np.zeros_like(at)
    u[:, 2] = np.where(inside, 9 * at[:, 0] / 80, 2 * at[:, 0] / 240)
    grid.point_data["u"] = u
    assert wrinkles(height_map(grid, nowhere))["rim_mm"] == pytest.approx(2.0, rel=1e-6)
