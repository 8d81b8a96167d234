"""Thickness under pressure and fibre volume fraction, as fields of plies."""

import math

import numpy as np
import pytest
from builders import COMM, everywhere, run, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.results.quantities import limited
from fabric_fenicsx.scene import output as reports

FABRIC = ff.load("komeili").replace(fibre_density=2.5)
T = FABRIC.thickness_under(0.0)
PLAIN = ff.Support("plane", everywhere, (0, 1))
SHEAR = math.radians(40)


def rectangle(nx=4, ny=2, **options):
    return sheet(20, 10, nx, ny, spatial=True, **options)


def plates(gap, thickness=T):
    """Two plates around plies, the lowest at z = 0; the upper one closes to `gap`."""
    bottom = ff.Tool(ff.Plane((0, 0, -T / 2), (0, 0, 1)), name="bottom")
    path = lambda load: (0, 0, load * (gap - thickness))  # noqa: E731
    top = ff.Tool(ff.Plane((0, 0, thickness - T / 2), (0, 0, -1)), path=path, name="top")
    return ff.Contact(bottom), ff.Contact(top)


def uniform(values, expected, tolerance=1e-6):
    values = np.concatenate(COMM.allgather(values))
    assert values == pytest.approx(np.full(len(values), expected), rel=tolerance)


@pytest.mark.mpi
@pytest.mark.parametrize("cell", ["triangle", "quadrilateral"])
def test_a_ply_between_two_plates_is_as_thick_as_their_gap(cell):
    """So its fibres are that much denser, and the plates press as its compaction says."""
    gap, pair = 0.8, plates(0.8)
    scene = ff.Scene(rectangle(cell=cell), [*pair, ff.Membrane(FABRIC)], [PLAIN])  # in any order
    run(scene, 2)
    fields = reports.cell_fields(scene)
    uniform(fields["thickness_under_pressure"], gap)
    uniform(fields["compaction"], T - gap)
    uniform(fields["fibre_volume_fraction"], 0.75 / 2.5 * FABRIC.thickness / gap)
    assert (fields.units["compaction"], fields.units["fibre_volume_fraction"]) == ("mm", "-")
    for plate in pair:
        pressure = np.linalg.norm(plate.force()) / 200
        assert FABRIC.thickness_under(pressure) == pytest.approx(gap)
        assert plate.penetration() == 0.0 < plate.largest_depth()  # of what is not rigid


def test_more_fibres_than_fit_side_by_side_are_invalid():
    scene = ff.Scene(rectangle(), [ff.Membrane(FABRIC), *plates(0.25)], [PLAIN])
    run(scene, 4)
    [(_, values)] = limited(ff.Result({}, [], reports.cell_fields(scene), None, scene))
    most, _ = values["fibre_share"]
    assert most == pytest.approx(1.2) and ff.Limits().exceeded({"fibre_share": most})
    assert not ff.Limits().exceeded({"fibre_share": 0.9})


@pytest.mark.parametrize("metal_below", [False, True])
def test_each_of_two_sheets_loses_its_own_share(metal_below):
    """Pressed by dead pressure, of other fabrics and cells, or on metal, which loses none."""
    pressure, thin = 2.0, FABRIC.replace(thickness=0.3, compaction=ff.Compaction(8.0, 2e-3))
    lower = ff.load_metal("dc04") if metal_below else FABRIC
    t = [each.thickness_under(0.0) for each in (lower, thin)]
    stack = ff.Stack([(rectangle(5, 3), t[0], "a"), (rectangle(8, 4), t[1], "b")])
    layer = ff.SheetMetal(lower) if metal_below else ff.Membrane(FABRIC)
    terms = [layer.on("a"), ff.Membrane(thin).on("b"), ff.Bending(modulus=100.0).on("b")]
    table = ff.Contact(ff.Tool(ff.Plane((0, 0, -t[0] / 2), (0, 0, 1)), name="table"))
    grows = lambda load: pressure * load  # noqa: E731
    press = ff.BlankHolderPressure(grows, (0, 0, -1), lambda x: 0 * x[0] + 1).on("b")
    scene = ff.Scene(stack, [*terms, table, press, ff.SheetContact("a", "b", points=6)], [PLAIN])
    run(scene, 2)
    thickness = reports.cell_fields(scene)["thickness_under_pressure"]
    inner = np.flatnonzero((abs(stack.midpoints()[:2] - [[10], [5]]) < [[5], [2.5]]).all(0))
    for name, fabric in (("a", lower), ("b", thin)):
        cells = np.intersect1d(stack.part(name).cells, inner)
        if metal_below and name == "a":
            assert np.isnan(thickness[cells]).all()
        else:
            uniform(thickness[cells], fabric.thickness_under(pressure), 2e-3)


def sheared(x, load):
    """Yarns along y turn towards x by up to `SHEAR`, without stretch."""
    angle = load * SHEAR
    return np.array([np.sin(angle) * x[1], (np.cos(angle) - 1) * x[1]])


SHEARING = ff.Support("plane", everywhere, (0, 1), sheared)


@pytest.mark.mpi
@pytest.mark.parametrize("kind, thickening", [("P2", 0.0), ("P1", 1.0), ("quadrilateral", 1.0)])
def test_pressure_acts_on_the_area_that_shear_leaves(kind, thickening):
    """Between plates that close meanwhile; a ply that thickens has the fibre volume fraction of a
    flat one under that pressure."""
    share, gap = math.cos(SHEAR), 0.8
    fabric = FABRIC.replace(compaction=ff.Compaction(thickening=thickening))
    cells = {"cell": kind} if kind == "quadrilateral" else {"degree": int(kind[1])}
    pair = plates(gap * share**-thickening)
    scene = ff.Scene(rectangle(**cells), [ff.Membrane(fabric), *pair], [SHEARING])
    end = run(scene, 40)[-1]
    for plate in pair:
        pressure = np.linalg.norm(plate.force()) / (200 * share)
        assert fabric.thickness_under(pressure) == pytest.approx(gap, rel=2e-4)
    fields = reports.cell_fields(scene)
    uniform(fields["thickness_under_pressure"], gap * share**-thickening, 1e-4)
    fibres = 0.3 / gap * share ** (thickening - 1)
    uniform(fields["fibre_volume_fraction"], fibres, 1e-4)
    assert sum(end.energies.values()) == pytest.approx(end.external_work, rel=2e-3)


@pytest.mark.mpi
def test_two_sheets_that_thicken_press_each_other_over_it():
    """Both sheared between plates; the upper one thickens."""
    share, gap = math.cos(SHEAR), 0.8
    grown = FABRIC.replace(compaction=ff.Compaction(thickening=0.5))
    stack = ff.Stack([(rectangle(8, 3), T, "a"), (rectangle(8, 4), T, "b")])
    pair = ff.SheetContact("a", "b", points=6)
    membranes = [ff.Membrane(FABRIC).on("a"), ff.Membrane(grown).on("b")]
    pressing = plates(gap * (1 + share**-0.5), 2 * T)
    scene = ff.Scene(stack, [*membranes, *pressing, pair], [SHEARING])
    run(scene, 10)
    pressure = pair.force()[2] / (200 * share)
    assert FABRIC.thickness_under(pressure) == pytest.approx(gap, rel=1e-3)
    thickness = reports.cell_fields(scene)["thickness_under_pressure"]
    middle = (abs(stack.midpoints()[:2] - [[10], [5]]) < [[5], [2.5]]).all(0)
    for name, thick in (("a", gap), ("b", gap * share**-0.5)):
        cells = stack.part(name).cells
        uniform(thickness[cells[middle[cells]]], thick, 5e-3)


def test_a_thinner_part_of_a_ply_has_fewer_fibres():
    """So that their share is the same all over one that is half as thick at an end."""
    ply = ff.Membrane(FABRIC, thickness=ff.Field(lambda x, y: 0.5 + 0.025 * x))
    fields = reports.cell_fields(ff.Scene(rectangle(), [ply, *plates(T)], [PLAIN]))
    thick = T * (0.5 + 0.025 * rectangle().midpoints()[0])
    assert fields["thickness_under_pressure"] == pytest.approx(thick)
    uniform(fields["fibre_volume_fraction"], 0.3 / T)


def test_what_is_not_known_is_not_told():
    """Fibre volume without fibre density; thickness where contact contradicts the fabric."""
    fabric = ff.load("komeili")
    scene = ff.Scene(rectangle(), [ff.Membrane(fabric), *plates(T)], [PLAIN])
    fields = reports.cell_fields(scene)
    assert "thickness_under_pressure" in fields and "fibre_volume_fraction" not in fields
    hard = ff.Contact(ff.Tool(ff.Plane((0, 0, -1.0), (0, 0, 1))), penalty=1e3)
    scene = ff.Scene(rectangle(), [ff.Membrane(fabric), hard], [PLAIN])
    assert "thickness_under_pressure" not in reports.cell_fields(scene)
