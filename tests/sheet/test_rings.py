"""Rings of lines, and the sheets that they bound."""

import numpy as np
import pytest
import shapely

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.io.rings import centred, joined, mirrored_half, sheet_of


def box(left, right):
    return shapely.box(left, -50, right, 50)


@pytest.mark.parametrize("gap, closes", [(0.009, True), (0.011, False)])
def test_ends_meet_up_to_a_ten_thousandth_of_the_extent(gap, closes):
    lines = [[(0, 0), (100 - gap, 0)], [(100, 0), (100, 50)], [(0, 0), (0, 50), (100, 50)]]
    lines = [np.array(line, float) for line in lines]
    if closes:
        assert shapely.Polygon(joined(lines, "it")[0]).area == pytest.approx(5000, rel=1e-4)
    else:
        with pytest.raises(InputError, match="is open at .* 0.011 mm away.* up to 0.01 mm apart"):
            joined(lines, "it")


def test_the_ring_of_the_largest_area_is_the_outline():
    x = np.repeat(np.linspace(10, 90, 33), 2)  # in and out along a hole, of a longer ring
    teeth = np.column_stack([x, 20 + 50 * (np.arange(66) % 4 // 2)])
    hole = np.vstack([teeth, [[90, 10], [10, 10]]])
    frame = np.array([(0, 0), (100, 0), (100, 80), (0, 80)], float)
    assert shapely.LineString(hole).length > 4 * 90
    sheet = sheet_of([hole, frame], "it")
    assert sheet.area == pytest.approx(8000 - shapely.Polygon(hole).area)
    assert len(sheet.interiors) == 1


def test_the_middle_of_the_extent_is_centred():
    assert centred(shapely.Polygon([(0, 0), (4, 0), (0, 2)])).bounds == (-2, -1, 2, 1)


@pytest.mark.parametrize(
    "sheet, half",
    [
        (box(-100, 100), 0),
        (box(-100, 100.39), 0),  # up to twice 0.001 of the extent, from both sides
        (box(-100, 100.41), None),
        (box(-0.09, 100), -0.09),  # begins at the plane
        (box(-0.11, 100), None),
    ],
)
def test_half_of_a_sheet_that_is_its_own_mirror_image(sheet, half):
    if half is None:
        with pytest.raises(InputError, match="is not its own mirror image in x = 0: .* mm2 differ"):
            mirrored_half(sheet, 0, "it")
    else:
        bounds = mirrored_half(sheet, 0, "it").bounds
        assert bounds == pytest.approx((half, -50, sheet.bounds[2], 50))
        turned = shapely.transform(sheet, lambda x: x[:, ::-1])
        assert mirrored_half(turned, 1, "it").bounds[1] == pytest.approx(half)
