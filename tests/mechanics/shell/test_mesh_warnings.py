"""What is doubted of a sheet, and what is not."""

import math
import re

import builders
import numpy as np
import pytest
from builders import alone, march
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.mechanics.shell.membrane_warnings import (
    LOCKED,
    alternating_energy,
    band_warning,
    locking_warning,
)
from fabric_fenicsx.mechanics.shell.mesh_warnings import size_warning
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.solve.newton import Newton

COMM = MPI.COMM_WORLD
KOMEILI = ff.load("komeili")


def sheet(
    length, width, nx=8, ny=2, pattern="crossed", cell="triangle", angle=0.0, comm=COMM, **options
):
    options["a"] = math.radians(angle)
    return builders.sheet(length, width, nx, ny, pattern, comm, cell=cell, **options)


@pytest.mark.parametrize(
    "size, doubted", [((30, 10), False), ((7.9, 2.0), True), ((200_000, 50_000), True)]
)
def test_a_size_that_speaks_of_other_units_is_doubted(size, doubted):
    told = f"s.msh is {size[0]:g} x {size[1]:g} mm; lengths are in mm"
    assert size_warning(sheet(*size), "s.msh").startswith(told) == doubted


FOLLOW = [
    ("crossed", "triangle", 0, 0.0),
    ("crossed", "triangle", 45, 0.0),
    ("crossed", "triangle", 30, 1.0),
    ("crossed", "triangle", 43, 1.0),
    ("left", "triangle", 0, 0.0),
    ("left", "triangle", 45, 1.0),
    ("crossed", "quadrilateral", 0, 0.0),
    ("crossed", "quadrilateral", 45, 1.0),
]


@pytest.mark.parametrize("pattern, cell, angle, off", FOLLOW)
def test_cells_that_follow_the_yarns(pattern, cell, angle, off):
    blank = sheet(40, 20, 8, 4, pattern, cell, angle, spatial=angle > 40)
    assert blank.whole.share_off_the_yarns() == off


@pytest.mark.mpi
def test_some_cells_follow_the_yarns():
    """Yarns along the edges up to the middle of the sheet only; the column behind it shares
    nodes."""
    arrays = specimen(40, 20, 8, 4, "left") if COMM.rank == 0 else (None,) * 3
    blank = ff.Blank.from_arrays(COMM, *arrays, a=lambda x: np.where(x[0] < 20, 0.0, 0.5))
    assert blank.whole.share_off_the_yarns() == 24 / 64


def pulled(angle, strain, comm=COMM, **options):
    blank = sheet(
        200, 50, options.pop("nx", 32), options.pop("ny", 8), angle=angle, comm=comm, **options
    )
    membrane = ff.Membrane(KOMEILI)
    scene = ff.Scene(blank, [membrane], ff.clamped_ends(strain * 200))
    assert not march(Newton(scene), steps=3, path_tolerance=1e-2).reason
    return membrane


# pattern, cell, angle of the yarns, strain: against P2, P3 or --pattern yarns the reaction is this
# much too high
LOCKING = [
    ("left", "triangle", 45, 0.1, "50 %"),
    ("crossed", "triangle", 30, 0.03, "14 %"),
    ("crossed", "quadrilateral", 45, 0.1, "70 %"),
    ("crossed", "triangle", 45, 0.1, ""),
    ("crossed", "quadrilateral", 0, 0.03, ""),
]


@pytest.mark.versions
@pytest.mark.parametrize("pattern, cell, angle, strain, error", LOCKING)
def test_locking_is_told_where_it_happens(pattern, cell, angle, strain, error):
    membrane = pulled(angle, strain, pattern=pattern, cell=cell)
    assert (alternating_energy(membrane) > LOCKED) == bool(error)
    warning = locking_warning(membrane)
    assert bool(warning) == bool(error)
    if error:
        assert warning.startswith("100 % of the linear cells")
        assert '`integration="inner"`' in warning and "pattern=" in warning
        membrane.blank.from_file = True  # whose cells no pattern changes
        assert "pattern=" not in locking_warning(membrane)


# element, angle, strain, pattern, nx, and how much too high the force is: against P3 on fine cells
# with edges on the corners' yarns
EXCESS = [
    ("P1", 45, 0.1, "left", 32, 1.18),
    ("Q1", 30, 0.1, "crossed", 64, 0.92),
    ("P2", 20, 0.03, "crossed", 12, 1.03),
    ("P2", 45, 0.1, "left", 8, 0.46),
    ("Q2", 45, 0.1, "crossed", 16, 0.27),
]


@pytest.mark.parametrize("element, angle, strain, pattern, nx, excess", EXCESS)
def test_what_locks_says_by_how_much(element, angle, strain, pattern, nx, excess):
    """Within a factor of two, on any element and pattern."""
    blank = ff.Blank.rectangle(
        200, 50, nx=nx, ny=nx // 4, pattern=pattern, element=element, fibre_angle=angle
    )
    membrane = ff.Membrane(KOMEILI)
    supports = ff.clamped_ends(strain * 200)
    march(Newton(ff.Scene(blank, [membrane], supports)), steps=4, path_tolerance=1e-2)
    told = re.search(r"about ([\d.]+) % too high", locking_warning(membrane))
    assert excess / 2 <= float(told[1]) / 100 <= 2 * excess


@pytest.mark.parametrize("size, told", [(2e-5, False), (2e-2, True)])
def test_a_sheet_that_hardly_strains_is_not_doubted(size, told):
    """As one pressed flat between planes, whose strains are those of rounding and of its cells."""
    blank = sheet(40, 20, 8, 4, "left", angle=30)
    membrane = alone(blank, ff.Membrane(KOMEILI))
    blank.u.x.array[:] = size * np.cos(7.0 * np.arange(len(blank.u.x.array)))
    assert alternating_energy(membrane) > LOCKED
    assert bool(locking_warning(membrane)) == told


def test_quadratic_cells_at_45_deg_are_not_doubted():
    assert locking_warning(pulled(45, 0.02, pattern="crossed", nx=16, ny=4, degree=2)) == ""


@pytest.mark.mpi
@pytest.mark.parametrize("share, words", [(0.0, ""), (0.25, "in 25 % of blank, as at (")])
def test_where_the_law_allows_bands(share, words):
    """Yarns a are compressed in a part of the length, and the sheet is stretched beside it."""
    membrane = alone(sheet(80, 20, 16, 4), ff.Membrane(KOMEILI))
    x = membrane.blank.coordinates()[:, 0]
    membrane.blank.u.x.array[::2] = np.where(x < 80 * share, -0.02 * x, 0.001 * x - 1.68 * share)
    said = band_warning(membrane)
    assert said.startswith(words) and bool(said) == bool(share)
