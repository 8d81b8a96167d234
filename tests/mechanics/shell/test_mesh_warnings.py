"""What is doubted of a sheet, and what is not."""

import math
import re

import builders
import numpy as np
import pytest
from builders import alone, march
from mpi4py import MPI
from scipy.optimize import brentq

import fabric_fenicsx as ff
from fabric_fenicsx.mechanics.shell.membrane_warnings import (
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
    "size, doubted",
    [((20.1, 10), False), ((19.9, 2.0), True), ((9_990, 50), False), ((10_100, 5_000), True)],
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


LINEAR = ff.load("fabric").replace(a=0.0, s1=0.025, s2=0.0, s3=0.0)
# element, integration, share of the energy from which cells are doubted, and what a strip's force
# is then too high by, over that share
DOUBTED = [("P1", "full", 2.5e-3, 12), ("P2", "full", 0.01, 6), ("P2", "inner", 0.03, 4)]


def alternating(element, integration):
    """Membrane of cells of two sizes, and a function of the size of displacements to and fro [mm]
    and of a strain all over, which moves it so, to the share of the energy that goes when stretches
    are means at nodes, by area, and then of a cell's nodes, and to the energy."""
    X = np.array([[x, y, 0] for y in (0.0, 10.0) for x in (0.0, 4.0, 20.0)])
    cells = np.array([[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4]])
    degree = int(element[1])
    blank = ff.Blank.from_arrays(COMM, X, cells, "triangle", degree=degree, a=0.5)
    membrane = alone(blank, ff.Membrane(LINEAR, integration=integration))
    # each cell's nodes, in the middle of an edge by its ends
    ends = [
        c + [(c[i], c[j]) for i, j in ((0, 1), (1, 2), (2, 0))] * (degree > 1)
        for c in cells.tolist()
    ]
    names = [[tuple(sorted(np.atleast_1d(n))) for n in each] for each in ends]
    area = 20.0, 20.0, 80.0, 80.0
    yarn = lambda e: (667.5 if e > 0 else 0.65) * e**2  # noqa: E731
    u = np.array([[0, 0], [1, 0.3], [-0.4, 1], [0.2, -1], [-1, 0.5], [0.7, -0.2]])
    yarns = np.array([[np.cos(0.5), np.sin(0.5)], [-np.sin(0.5), np.cos(0.5)]])

    def made(size, strain=0.01):
        x = (1 + strain) * X[:, :2] + size * u
        places = {(k,): x[k] for k in range(6)}
        if degree > 1:
            places |= {n: x[list(n)].mean(0) for each in names for n in each}
        flat = {n: X[list(n), :2].mean(0) for n in places}
        for k, at in enumerate(blank.coordinates()[:, :2]):
            n = min(flat, key=lambda n: np.linalg.norm(flat[n] - at))
            blank.u.x.array[2 * k : 2 * k + 2] = places[n] - at
        stretch, shear = [], []
        for c in cells:
            old, new = ((v[c[1:], :2] - v[c[0], :2]).T for v in (X, x))
            fa, fb = (
                new @ np.linalg.inv(old) @ yarns.T[:, 0],
                new @ np.linalg.inv(old) @ yarns.T[:, 1],
            )
            stretch.append([np.linalg.norm(fa), np.linalg.norm(fb)])
            shear.append(0.025 / 2 * np.arcsin(fa @ fb / np.prod(stretch[-1])) ** 2)
        at_node = {}
        for own, each, A in zip(names, stretch, area):
            for n in own:
                at_node.setdefault(n, []).append([A, *np.multiply(A, each)])
        mean = {n: np.sum(v, 0)[1:] / np.sum(v, 0)[0] for n, v in at_node.items()}
        smooth = [np.mean([mean[n] for n in own], 0) for own in names]
        whole, less = (
            np.dot(area, [s + sum(yarn(l - 1) for l in two) for s, two in zip(shear, each)])
            for each in (stretch, smooth)
        )
        return 1 - less / whole, whole

    return membrane, made


@pytest.mark.parametrize("element, integration, least, excess", DOUBTED)
def test_cells_that_stretch_yarns_to_and_fro_are_doubted(element, integration, least, excess):
    """From a share of the energy on, and by so much too high a force."""
    membrane, made = alternating(element, integration)
    for share, told in ((0.98 * least, 0), (1.02 * least, 1), (2 * least, 1), (0.26, 1)):
        size = brentq(lambda size: made(size)[0] - share, 0.0, 1.0)  # noqa: B023
        made(size)
        assert alternating_energy(membrane) == pytest.approx(share, rel=1e-6)
        warning = locking_warning(membrane)
        assert bool(warning) == told
    assert "forces say nothing" in warning
    made(brentq(lambda size: made(size)[0] - 2 * least, 0.0, 1.0))
    assert f"about {200 * excess * least:.2g} % too high" in locking_warning(membrane)


@pytest.mark.parametrize("strain, told", [(0.97e-4, False), (1.03e-4, True)])
def test_a_sheet_that_hardly_strains_is_not_doubted(strain, told):
    """As one pressed flat between planes, whose strains are those of rounding and of its cells:
    with the energy of one yarn strained by 1e-4 all over, 667.5 MPa 1e-8."""
    membrane, made = alternating("P1", "full")
    size = brentq(lambda size: made(size, 0.0)[1] - 667.5 * strain**2 * 200, 0.0, 1.0)
    made(size, 0.0)
    assert alternating_energy(membrane) > 0.1
    assert bool(locking_warning(membrane)) == told


# element, angle, strain, pattern, nx, and how much too high the force is: against P3 on fine cells
# with edges on the corners' yarns
EXCESS = [("P2", 45, 0.1, "left", 8, 0.46), ("Q2", 45, 0.1, "crossed", 16, 0.27)]


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


@pytest.mark.mpi
@pytest.mark.parametrize(
    "width, told", [(0.0, ""), (0.9, ""), (1.1, "in 1.1 % of blank, as at (0.")]
)
def test_where_the_law_allows_bands(width, told):
    """Yarns a are compressed in the first mm of 100, and the sheet is stretched beside it."""

    def shape(x):
        return np.column_stack([np.interp(x[:, 0], [0, 50, 100], [0, width or 50, 100]), x[:, 1:]])

    membrane = alone(builders.sheet(100, 20, 2, 2, shape=shape), ff.Membrane(KOMEILI))
    x = membrane.blank.coordinates()[:, 0]
    membrane.blank.u.x.array[::2] = np.where(x <= width, -0.02 * x, 0.001 * x - 0.021 * width)
    said = band_warning(membrane)
    assert said.startswith(told) and bool(said) == bool(told)
