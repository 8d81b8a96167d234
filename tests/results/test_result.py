"""What a result tells of a scene of one's own."""

import numpy as np
import pytest
from builders import Elastic, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.results.fields import FieldSeries

SIZES = np.array([45.0, 40.0, 0.0])
SHRINK = np.array([0.02, 0.1, 0.0])  # along x and y
QUARTER = [ff.Support(f"x{i} = 0", lambda x, i=i: x[i] < 1e-6, (i,)) for i in (0, 1)]


@pytest.mark.mpi
@pytest.mark.parametrize(
    "supports, share, about",
    [
        (QUARTER, 1.0, 0 * SIZES),
        (ff.clamped_ends(), 0.5, SIZES / 2),
        (QUARTER[:1], np.array([1.0, 0.5]), SIZES * [0, 0.5, 0]),
    ],
)
def test_draw_in_of_a_scene_of_ones_own(folder, supports, share, about):
    """That shrinks about a place, of a whole sheet that lies anywhere, a half or a quarter: clamps
    at x = 0 are no plane of symmetry, whose edge does not count."""
    blank = ff.Blank.rectangle(*SIZES[:2], nx=6, ny=6, spatial=True)
    scene = ff.Scene(blank, [Elastic()], supports)
    blank.u.x.array[:] = (-SHRINK * (blank.coordinates() - about)).ravel()
    folder.mkdir(exist_ok=True)
    FieldSeries(folder, scene).write(1.0)
    found = ff.Result({}, [], {}, folder, scene).draw_in()
    assert len(found.pop("largest_at_mm")) == 2
    x, y = share * (SHRINK * SIZES)[:2]
    long, short = (y, x) if (share * SIZES[:2]).argmax() == 0 else (x, y)
    corner = (x + y) / np.sqrt(2)
    both = [(axis, way) for axis, way, part in zip("xy", (x, y), share * np.ones(2)) if part == 0.5]
    assert found == pytest.approx(
        {
            "middle_of_long_side_mm": long,
            "middle_of_short_side_mm": short,
            "corner_mm": corner,
            "largest_mm": max(x, y, corner),
            **{f"middle_at_{end}_{axis}_mm": way for axis, way in both for end in ("low", "high")},
        },
        abs=1e-5,  # files have single precision
    )


def test_draw_in_of_a_sheet_that_is_not_flat_is_refused(folder):
    def shape(x):
        return x + x[:, :1] * [0, 0, 0.01]

    scene = ff.Scene(sheet(45, 40, 3, 3, shape=shape, spatial=True), [Elastic()])
    with pytest.raises(ff.InputError, match="0.45 mm apart along z; draw-in needs a sheet"):
        ff.Result({}, [], {}, folder, scene).draw_in()
