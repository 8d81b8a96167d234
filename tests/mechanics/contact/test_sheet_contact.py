"""Contact of sheets with each other."""

import math

import numpy as np
import pytest
from builders import COMM, everywhere, nodal_forces, off_differences, rotation
from builders import sheet as rectangle
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.mechanics.contact.pressure_law import PENETRATION, SMOOTHING, Rigid, face_of
from fabric_fenicsx.meshes.specimen import specimen

FABRIC = ff.load("komeili")
T, PRESSURE, RADIUS = FABRIC.thickness_under(0.0), 2.0, 30.0
ABC = "a", "b", "c"


def disc(n, turn):
    """A disc of n cells across, turned in its plane [deg]: a square's rows of cells bent round."""
    points = cells = kind = None
    if COMM.rank == 0:
        points, cells, kind = specimen(2.0, 2.0, n, n, "crossed", "triangle", 0.0)
        x, y = np.asarray(points, float)[:, :2].T - 1
        c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
        x, y = RADIUS * x * np.sqrt(1 - y * y / 2), RADIUS * y * np.sqrt(1 - x * x / 2)
        points = np.column_stack([c * x - s * y, s * x + c * y, 0 * x])
    return ff.Blank.from_arrays(COMM, points, cells, kind, spatial=True)


def membranes(names, modulus=100.0):
    return [
        term.on(name)
        for name in names
        for term in (ff.Membrane(FABRIC), ff.Bending(modulus=modulus))
    ]


@pytest.mark.versions
@pytest.mark.mpi
def test_three_discs_between_two_plates():
    """Of cells 1 : 1.37 and turned by 17 deg: each contact bears the whole load, action is reaction
    with its moment, and in the inner part the pressure is uniform to 1 %: 6 points of a cell
    integrate the shape functions of others to that, and the face's normals are those of sheets that
    this presses uneven. Fabrics are compacted by what their laws say under the largest pressure, at
    the rim."""
    load = PRESSURE * math.pi * RADIUS**2
    stack = ff.Stack([(disc(8, 0), T, "a"), (disc(11, 17), T, "b"), (disc(8, 0), T, "c")])
    upper, lower = ff.Plane((0, 0, 2.5 * T), (0, 0, -1)), ff.Plane((0, 0, -T / 2), (0, 0, 1))
    top = ff.Contact(ff.Tool(upper, force=lambda at: (0, 0, -at * load), name="top"))
    bottom = ff.Contact(ff.Tool(lower, name="bottom"))
    pairs = [ff.SheetContact(*names, points=6) for names in (ABC[:2], ABC[1:])]
    held = [ff.Support("plane", everywhere, (0, 1))]
    scene = ff.Scene(stack, [*membranes(ABC), *pairs, top, bottom], held)
    job = ff.Job(scene, steps=4, tolerance=1e-10, limits=ff.Limits(imbalance=1e9))
    result = job.run()
    pressure = result.fields["sheet_pressure"]
    inner = (np.hypot(*stack.midpoints()[:2]) < 0.6 * RADIUS) & np.isfinite(pressure)
    pressures = np.concatenate(COMM.allgather(pressure[inner]))
    assert len(pressures) > 100
    assert abs(pressures - pressures.mean()).max() < 0.01 * pressures.mean()
    assert pressures.mean() == pytest.approx(PRESSURE, rel=0.01)
    assert top.force() == pytest.approx([0, 0, -load], abs=1e-9 * load)
    assert bottom.force() == pytest.approx([0, 0, load], abs=1e-9 * load)
    for pair in pairs:
        assert pair.totals[:3] == pytest.approx([0, 0, load], abs=1e-9 * load)
        forces = nodal_forces(pair)
        x = (stack.coordinates() + stack.nodal_displacement())[: len(forces)]
        # `add_forces` gives the energy's derivative: minus the forces on the nodes
        total, moment = COMM.allreduce(np.array([forces.sum(0), np.cross(x, forces).sum(0)]))
        assert abs(total).max() < 1e-9 * load and abs(moment).max() < 1e-9 * load * RADIUS
        on = -COMM.allreduce(forces[stack.part(pair.sheets[1]).nodes].sum(0))
        assert on == pytest.approx(pair.force(), abs=1e-9 * load)
        entry = result.summary["sheet_contacts"][", ".join(pair.sheets)]
        assert entry["penetration_of_thickness"] == pair.penetration_of_thickness() == 0.0
        assert entry["normal_force_N"] == pytest.approx(load, rel=1e-6)
        most = float((pair.normal_forces() / pair.points.areas).max(initial=0))
        most = COMM.allreduce(most, MPI.MAX)
        assert pair.largest_depth() == pytest.approx(pair.depth_under(most), rel=1e-3)
        assert T - pair.largest_depth() == pytest.approx(FABRIC.thickness_under(most), rel=1e-3)


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


# -- derivatives


def two(depth, bow=0.0, tilt=0.0, moved=None, **options):
    """Two sheets in a scene, bent together, that overlap by `depth` [mm] where `tilt` [mm] at the
    ends does not part them; moved: a rigid motion of it all."""
    lower = rectangle(20, 10, 8, 4, spatial=True)
    upper = rectangle(20, 10, 12, 6, spatial=True, a=0.7)
    stack = ff.Stack([(lower, T, "lower"), (upper, T, "upper")])
    pair = ff.SheetContact("lower", "upper", 50.0, **options)
    scene = ff.Scene(stack, [*membranes(("lower", "upper")), pair])
    X = stack.coordinates()
    x = X.copy()
    x[:, 2] += bow * (X[:, 0] - 7) ** 2 / 2 - bow * (X[:, 1] - 3) * (X[:, 0] - 10) / 4
    on_upper = X[:, 2] > T / 2
    x[on_upper, 2] += tilt * (X[on_upper, 0] - 10) / 10 - depth
    x = x if moved is None else moved(x)
    stack.u.x.array[:] = (x - X).ravel()
    scene.accept()
    return scene, pair


STATES = {
    "pressed": {"depth": 0.05, "bow": 0.02},
    "flat": {"depth": 0.05},
    "partly": {"depth": 0.0, "bow": 0.02, "tilt": 0.05},
}


@pytest.mark.parametrize("state, points", [("pressed", 1), ("flat", 6), ("partly", 3)])
def test_forces_and_tangent_are_derivatives(state, points):
    scene, pair = two(**STATES[state], points=points)
    touching = (pair.normal_forces() > 0).sum()
    share = touching / pair.points.count
    assert 0 < share < 1 if state == "partly" else share > 0.9
    assert off_differences(pair, 0.01) < 1e-6


@pytest.mark.parametrize("updated", [False, True])
def test_derivatives_where_points_slide_over_edges(updated):
    """By more than a cell, before the faces are taken anew and after."""
    scene, pair = two(**STATES["pressed"])
    before = pair.points.pairs().motion
    stack = scene.blank
    u, on_upper = stack.u.x.array.reshape(-1, 3), stack.coordinates()[:, 2] > T / 2
    u[on_upper] += (2.9, 1.3, -0.06)
    if updated:
        assert scene.update_lagged()
    assert (pair.points.pairs().motion is not before) and (pair.normal_forces() > 0).any()
    assert off_differences(pair, 0.01) < 1e-6


def test_states_that_alternate_are_met_half_way(by_position):
    """Where the faces were taken to and fro, they are taken between both places."""
    shift = np.array([1.1, 0.5, 0.0])
    found = []
    for places in ((1.0, 0.0), (0.5,)):
        scene, pair = two(**STATES["pressed"])
        scene.accept()
        scene.set_load(0.0)
        u, on_upper = scene.u.array, scene.blank.part("upper").nodes
        rest = u.copy()
        for share in places:
            u[:] = rest
            u.reshape(-1, 3)[on_upper] += share * shift
            scene.set(scene.u.copy())
            assert scene.update_lagged()
        u[:] = rest
        scene.set(scene.u.copy())
        forces = nodal_forces(pair)
        found.append(by_position(COMM, scene.blank.coordinates()[: len(forces)], forces)[1])
    assert found[0] == pytest.approx(found[1], abs=1e-9 * abs(found[1]).max())


@pytest.mark.mpi
@pytest.mark.parametrize("penalty", [None, 7.0])
def test_pressure_follows_from_the_overlap(penalty):
    """Two fabrics share it; a penalty makes both rigid."""
    z = 0.05
    scene = ff.Scene(laid(0.0), [*membranes("ab"), ff.SheetContact("a", "b", penalty)])
    contact, upper = scene.terms[-1], scene.blank.part("b").nodes
    for gap in (0.3, 0.0, -z):
        scene.blank.u.x.array.reshape(-1, 3)[: len(upper)][upper, 2] = gap
        scene.blank.u.x.scatter_forward()
        scene.accept()
        law = Rigid(7.0, SMOOTHING * PENETRATION * T) if penalty else face_of(FABRIC, 1.0)
        share = 1.0 if penalty else 0.5
        pressure = float(law(np.array(share * max(0.0, -gap)))[1])
        assert contact.force()[2] == pytest.approx(pressure * 20 * 10, abs=1e-9)
        assert contact.depth_under(pressure) == pytest.approx(max(0.0, -gap), abs=1e-12)
    assert contact.largest_depth() == pytest.approx(z)
    assert contact.penetration_of_thickness() == (pytest.approx(z / T) if penalty else 0.0)


def test_depth_counts_in_equilibrium_alone():
    """At load 0 the last state counts, later each."""
    scene = ff.Scene(laid(0.0), [*membranes("ab"), ff.SheetContact("a", "b", penalty=7.0)])
    contact, upper = scene.terms[-1], scene.blank.part("b").nodes
    for load, gap, deepest in ((0.0, -0.05, 0.05), (0.0, -0.01, 0.01), (1.0, 0.1, 0.01)):
        scene.blank.u.x.array.reshape(-1, 3)[: len(upper)][upper, 2] = gap
        scene.blank.u.x.scatter_forward()
        scene.set_load(load)
        scene.accept()
        assert contact.largest_depth() == pytest.approx(deepest)


def test_a_rigid_motion_of_the_scene(by_position):
    """Energy and forces are those of the scene where it was."""
    Q, far, found = rotation(3), np.array([30.0, -20.0, 7.0]), []
    for turn, shift in ((np.eye(3), 0 * far), (Q, far)):
        scene, pair = two(**STATES["partly"], moved=lambda x, t=turn, s=shift: x @ t.T + s)
        forces = nodal_forces(pair)
        places = scene.blank.coordinates()[: len(forces)]
        _, forces = by_position(COMM, places, forces @ turn)
        found.append((COMM.allreduce(pair.stored()), pair.force(), forces))
    (energy, force, forces), (turned_energy, turned_force, turned) = found
    assert turned_energy == pytest.approx(energy, rel=1e-9) and energy > 0
    assert turned_force == pytest.approx(Q @ force, abs=1e-9 * abs(force).max())
    assert abs(turned - forces).max() < 1e-9 * abs(forces).max()


def laid(play=0.0, **options):
    return ff.Stack(
        [(rectangle(20, 10, 4, 2, spatial=True, **options), T, n) for n in "ab"], 0, play
    )


# -- stacks without friction


# -- what a holder presses


@pytest.mark.mpi
def test_a_holder_presses_where_all_sheets_lie_on_one_another():
    """Three sheets of other sizes: areas and force are those of what they share."""
    sizes = {"low": (20, 10, 10, 5), "mid": (16, 10, 8, 5), "top": (20, 8, 10, 4)}
    stack = ff.Stack([(rectangle(*size, spatial=True), T, name) for name, size in sizes.items()])
    pairs = [ff.SheetContact("low", "mid", 50.0), ff.SheetContact("mid", "top", 50.0)]
    press = ff.BlankHolderPressure(2.0, (0, 0, 1), lambda x: np.ones(x.shape[1]), against=pairs)
    scene = ff.Scene(stack, [*membranes(sizes), press.on("low"), *pairs])
    assert COMM.allreduce(pairs[1].points.covered().sum()) == pytest.approx(16 * 8)
    assert press.force() == pytest.approx([0, 0, 2.0 * 16 * 8], rel=1e-9)
    forces = press.normal_forces()
    beyond = (stack.coordinates()[: len(forces), 0] > 16 + 1e-6) | ~stack.part("low").nodes
    assert not forces[beyond].any()
    assert not scene.update_lagged()
