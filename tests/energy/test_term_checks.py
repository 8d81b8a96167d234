"""What own terms get wrong is named, on all ranks, before a run is wrong or waits for ever."""

import numpy as np
import pytest
import ufl
from builders import Elastic, Springs, alone, near, sheet
from dolfinx import fem
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.scene import output as reports

COMM = MPI.COMM_WORLD
KOMEILI = ff.load("komeili")


def scene_with(term):
    return ff.Scene(sheet(20.0, 10.0, 4, 2), [ff.Membrane(KOMEILI), term], ff.clamped_ends(0.1))


def run(term):
    return ff.Job(scene_with(term), steps=1).run()


def with_own(method, does):
    return type("Mine", (Springs,), {method: does})()


def moved(self):
    """The tangent's triplets, with the first row far below, on the last rank alone."""
    rows, cols, values = Springs.tangent(self)
    rows[:1] += 10**6 * (COMM.rank == COMM.size - 1)
    return rows, cols, values


def in_place_of_others(self, f):
    f[: len(self.u())] = self.k * self.u()


def tangents_that_change():
    asked = []

    def tangent(self):
        asked.append(1)
        return tuple(part[: -1 if len(asked) > 2 else None] for part in Springs.tangent(self))

    return tangent


@pytest.mark.parametrize(
    "method, does, words",
    [
        ("tangent", moved, "`tangent` of term springs returns entries outside the matrix"),
        ("tangent", tangents_that_change(), "rows and columns than before; .* unless `pattern` ch"),
        ("add_forces", lambda self, f: f + 1.0, "springs returns a value, or overwr"),
        ("add_forces", in_place_of_others, "overwrites forces of other terms; it must add"),
        ("energies", lambda self: {"viscous": 1.0}, "springs has the kind of energy viscous; expe"),
        ("summary", lambda self: {"converged": 3}, "entry converged, which summary.json has"),
        ("nodal_fields", lambda self: {"u": 3}, r"returns u with shape \(\); expected"),
    ],
)
def test_answers_that_end_a_run(method, does, words):
    with pytest.raises(ff.InputError, match=words):
        run(with_own(method, does))


@pytest.mark.mpi
def test_lists_and_texts_are_taken():
    mine = with_own("tangent", lambda self: [list(part) for part in Springs.tangent(self)])
    assert "agree" in ff.check_derivatives(mine, scene_with(mine))
    mine = with_own("cell_fields", lambda self: {"hits": [1.0] * self.part.cells.size})
    assert (run(mine).fields["hits"] == 1).all()
    assert "look here" in reports.warnings(scene_with(with_own("warnings", lambda s: "look here")))


class Counting(Springs):
    """Springs that count accepted states."""

    hits = 0

    def accept(self):
        self.hits += 1

    def memory(self):
        return {"hits": np.full((len(self.part.nodes), 1), self.hits)}

    def recall(self, memory):
        self.hits = int(memory["hits"].max())


@pytest.mark.mpi
def test_what_differs_between_ranks():
    """Kinds of energies may; numbers are named."""
    kinds = with_own("energies", lambda self: {f"rank{COMM.rank}": 0.0})
    assert {f"rank{rank}" for rank in range(COMM.size)} <= run(kinds).summary["energy"].keys()
    if COMM.size == 1:
        return
    words = "`history` of term springs returns .*0.* and .*1.* on different ranks; .*allreduce"
    with pytest.raises(ff.InputError, match=words):
        run(with_own("history", lambda self: {"rank": COMM.rank}))


def test_a_memory_that_is_not_recalled():
    scene = scene_with(first := Counting())
    ff.Job(scene, steps=1).run()
    forgets = type("Mine", (Counting,), {"recall": lambda self, memory: None})()
    memory, other = scene.memory(), scene_with(forgets)
    with pytest.raises(ff.InputError, match="`recall` of term springs does not restore hits"):
        other.recall(memory)
    other = scene_with(again := Counting())
    other.recall(memory)
    assert again.hits == first.hits > 1


class OnAnEdge(ff.Term):
    """Springs k [N/mm^2] from an edge to a frame: k |u|^2 / 2."""

    def __init__(self, name, k, edge):
        self.name = self.energy_kind = name
        self.k, self.edge = k, edge

    def set_up(self, scene):
        u, k = scene.blank.u, fem.Constant(scene.blank.mesh, self.k)
        self.energy = 0.5 * k * ufl.inner(u, u) * self.part.ds(self.edge, 2)


@pytest.mark.mpi
def test_energies_on_two_edges():
    """One of them of a part; UFL takes one set of marked edges in a form."""
    blank = sheet(20.0, 10.0, 4, 2)
    blank.divide({"left": lambda x: x[0] < 10}, rest="right")
    edge, top = OnAnEdge("edge", 0.5, near(0, 0.0)), OnAnEdge("top", 3.0, near(1, 10.0)).on("left")
    scene = ff.Scene(blank, [edge, ff.Membrane(KOMEILI), top], ff.clamped_ends(0.1))
    for term in (edge, top):
        assert "agree" in ff.check_derivatives(term, scene)
    scene.u.set(0.2)
    scene.set(scene.u.copy())
    found = scene.energies()
    assert found["edge"] == pytest.approx(0.5 * 0.5 * 2 * 0.2**2 * 10, rel=1e-12)
    assert found["top"] == pytest.approx(0.5 * 3.0 * 2 * 0.2**2 * 10, rel=1e-12)
    with pytest.raises(ff.InputError, match="edge marks no side of left, part of blank; expected"):
        blank.part("left").ds(near(0, 20.0))


@pytest.mark.mpi
@pytest.mark.parametrize("edge", [near(0, 0.0), None])
def test_energy_of_jumps_between_cells(edge):
    """|[grad u n]|^2 / 2 over edges, beside an energy on a marked edge and by itself."""

    class Jumps(OnAnEdge):
        def set_up(self, scene):
            if edge:
                super().set_up(scene)
            jump = ufl.jump(ufl.grad(scene.blank.u), ufl.FacetNormal(scene.blank.mesh))
            self.energy = 0.5 * ufl.inner(jump, jump) * ufl.dS + (self.energy or 0)

    scene = scene_with(term := Jumps("jumps", 0.5, edge))
    assert "agree" in ff.check_derivatives(term, scene)


FABRIC, END = ff.load("komeili"), near(0, 10.0)
PLANE = ff.Plane((0, 0, 0), (0, 0, 1))
T = FABRIC.thickness_under(0.0)
TURNED = {"frame": [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]}
SIDES = lambda x: abs(x[:2] - 5).max(0) > 4.999  # noqa: E731


def square(pattern="left", **options):
    return sheet(10, 10, 2, 2, pattern, **{"spatial": True} | options)


def stack():
    return ff.Stack([(square(), T, name) for name in "ab"], 0)


def contact(**options):
    return ff.Contact(ff.Tool(PLANE, name="table"), **{"thickness": T, "penalty": 9.0} | options)


def pair(penalty=9.0):
    return ff.SheetContact("a", "b", penalty)


def between(blank, term, membrane=None):
    return ff.Scene(blank, [membrane or ff.Membrane(FABRIC), term])


REFUSED = [
    (lambda: alone(square(degree=3), contact()), "other cells; expected P1, Q1, and P2"),
    (lambda: alone(square(), contact(where=near(0, 77.0))), "where no node is"),
    (lambda: alone(square(**TURNED), contact()), "along turned axes; expected x, y and z"),
    (lambda: ff.Tool(PLANE, force=lambda s: (1 - s, 0, s)), "0 is .* along that at full load"),
    (lambda: between(stack(), pair(None), Elastic()), "a penalty, a number above 0, as no term"),
    (lambda: between(stack(), ff.SelfContact(T, penalty=1.0)), "asked of a stack; expected one"),
    (lambda: alone(square(), ff.Springs(END, 1.0, anchor=(10, 0, 0))), "an anchor at one of their"),
    (lambda: alone(square(), ff.Gravity()), "gravity needs the mass of"),
    (lambda: alone(square(), ff.Bending(1.0, symmetric=SIDES)), "sides in more than one plane"),
    (lambda: alone(square(spatial=False), ff.Bending(1.0)), "`spatial=True`, or `in_plane`"),
    (lambda: alone(square("crossed"), ff.Bending(1.0, 1.0, 0.0, 1.1)), "no more stiffness than"),
]


@pytest.mark.parametrize("make, words", REFUSED)
def test_what_terms_refuse(make, words):
    with pytest.raises(ff.InputError, match=words):
        make()
