"""Supports: what they hold, where they move it, and what they bear."""

import numpy as np
import pytest
from builders import COMM, Elastic, near, said, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.scene import output, rigid_motions


def moved(x):
    return x + [3.0, -2.0, 0.0]


def test_displacements_at_a_load():
    """In proportion to it; those of a frame from its low corner on, wherever that lies."""
    found = ff.Support("s", None, (0,), (2.0, -4.0)).at(np.zeros((3, 2)), 0.25)
    assert found == pytest.approx(np.array([[0.5, 0.5], [-1.0, -1.0], [0, 0]]))
    blank = sheet(20, 10, 2, 2, shape=moved)
    (frame,) = ff.frame(lambda load: np.array([[1 + load, 0.1], [0.0, 1.0]]))(blank)
    found = frame.at(np.array([[3.0, 23.0, 3.0], [-2.0, -2.0, 8.0], [0, 0, 0]]), 0.5)
    assert found[:2] == pytest.approx(np.array([[0, 10.0, 1.0], [0, 0, 0]]))
    fixed, moving, corner = ff.rolling_ends(2.0)(blank)
    assert [s.components for s in (fixed, moving, corner)] == [(0,), (0,), (1,)]
    at = np.array([[3.0, 23.0, 23.0], [-2.0, -2.0, 8.0], [0, 0, 0]])
    found = [s.where(at).tolist() for s in (fixed, moving, corner)]
    assert found == [[True, False, False], [False, True, True], [True, False, False]]


@pytest.mark.parametrize("width, gripped", [(5.1, True), (4.9, False)])
def test_an_end_is_gripped_over_half_the_width(width, gripped):
    narrow = lambda x: x * (1 - (1 - width / 10) * x[:, :1] / 20) ** (0, 1, 0)  # noqa: E731
    blank = sheet(20, 10, 4, 4, shape=narrow)
    if gripped:
        assert len(ff.clamped_ends(1.0)(blank)) == 2
    else:
        with pytest.raises(ff.InputError, match="high end .* gripped over 4.9 of 10 mm"):
            ff.clamped_ends(1.0)(blank)


@pytest.mark.mpi
def test_reactions_and_forces_from_outside():
    """A strip of E h = 1000 N/mm and 10 mm, stretched by 1 %: Green's strain times stretch times
    width. One support holds both ends, whose forces cancel but in their sizes; what another one
    would hold there, too, counts once."""
    blank = sheet(40, 10, 8, 2)
    moved = lambda x, load: 0.01 * load * x[:2]  # noqa: E731
    ends = ff.Support("ends", lambda x: abs(x[0] - 20) > 19.99, (0,), moved)
    side = ff.Support("side", lambda x: np.hypot(x[0] - 20, x[1]) < 1e-6, (1,), locates=True)
    again = ff.Support("again", near(0, 0.0), (0,), locates=True)
    scene = ff.Scene(blank, [Elastic(1e3)], [again, ends, side])
    scene.blank.u.interpolate(lambda x: (0.01 * x[0], 0 * x[0]))
    scene.residual(scene.u.duplicate())
    pull = 1e3 * 0.01005 * 1.01 * 10
    assert scene.reaction("ends") == pytest.approx([0, 0], abs=1e-9)
    outer = {"ends": 2 * pull, "again": 0, "side": 0, "": 0}
    assert output.outer_forces(scene) == pytest.approx(outer, abs=1e-9)
    # over their nodes: 1/4, 1/2 and 1/4 of the pull
    assert scene.force_scale() == pytest.approx(pull * np.sqrt(2 * (2 / 16 + 1 / 4)))
    assert output.virial(scene) == pytest.approx(np.diag([pull * 40, 0]), abs=1e-8)
    sizes = output.sizes(scene)
    assert sizes["element"] == "P1" and sizes["dofs"] == 2 * (9 * 3 + 16) and sizes["cells"] == 64


def test_forces_that_cancel_and_a_drag():
    """Of tensions that cancel in their nodes a thousandth counts; a drag k takes k u^2 / 2 of what
    is free."""
    blank, q = sheet(20, 10, 2, 2), 10 * np.sqrt(2 / 16 + 1 / 4)
    tensions = [ff.EdgeTension(each, (1, 0), near(0, 20.0)) for each in (3.0, -3.0, 5.0)]
    held = ff.Support("grip", near(0, 0.0), (0,))
    scene = ff.Scene(blank, [Elastic(), *tensions], [held])
    r, A = scene.u.duplicate(), scene.create_matrix()
    scene.residual(r)
    assert scene.force_scale() == pytest.approx(q * np.sqrt(25 + 1e-6 * 43), rel=1e-12)
    scene.tangent(A)
    scene.drag, scene.origin, moved, stiffness = 3.0, scene.u.copy(), scene.u.copy(), A.copy()
    moved.shift(0.2)
    scene.set(moved)
    without, free = r.copy(), len(moved.array) - 3
    scene.residual(r)
    scene.tangent(A)
    assert scene.drag_energy() == pytest.approx(0.5 * 3.0 * 0.04 * free)
    assert (r - without).norm() == pytest.approx(0.6 * np.sqrt(free))
    assert A.getDiagonal().array - stiffness.getDiagonal().array == pytest.approx(3.0)


def test_supports_that_locate_bear_up_to_half_a_percent():
    blank = sheet(20, 10, 4, 2)
    held = [ff.Support(k, near(0, x), (1,), locates=True) for k, x in (("a", 0.0), ("b", 20.0))]
    scene = ff.Scene(blank, [Elastic()], [*held, ff.Support("end", near(0, 0.0), (0,))])
    for each, told in ((0.26, True), (0.24, False)):
        sizes = {"a": each, "b": 0.3, "end": 19.7 - each, "": 30.0}
        assert scene.supports.located_share(sizes) == pytest.approx((each + 0.3) / 50)
        assert bool(scene.supports.locating_warning({**sizes, "b": 0.0, "": 30.3})) == told


def test_nodes_beyond_planes_of_symmetry():
    """The farthest counts, on whichever side the plane bounds the sheet."""
    blank = sheet(20, 10, 4, 2, "left", shape=moved, spatial=True)
    held = [ff.Support("low", near(0, 3.0), (0,)), ff.Support("high", near(1, 8.0), (1,))]
    others = [
        ff.Support("moves", near(0, 3.0), (0,), (1.0, 0.0)),
        ff.Support("locates", near(1, 8.0), (1,), locates=True),
        ff.Support("two", near(0, 3.0), (0, 1)),
        ff.Support("bent", lambda x: (x[0] < 4) | (x[1] > 7), (0,)),
    ]
    assert rigid_motions.planes_of_symmetry(blank, [*held, *others]) == dict(enumerate(held))
    assert rigid_motions.beyond_planes(blank, held) == {}
    x = blank.coordinates()
    u = blank.u.x.array.reshape(-1, 3)
    u[(x[:, 0] > 3.1) & (x[:, 0] < 9.0), 0] = -5.2  # of 8 mm to 2.8 mm: 3 nodes
    u[np.abs(x[:, 1] - 3) < 0.1, 1] = [5.0, 5.1, 5.4, 5.2, 4.9]
    found = {"low": (3, pytest.approx(0.2)), "high": (3, pytest.approx(0.4))}
    assert rigid_motions.beyond_planes(blank, held) == found


def test_isostatic_supports_hold_at_far_corners():
    """Three nodes with three, two and one component in space, as far from each other as can be; in
    the plane two and one."""
    plane = rigid_motions.isostatic(sheet(20, 10, 4, 2, "left"), [])
    assert sorted(len(s.components) for s in plane) == [1, 2]
    blank = sheet(20, 10, 4, 2, "left", spatial=True)
    supports = rigid_motions.isostatic(blank, [])
    assert sorted(len(s.components) for s in supports) == [1, 2, 3]
    x = blank.coordinates()
    held = np.array([x[s.where(x.T)][0] for s in supports])
    assert len(np.unique(held, axis=0)) == 3
    area = np.linalg.norm(np.cross(held[1] - held[0], held[2] - held[0])) / 2
    assert area == pytest.approx(50.0)  # the middle and two corners, of 200 mm^2


PULL = 4.0  # N/mm along x on the right end


def around(x, radius=1e-6):
    return lambda points: np.linalg.norm(points[:2].T - (x, 10), axis=1) < radius


def pressed(friction, where=None, nx=8):
    """A ply pressed on a table and pulled to one side."""
    blank = sheet(40, 20, nx, nx // 2, spatial=True)
    fabric = ff.load("komeili")
    below = ff.Plane((0, 0, -fabric.thickness_under(0.0) / 2), (0, 0, 1))
    table = ff.Contact(ff.Tool(below, name="table"), friction=friction, where=where)
    press = ff.BlankHolderPressure(0.5, (0, 0, -1), lambda x: np.ones(x.shape[1]))
    pull = ff.EdgeTension(lambda load: PULL * load, (1, 0, 0), lambda x: x[0] > 40 - 1e-6)
    supports = [ff.Support("centre", around(20), (0, 1), locates=True)]
    supports.append(ff.Support("end", around(40), (1,), locates=True))
    terms = [ff.Membrane(fabric), ff.Bending(modulus=100.0), table, press, pull]
    return ff.Scene(blank, terms, supports)


@pytest.mark.mpi
def test_friction_takes_over_from_supports():
    scene = pressed(friction=0.3)
    result = ff.Job(scene, steps=4).run()
    assert not scene.supports.locates
    assert COMM.allreduce(len(scene.fixed_dofs)) == 0
    assert all(row["iterations"] < 10 for row in result.rows[2:])
    assert result.force("table")[0] == pytest.approx(-20 * PULL, rel=1e-6)
    assert abs(scene.reaction("centre")).max() < 1e-4
    assert not any("only locate the sheet" in words for words in said(result.summary))


@pytest.mark.parametrize("where, held", [(None, True), (around(20, 1), False)])
def test_friction_near_one_place_does_not_hold_a_sheet_from_turning(where, held):
    """Of five nodes up to 0.9 mm from the middle."""
    scene = pressed(0.3, where, nx=32)
    scene.u.array[2::3] = -0.1
    scene.set(scene.u.copy())
    scene.accept()
    assert rigid_motions.is_held_by_friction(scene.blank, scene.terms) == held
