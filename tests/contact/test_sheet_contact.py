"""Contact of sheets with each other."""

import numpy as np
import pytest
from builders import COMM, everywhere, nodal_forces, off_differences, rotation
from builders import sheet as rectangle
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.scene import output as reports

FABRIC = ff.load("komeili")
T, PRESSURE = FABRIC.thickness_under(0.0), 2.0
ABC = "a", "b", "c"


def membranes(names, modulus=100.0):
    terms = lambda: (ff.Membrane(FABRIC), ff.Bending(modulus=modulus))  # noqa: E731
    return [term.on(name) for name in names for term in terms()]


@pytest.mark.versions
@pytest.mark.mpi
def test_columns_of_three_sheets_between_two_plates():
    """Of cells 1 : 1.5 : each contact bears the whole load, action is reaction with its moment, and
    in the middle the pressure is uniform to 1 %: 6 points of a cell integrate the shape functions
    of others to that. Fabrics are compacted by what their laws say under it."""
    cells = dict(zip(ABC, (4, 6, 4)))
    load, middle = PRESSURE * 20 * 6, lambda x: abs(x[0] - 10) < 5
    sheets = [(rectangle(20, 6, n, 2, spatial=True), T, name) for name, n in cells.items()]
    stack = ff.Stack(sheets)
    upper, lower = ff.Plane((0, 0, 2.5 * T), (0, 0, -1)), ff.Plane((0, 0, -T / 2), (0, 0, 1))
    top = ff.Contact(ff.Tool(upper, force=lambda at: (0, 0, -at * load), name="top"))
    bottom = ff.Contact(ff.Tool(lower, name="bottom"))
    pairs = [ff.SheetContact(*names, points=6) for names in (ABC[:2], ABC[1:])]
    held = [ff.Support("plane", everywhere, (0, 1))]
    scene = ff.Scene(stack, [*membranes(ABC), *pairs, top, bottom], held)
    job = ff.Job(scene, steps=2, tolerance=1e-10, limits=ff.Limits(imbalance=1e9))
    result = job.run()
    pressure = result.fields["sheet_pressure"]
    inner = middle(stack.midpoints()) & np.isfinite(pressure)
    pressures = np.concatenate(COMM.allgather(pressure[inner]))
    assert len(pressures) > 10
    assert pressures == pytest.approx(np.full(len(pressures), PRESSURE), rel=0.01)
    assert top.force() == pytest.approx([0, 0, -load], abs=1e-9 * load)
    assert bottom.force() == pytest.approx([0, 0, load], abs=1e-9 * load)
    for pair in pairs:
        assert pair.totals[:3] == pytest.approx([0, 0, load], abs=5e-6)
        forces = nodal_forces(pair)
        x = (stack.coordinates() + stack.nodal_displacement())[: len(forces)]
        # `add_forces` gives the energy's derivative: minus the forces on the nodes
        total, moment = COMM.allreduce(np.array([forces.sum(0), np.cross(x, forces).sum(0)]))
        assert abs(total).max() < 1e-9 * load and abs(moment).max() < 1e-9 * load * 20
        on = -COMM.allreduce(forces[stack.part(pair.sheets[1]).nodes].sum(0))
        assert on == pytest.approx([0, 0, load], abs=5e-6)
        entry = result.summary["sheet_contacts"][", ".join(pair.sheets)]
        assert entry["penetration_of_thickness"] == 0.0
        assert entry["normal_force_N"] == pytest.approx(load, rel=1e-6)
        most = float((pair.normal_forces() / pair.points.areas).max(initial=0))
        most = COMM.allreduce(most, MPI.MAX)
        assert T - pair.largest_depth() == pytest.approx(FABRIC.thickness_under(most), rel=1e-3)


LOW, HIGH = 1.2, 0.4  # thickness of the lower and of the upper sheet [mm]
BOTH = 0.5 * (LOW + HIGH)
STEEL = ff.Metal(186600.0, 0.3, ff.Swift(500.0, 0.0005, 0.2), thickness=1.0)


def steel():
    """Both as metal."""
    return [ff.SheetMetal(STEEL.replace(thickness=t)).on(k) for t, k in ((LOW, "a"), (HIGH, "b"))]


def unlike(lower=None, play=0.0, upper=None, terms=None, **options):
    """A thick sheet below a thin one of smaller cells in a scene, and their contact."""
    sheets = [(lower or rectangle(20, 10, 2, 1, spatial=True), LOW, "a")]
    sheets.append((upper or rectangle(20, 10, 4, 2, spatial=True), HIGH, "b"))
    pair = ff.SheetContact("a", "b", **options)
    return ff.Scene(ff.Stack(sheets, None, play), [*(terms or steel()), pair]), pair


def moved(scene, name, place):
    """Move the nodes of a sheet to place(x) (n, 3)."""
    X = scene.blank.coordinates()
    at = (X[:, 2] > LOW / 2) == (name == "b")
    scene.blank.u.x.array.reshape(-1, 3)[at] = place(X[at]) - X[at]


def test_sheets_may_overlap_by_a_quarter_of_the_thinner_one_at_first():
    unlike(play=-0.24 * HIGH)
    with pytest.raises(ff.InputError, match="sheets that overlap by 0.104 mm"):
        unlike(play=-0.26 * HIGH)


def test_a_gap_is_less_by_what_the_sheared_one_of_two_sheets_thickens():
    """By its own half, whichever has the points."""
    sizes, grown = {"a": LOW, "b": HIGH}, FABRIC.replace(compaction=ff.Compaction(thickening=0.5))
    for sheared, thick in sizes.items():
        fabrics = [ff.Membrane(grown.replace(thickness=t / T)).on(k) for k, t in sizes.items()]
        scene, pair = unlike(terms=fabrics)
        before = pair.points.pairs().gap.copy()
        moved(scene, sheared, lambda x: x * [0.64, 1, 1])
        now = pair.points.pairs()
        more = thick / 2 * (1 / 0.8 - 1)  # 1 / sqrt(0.64) times as thick
        assert len(now.gap) > 10 and abs(before).max() < 1e-9
        assert now.gap == pytest.approx(np.full(len(now.gap), -more), rel=1e-6)
        assert now.growth == pytest.approx(np.full(len(now.gap), 1 + more / BOTH), rel=1e-6)


def test_the_face_of_a_sheet_that_tilts_slides_by_half_its_thickness():
    """Each sheet tilts by 1e-3 about its mid-surface, in turn."""
    for name, thick in (("a", LOW), ("b", HIGH)):
        scene, pair = unlike(friction=0.3)
        sliding = pair.friction_state.sliding
        moved(scene, name, lambda x: x + [0, 0, 1] * (1e-3 * (x[:, :1] - 10)))
        slid = sliding.slid()
        # the upper face of the lower sheet goes back as its z grows along x
        assert len(slid) and slid[:, 0] == pytest.approx(np.full(len(slid), 1e-3 * thick / 2))


def test_areas_of_a_pair_that_grow_add_force_and_no_energy():
    """Told with its own size where it is slanted."""
    scene, pair = unlike(penalty=50.0)
    s, depth = 0.3 * 0.0125 * HIGH, 0.05
    turn = rotation(3)
    slant = lambda x, k: x * [k, 1, 1] @ turn.T  # noqa: E731
    for grown, updated in ((1.0, False), (1.005, False), (1.02, True)):
        moved(scene, "a", lambda x, k=grown: slant(x, k))
        moved(scene, "b", lambda x, k=grown: slant(x - [0, 0, depth], k))
        if grown == 1.0:
            scene.accept()
            scene.set_load(0.0)
            stored = pair.energies()["contact"]
            assert stored > 0
        else:
            assert scene.update_lagged() == updated
            assert pair.energies()["contact"] == pytest.approx(stored, rel=1e-6)
    scene.accept()
    pressure = 50.0 * (depth - s / 2)
    (told,) = reports.summary(scene)["sheet_contacts"].values()
    assert told["force_N"] == pytest.approx(200 * 1.02 * pressure, rel=1e-3)
    assert told["penetration_of_thickness"] == pytest.approx(depth / HIGH, rel=1e-3)


def test_what_slides_is_neither_turned_nor_lifted():
    """Along the faces alone, by 0.5 mm; by nothing where both sheets turn and the gap opens."""
    scene, pair = unlike()
    turn = rotation(3)
    for way, told in (((0, 0, 0), 0.0), ((0, 0, 0.05), 0.0), ((0.3, 0.4, 0), 0.5)):
        moved(scene, "a", lambda x: x @ turn.T)
        moved(scene, "b", lambda x, w=way: (x + w) @ turn.T)
        scene.accept()
        sizes = np.linalg.norm(pair.sliding(), axis=1)
        inner = (pair.points.flat_places()[:, :2] < [19, 9]).all(1)
        assert sizes[inner] == pytest.approx(np.full(inner.sum(), told), abs=1e-9)


def test_what_lies_over_nodes_is_its_mean_by_area():
    """1 over the narrow column of cells of the upper sheet, 3 of 20 mm wide: at the lower sheet's
    ends the integral of its shape functions over there."""
    narrow = lambda x: np.column_stack([np.interp(x[:, 0], [0, 10, 20], [0, 3, 20]), x[:, 1:]])  # noqa: E731
    lower = rectangle(20, 10, 1, 1, "left", spatial=True)
    scene, pair = unlike(lower, 0.0, rectangle(20, 10, 2, 1, spatial=True, shape=narrow), points=6)
    points = pair.points
    found = points.below(points.pairs(), 1.0 * (points.flat_places()[:, 0] < 3))
    X = scene.blank.coordinates()[: len(found)]
    for end, part in ((0, 10 * (3 - 3**2 / 40)), (20, 10 * 3**2 / 40)):
        at = (abs(X[:, 0] - end) < 1e-9) & (X[:, 2] < LOW / 2)
        total = (found * points.nodes.areas)[at].sum()
        assert at.sum() == 2 and total == pytest.approx(part, rel=0.1)


def test_the_back_of_a_fold_is_not_pressed():
    """The lower sheet's end is folded over and lies in the upper sheet with its back up; the upper
    one is moved, so that what lay below its points has to be sought anew."""
    sheets = [(rectangle(60, 10, 30, 5, "crossed", spatial=True), T, n) for n in ABC[:2]]
    stack, contact = ff.Stack(sheets), ff.SheetContact("a", "b")
    ff.Scene(stack, [*membranes(ABC[:2]), contact], [])
    X = stack.coordinates()
    lower = stack.part("a").nodes
    fold = [80, 0, 0.8 * T] + X * [-1, 1, 1]
    x = np.where((lower & (X[:, 0] > 40))[:, None], fold, X)
    x[~lower, 0] -= 3.0
    stack.u.x.array[:] = (x - X).ravel()
    pairs = contact.points.pairs()
    assert COMM.allreduce(len(pairs.gap)) > 500
    assert pairs.gap.min(initial=0) > -1e-9 and (pairs.normal[:, 2] > 0).all()


def two(depth, bow=0.0, tilt=0.0, **options):
    """Two sheets in a scene, bent together, that overlap by `depth` [mm] where `tilt` [mm] at the
    ends does not part them."""
    lower = rectangle(20, 10, 8, 4, spatial=True)
    upper = rectangle(20, 10, 12, 6, spatial=True, a=0.7)
    stack = ff.Stack([(lower, T, "lower"), (upper, T, "upper")])
    pair = ff.SheetContact("lower", "upper", 50.0, **options)
    scene = ff.Scene(stack, [*membranes(("lower", "upper")), pair])
    X, z = stack.coordinates(), stack.u.x.array[2::3]
    z += bow * (X[:, 0] - 7) ** 2 / 2 - bow * (X[:, 1] - 3) * (X[:, 0] - 10) / 4
    z += (X[:, 2] > T / 2) * (tilt * (X[:, 0] - 10) / 10 - depth)
    scene.accept()
    return scene, pair


STATES = {
    "pressed": {"depth": 0.05, "bow": 0.02},
    "flat": {"depth": 0.05},
    "partly": {"depth": 0.0, "bow": 0.02, "tilt": 0.05},
}


@pytest.mark.parametrize("state, points", [("pressed", 1), ("flat", 6), ("partly", 3)])
@pytest.mark.parametrize("slid", [(0, 0, 0), (2.9, 1.3, -0.06)])
def test_forces_and_tangent_are_derivatives(state, points, slid):
    """Also where points slide over edges, by more than a cell, before the faces are taken anew and
    after."""
    scene, pair = two(**STATES[state], points=points)
    share = (pair.normal_forces() > 0).sum() / pair.points.count
    assert 0 < share < 1 if state == "partly" else share > 0.9
    if any(slid):
        scene.blank.u.x.array.reshape(-1, 3)[scene.blank.coordinates()[:, 2] > T / 2] += slid
        assert (pair.normal_forces() > 0).any() and off_differences(pair, 0.01) < 1e-6
        assert scene.update_lagged()
    assert off_differences(pair, 0.01) < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize("penalty", [None, 7.0])
def test_pressure_follows_from_the_overlap(penalty):
    """Two fabrics share it; a penalty makes both rigid. At load 0 the last state's depth counts,
    later each."""
    z, sheets = 0.05, [(rectangle(20, 10, 4, 2, spatial=True), T, name) for name in "ab"]
    contact = ff.SheetContact("a", "b", penalty)
    scene = ff.Scene(ff.Stack(sheets, 0), [*membranes("ab"), contact])
    upper = scene.blank.part("b").nodes
    for load, gap in ((0.0, -2 * z), (0.0, 0.3), (0.0, 0.0), (0.0, -z), (1.0, 0.1)):
        scene.blank.u.x.array.reshape(-1, 3)[: len(upper)][upper, 2] = gap
        scene.blank.u.x.scatter_forward()
        scene.set_load(load)
        scene.accept()
        deep = max(0.0, -gap)
        if penalty:  # smoothed over 0.3 of 1.25 % of the thickness
            pressure = 7.0 * max(0.0, deep - 0.3 * 0.0125 * T / 2)
        else:
            c = FABRIC.compaction
            y = c.exponent * np.log(T / (T - deep))
            pressure = c.onset * (np.exp(y) - 1 - y)
        assert contact.force()[2] == pytest.approx(pressure * 20 * 10, abs=1e-9)
        assert contact.depth_under(pressure) == pytest.approx(deep, abs=1e-12)
    assert contact.largest_depth() == pytest.approx(z)
    assert contact.penetration_of_thickness() == (pytest.approx(z / T) if penalty else 0.0)


@pytest.mark.mpi
def test_a_holder_presses_where_all_sheets_lie_on_one_another():
    """Three sheets of other sizes: areas and force are those of what they share."""
    sizes = {"low": (20, 10, 10, 5), "mid": (16, 10, 8, 5), "top": (20, 8, 10, 4)}
    stack = ff.Stack([(rectangle(*size, spatial=True), T, name) for name, size in sizes.items()])
    pairs = [ff.SheetContact("low", "mid", 50.0), ff.SheetContact("mid", "top", 50.0)]
    press = ff.BlankHolderPressure(2.0, (0, 0, 1), lambda x: np.ones(x.shape[1]), full_stack=True)
    scene = ff.Scene(stack, [*membranes(sizes), press, *pairs])
    assert press.force() == pytest.approx([0, 0, 2.0 * 16 * 8], rel=1e-9)
    forces = press.normal_forces()
    beyond = (stack.coordinates()[: len(forces), 0] > 16 + 1e-6) | ~stack.part("low").nodes
    assert not forces[beyond].any()
    assert not scene.update_lagged()
