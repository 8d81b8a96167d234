"""Blanks with an outline of their own."""

import numpy as np
import pytest
from builders import COMM

import fabric_fenicsx as ff

RINGS = [(100, 50), (300, 50), (300, 200), (100, 200)], [(150, 100), (200, 100), (200, 150)]
AREA = 200 * 150 - 50 * 50 / 2


@pytest.fixture
def table(shared_path):
    """A file of `RINGS`."""
    path = shared_path / "ply.csv"
    if COMM.rank == 0:
        rings = ("\n".join(f"{x},{y}" for x, y in ring) for ring in RINGS)
        path.write_text("x,y\n" + "\n\n".join(rings))
    COMM.barrier()
    return path


@pytest.mark.mpi
@pytest.mark.parametrize("pattern", ["unstructured", "along"])
def test_a_sheet_has_its_holes_place_and_yarns(table, pattern):
    made = {"size": 10.0, "pattern": pattern, "fibre_angle": 30}
    for outline in table, RINGS:
        blank = ff.Blank.outline(outline, **made)
        assert COMM.allreduce(blank.areas().sum()) == pytest.approx(AREA)
        assert np.ravel(blank.extent()) == pytest.approx([100, 50, 300, 200])
        assert blank.straight[0] == pytest.approx([np.cos(np.pi / 6), 0.5])
        assert blank.degree == 2 and blank.from_file and not blank.warnings


@pytest.mark.mpi
def test_errors_reach_all_ranks(table):
    crossed = [[(0, 0), (100, 80), (100, 0), (0, 80)]]
    with pytest.raises(ff.InputError, match="bounds no sheet: self-intersect"):
        ff.Blank.outline(crossed)
    for wrong in ({"element": "Q1"}, {"pattern": "crossed"}):
        with pytest.raises(ff.InputError, match=f"`{[*wrong][0]}` is .*; allowed for an outline"):
            ff.Blank.outline(table, **wrong)
