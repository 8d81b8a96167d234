"""Stacks and parts of sheets."""

import numpy as np
import pytest
from builders import COMM, everywhere, run
from builders import sheet as rectangle
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.material.laws.tabulated import Curve

FABRIC = ff.load("komeili")
T = FABRIC.thickness
SHEETS = "lower", "middle", "upper"


def sheet(length=20.0, width=10.0, nx=4, **options):
    options.setdefault("element", "P1")  # alone as in a stack, whose sheets are of one degree
    return ff.Blank.rectangle(length, width, nx=nx, spatial=True, **options)


def three():
    """Sheets that differ in cells, yarns, size and thickness, the first at z = 0."""
    return [
        (sheet(), 0.5, "lower"),
        (sheet(nx=5, fibre_angle=45), 1.0, "middle"),
        (sheet(16.0, 8.0, 3, fibre_angle=30, yarn_angle=70), 0.2, "upper"),
    ]


def area(part):
    return COMM.allreduce(float(part.blank.areas()[part.cells].sum()), MPI.SUM)


@pytest.mark.mpi
def test_sheets_lie_on_one_another():
    stack = ff.Stack(three(), play=0.1)
    assert stack.heights == pytest.approx([0.0, 0.85, 1.55], abs=1e-14)
    assert stack.thickness == pytest.approx(1.7)
    assert ff.Stack(three(), bottom=-3.0).heights == pytest.approx([-2.75, -2.0, -1.4])
    mixed = (sheet(), T, "a"), (sheet(element="P2"), T, "b")
    assert [ff.Stack(order).degree for order in (mixed, mixed[::-1], mixed[:1])] == [2, 2, 1]
    z = stack.coordinates()[: stack.V.dofmap.index_map.size_local, 2]
    for part, height in zip(stack.parts.values(), stack.heights):
        assert z[part.nodes] == pytest.approx(np.full(part.nodes.sum(), height), abs=1e-12)


@pytest.mark.versions
@pytest.mark.mpi
def test_each_sheet_is_a_part():
    """With its area, nodes, cells, thickness and yarns, on any number of ranks."""
    given = three()
    stack = ff.Stack(given)
    assert tuple(stack.parts) == SHEETS
    nodes = np.sum([part.nodes for part in stack.parts.values()], axis=0)
    assert (nodes == 1).all()
    for number, (blank, thickness, name) in enumerate(given):
        part = stack.part(name)
        assert (stack.number[part.cells] == number).all()
        assert area(part) == pytest.approx(area(blank.whole), rel=1e-12)
        counts = np.array([[p.nodes.sum(), len(p.cells)] for p in (part, blank.whole)])
        assert np.array_equal(*COMM.allreduce(counts))
        assert part.thickness == thickness
        assert np.allclose(part.straight, blank.straight, atol=1e-14)
        assert part.orthogonal == blank.orthogonal
    assert stack.whole.straight is None


@pytest.mark.mpi
def test_each_cell_has_its_own_sheets_curved_yarns(by_position):
    def fan(x):
        return np.array([1 + 0 * x[0], x[1] / 30, 0 * x[0]])

    alone = rectangle(20, 10, 4, 2, spatial=True, a=fan)
    stack = ff.Stack([(sheet(), T, "straight"), (alone, T, "fan")])
    part = stack.part("fan")
    assert part.straight is None and stack.part("straight").straight is not None

    def yarns(blank, cells):
        rows = [f.x.array.reshape(-1, 3)[cells] for f in (blank.a0, blank.b0)]
        return by_position(COMM, blank.midpoints()[:2, cells].T, *rows)

    for one, other in zip(yarns(stack, part.cells), yarns(alone, alone.whole.cells)):
        assert one == pytest.approx(other, abs=1e-12)


def pulled(blank, *terms):
    """Force of the moving grip and strain energy of sheets pulled by 1 mm in their planes."""
    held = [*ff.clamped_ends(1.0)(blank), ff.Support("plane", everywhere, (2,))]
    scene = ff.Scene(blank, terms, held)
    run(scene, 2)
    return np.append(scene.reaction("moving grip"), scene.energy())


def test_sheets_that_do_not_touch_bear_what_they_bear_alone():
    def strips():
        return sheet(100, 50, 4), sheet(100, 50, 5, fibre_angle=45)

    alone = [pulled(strip, ff.Membrane(FABRIC)) for strip in strips()]
    stack = ff.Stack([(b, T, n) for b, n in zip(strips(), SHEETS)])
    found = pulled(stack, *(ff.Membrane(FABRIC).on(name) for name in SHEETS[:2]))
    assert abs(found - sum(alone)).max() < 1e-8 * abs(found).max()


LEFT, RIGHT = (lambda x: x[0] < 40), (lambda x: x[0] > 40)


def strip(**options):
    return ff.Blank.rectangle(100, 20, nx=10, element="P1", **options)


def linear(modulus, thickness):
    """A fabric whose nominal stress is `modulus` [MPa] times its yarns' strain."""
    yarn = Curve((-1.0, 0.0, 1.0), (-modulus, 0.0, modulus))
    shear = Curve((0.0, 0.5, 1.0), (0.0, 0.5, 1.0))
    return ff.TabulatedFabric(yarn, yarn, shear, thickness=thickness)


@pytest.mark.versions
@pytest.mark.mpi
def test_patches_of_two_fabrics_in_series():
    """The force is the pull over the sum of compliances l / (E t w)."""
    blank, pull = strip(spatial=True), 2.0
    blank.divide({"left": LEFT}, "rest")
    soft, stiff = linear(10.0, 0.5), linear(35.0, 0.8)
    terms = [ff.Membrane(soft).on("left"), ff.Membrane(stiff).on("rest")]
    held = [*ff.rolling_ends(pull)(blank), ff.Support("plane", everywhere, (2,))]
    scene = ff.Scene(blank, terms, held)
    run(scene, 2, 1e-11)
    compliance = 40 / (10.0 * 0.5 * 20) + 60 / (35.0 * 0.8 * 20)
    assert scene.reaction("moving grip")[0] == pytest.approx(pull / compliance, rel=1e-9)


@pytest.mark.mpi
def test_patches_share_out_the_sheet():
    blank = strip()
    blank.divide({"left": LEFT}, "rest")
    for name, area in {"left": 800.0, "rest": 1200.0}.items():
        own = blank.areas()[blank.part(name).cells].sum()
        assert COMM.allreduce(own) == pytest.approx(area)
    assert all(part.straight is not None and part.orthogonal for part in blank.parts.values())
    left, inside = blank.part("left"), blank.midpoints()[0] < 40
    assert np.array_equal(np.isfinite(left.spread(np.ones(len(left.cells)))), inside)
    assert np.array_equal(left.spread(np.ones(len(left.cells), dtype=np.int32)), inside)
    blank = strip()
    for patches, words in (
        ({"a": lambda x: x[0] > 200}, "patch a of blank has no cells"),
        ({"a": LEFT, "b": lambda x: x[0] < 50}, "patches of blank overlap"),
    ):
        with pytest.raises(ff.InputError, match=words):
            blank.divide(patches, "rest")
    blank.divide({"left": LEFT, "right": RIGHT}, "rest")
    assert list(blank.parts) == ["left", "right"]
    with pytest.raises(ff.InputError, match="already has parts left, right"):
        blank.divide({"right": RIGHT}, "rest")
