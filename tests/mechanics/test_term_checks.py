"""What own terms get wrong is named, on all ranks, before a run is wrong or waits for ever."""

import numpy as np
import pytest
import ufl
from builders import Springs, alone, near, sheet
from dolfinx import fem
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.scene import reports

COMM = MPI.COMM_WORLD
KOMEILI = ff.load("komeili")
pytestmark = pytest.mark.mpi


def scene_with(term):
    return ff.Scene(sheet(20.0, 10.0, 4, 2), [ff.Membrane(KOMEILI), term], ff.clamped_ends(0.1))


def run(term):
    return ff.Job(scene_with(term), steps=1).run()


def with_own(method, does):
    return type("Mine", (Springs,), {method: does, "recall": lambda self, memory: None})()


def moved(self, by):
    """The tangent's triplets, with the first row further by this, on the last rank alone."""
    rows, cols, values = Springs.tangent(self)
    rows[:1] += by * (COMM.rank == COMM.size - 1)
    return rows, cols, values


@pytest.mark.parametrize(
    "tangent, words",
    [
        (lambda self: Springs.tangent(self)[1:], r"gives \(array.*; allowed are rows, columns and"),
        (
            lambda self: (*Springs.tangent(self)[:2], np.ones(3)),
            r"gives arrays of shapes \(\d+,\), .*, \(3,\);",
        ),
        (lambda self: (*Springs.tangent(self)[:2], 3.0), r"gives arrays of shapes .*, \(\);"),
        (lambda self: np.eye(5), r"gives array\("),
        (lambda self: moved(self, 10**6), r"gives the degree of freedom 1000\d\d\d; .*, 0 to \d+$"),
    ],
)
def test_a_tangent_that_is_none(tangent, words):
    mine = with_own("tangent", tangent)
    with pytest.raises(ff.InputError, match="`tangent` of term springs " + words):
        run(mine)
    mine = with_own("tangent", tangent)
    with pytest.raises(ff.InputError, match=words):
        ff.check_derivatives(mine, scene_with(mine))


def test_a_tangent_of_lists():
    mine = with_own("tangent", lambda self: [list(part) for part in Springs.tangent(self)])
    assert "agree" in ff.check_derivatives(mine, scene_with(mine))


def test_a_tangent_whose_places_change():
    asked = []

    def tangent(self):
        asked.append(1)
        return tuple(part[: -1 if len(asked) > 2 else None] for part in Springs.tangent(self))

    with pytest.raises(ff.InputError, match="other places than before; .* unless `pattern` counts"):
        run(with_own("tangent", tangent))


def test_places_that_depend_on_the_displacement_are_told():
    def tangent(self):
        pushed = (self.u() > 0.0) & (COMM.rank == 0)
        return tuple(part[pushed] for part in Springs.tangent(self))

    mine = with_own("tangent", tangent)
    with pytest.raises(ff.InputError, match="springs gives other places where the sheet is else"):
        ff.check_derivatives(mine, scene_with(mine), size=1e-3)


def test_forces_that_are_returned():
    def add_forces(self, f):
        return f + 1.0

    with pytest.raises(ff.InputError, match="`add_forces` of term springs returns something; al"):
        run(with_own("add_forces", add_forces))


def test_forces_in_place_of_others():
    """Alone in the array they are right."""

    def add_forces(self, f):
        f[: len(self.u())] = self.k * self.u()

    mine = with_own("add_forces", add_forces)
    with pytest.raises(ff.InputError, match="springs loses what other terms added; allowed is to"):
        ff.check_derivatives(mine, scene_with(mine))


@pytest.mark.parametrize("method", ["stored", "work"])
@pytest.mark.parametrize("value", [None, np.ones(3)])
def test_energies_and_work_that_are_no_number(method, value):
    with pytest.raises(ff.InputError, match=f"`{method}` of term springs gives .*; allowed is one"):
        run(with_own(method, lambda self: value))


def test_an_energy_that_no_work_has_gone_into_is_told():
    def told(energy):
        mine = with_own("stored", lambda self: Springs.stored(self) + energy)
        return ff.check_derivatives(mine, scene_with(mine))

    assert f"as it lies is {3.0 * COMM.size:g} N mm, without a force: take it off" in told(3.0)
    assert "as it lies" not in told(0.0)


@pytest.mark.parametrize("k, words", [(0.0, "gives no forces here: nothing was compared"), (1, "")])
def test_a_term_without_forces_is_told(k, words):
    mine = Springs(k)
    table = ff.check_derivatives(mine, scene_with(mine))
    assert ("nothing was compared" in table) == bool(words) and words in table


@pytest.mark.parametrize(
    "energy, words",
    [
        (lambda u, dx: ufl.inner(u, ufl.TestFunction(u.ufl_function_space())) * dx, "has test or"),
        (lambda u, dx: fem.Constant(u.function_space.mesh, 2.0) * dx, "does not depend on the dis"),
    ],
)
def test_a_form_that_is_no_energy_of_the_displacement(energy, words):
    class Mine(ff.Term):
        name = energy_kind = "mine"

        def set_up(self, scene):
            self.energy = energy(scene.blank.u, self.part.dx(2))

    with pytest.raises(ff.InputError, match=f"energy of term mine {words}.*; allowed is"):
        alone(sheet(20.0, 10.0, 2, 1), Mine())


@pytest.mark.parametrize("k", [1, "1"])
def test_a_constant_that_is_no_float(k):
    class Mine(ff.Term):
        name = energy_kind = "mine"

        def set_up(self, scene):
            u = scene.blank.u
            self.energy = fem.Constant(scene.blank.mesh, k) * ufl.inner(u, u) * self.part.dx(2)

    with pytest.raises(ff.InputError, match=r"in `fem.Constant` that is no float; .*, float\(k\)"):
        alone(sheet(20.0, 10.0, 2, 1), Mine())


@pytest.mark.parametrize(
    "name, value, words",
    [
        ("resists", ("shift",), "allowed is a tuple of move, turn, lift, slide, stretch"),
        ("resists", "move", "allowed is a tuple of"),
    ],
)
def test_words_that_are_none(name, value, words):
    with pytest.raises(ff.InputError, match=f"`{name}` of term springs is .*; {words}"):
        alone(sheet(20.0, 10.0, 2, 1), with_own(name, value))


@pytest.mark.parametrize("term", [Springs, lambda u: u, None])
def test_what_is_no_term(term):
    with pytest.raises(ff.InputError, match="a term of the scene is .*; allowed are objects of"):
        scene_with(term)


def giving(**values):
    return lambda self: values


@pytest.mark.parametrize(
    "method, does, words",
    [
        ("history", giving(hits=np.ones(3)), "column hits, of type ndarray; allowed is what"),
        ("history", giving(hits=np.int64(3)), "column hits, of type int64; allowed is what"),
        ("summary", giving(hits=np.ones(3)), "entry hits, of type ndarray; allowed is what"),
        ("summary", giving(converged=3), "entry converged, which summary.json has already"),
        ("summary", giving(cells=3), "entry cells, which summary.json has already"),
        ("summary", lambda self: None, "returns NoneType; allowed is a dict {entry: value}"),
        ("nodal_fields", giving(u=3), r"field u with shape \(\); allowed is"),
        ("nodal_fields", giving(hits=["a"]), "field hits with"),
        ("cell_fields", lambda self: 3, "returns int; allowed is a dict {field: value}"),
        ("memory", lambda self: {"hits": np.ones(3)}, r"array hits with shape \(3,\); allowed is"),
        ("memory", lambda self: {"hits": 3.0}, r"array hits with shape \(\); allowed is"),
    ],
)
def test_what_cannot_be_told_or_kept(method, does, words):
    with pytest.raises(ff.InputError, match=f"`{method}` of term springs .*{words}"):
        run(with_own(method, does))


@pytest.mark.parametrize("method", ["memory", "cell_memory"])
def test_a_memory_that_is_not_taken_back(method):
    mine = type("Mine", (Springs,), {method: lambda self: {}})()
    with pytest.raises(ff.InputError, match=f"springs has `{method}` but no `recall`; allowed are"):
        scene_with(mine)


def test_a_field_that_the_sheet_has():
    def nodal_fields(self):
        return {"u": self.blank.nodal_displacement()[: len(self.part.nodes)]}

    with pytest.raises(ff.InputError, match="field u, which the sheet has already; allowed is ano"):
        run(with_own("nodal_fields", nodal_fields))


def test_a_field_of_a_list():
    mine = with_own("cell_fields", lambda self: {"hits": [1.0] * self.part.cells.size})
    assert (run(mine).fields["hits"] == 1).all()


def test_a_warning_by_itself():
    mine = with_own("warnings", lambda self: "look here")
    assert "look here" in reports.warnings(scene_with(mine))


class OnAnEdge(ff.Term):
    """Springs k [N/mm^2] from an edge to a frame: k |u|^2 / 2."""

    def __init__(self, name, k, edge):
        self.name = self.energy_kind = name
        self.k, self.edge = k, edge

    def set_up(self, scene):
        u, k = scene.blank.u, fem.Constant(scene.blank.mesh, self.k)
        self.energy = 0.5 * k * ufl.inner(u, u) * self.part.ds(self.edge, 2)


@pytest.mark.parametrize("last", [False, True])
def test_energies_on_two_edges(last):
    """UFL takes one set of marked edges in a form."""
    left, top = OnAnEdge("left", 0.5, near(0, 0.0)), OnAnEdge("top", 3.0, near(1, 10.0))
    membrane = ff.Membrane(KOMEILI)
    blank = sheet(20.0, 10.0, 4, 2)
    terms = [left, top, membrane] if last else [membrane, left, top]
    scene = ff.Scene(blank, terms, ff.clamped_ends(0.1))
    for term in (left, top):
        assert "agree" in ff.check_derivatives(term, scene)
    scene.u.set(0.2)
    scene.set(scene.u.copy())
    found = scene.energies()
    assert found["left"] == pytest.approx(0.5 * 0.5 * 2 * 0.2**2 * 10, rel=1e-12)
    assert found["top"] == pytest.approx(0.5 * 3.0 * 2 * 0.2**2 * 20, rel=1e-12)
    scene.u.set(0.0)
    assert ff.Job(scene, steps=4).run().summary["energy_imbalance"] < 0.01


def test_an_edge_of_a_part():
    blank = sheet(20.0, 10.0, 4, 2)
    blank.divide({"left": lambda x: x[0] < 10}, rest="right")
    term = OnAnEdge("springs", 2.0, near(1, 10.0)).on("left")
    scene = ff.Scene(blank, [ff.Membrane(KOMEILI), term], ff.clamped_ends(0.1))
    scene.u.set(1.0)
    scene.set(scene.u.copy())
    assert scene.energies()["springs"] == pytest.approx(0.5 * 2.0 * 2 * 10, rel=1e-12)
    with pytest.raises(
        ff.InputError, match="edge marks no side of left, part of blank; allowed is"
    ):
        blank.part("left").ds(near(0, 20.0))
