"""Checkpoints: every node gets back what was its own, and a file that is not what it should be is
refused in words."""

import json
from pathlib import Path

import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.sheets.blank import Blank
from fabric_fenicsx.solve.checkpoint import Checkpoint
from fabric_fenicsx.solve.stepping import Progress, Viscosity

COMM = MPI.COMM_WORLD
LIP = 1e4


def slit(comm, degree, spatial=False):
    """Sheet of 8 x 2 mm with a slit from (2, 1) to (6, 1), whose lips have nodes of their own."""
    points, cells, kind = specimen(8, 2, 8, 2, "right")
    lips = np.flatnonzero((points[:, 1] == 1) & (points[:, 0] > 2) & (points[:, 0] < 6))
    own = np.arange(len(points))
    own[lips] = len(points) + np.arange(len(lips))
    cells = np.where((points[cells, 1].mean(1) > 1)[:, None], own[cells], cells)
    arrays = (np.vstack([points, points[lips]]), cells, kind) if comm.rank == 0 else (None,) * 3
    return Blank.from_arrays(comm, *arrays, degree=degree, spatial=spatial)


def known(blank):
    """A number for each owned node: of its place and, on the slit, of the lip that it is on."""
    x, nodes = blank.coordinates(), compat.dofmap(blank.V)
    values = 100 * x[:, 0] + 10 * x[:, 1]
    cells = blank.mesh.geometry.x[compat.geometry_dofmap(blank.mesh)].mean(1)
    above = nodes[cells[:, 1] > 1]
    on_lip = (np.abs(x[above, 1] - 1) < 1e-9) & (np.abs(x[above, 0] - 4) < 2 - 1e-9)
    values[np.unique(above[on_lip])] += LIP
    return values[: blank.V.dofmap.index_map.size_local]


def progress(blank, **changes):
    """A state in which u, the state before and what terms remember follow from `known`."""
    vectors = [compat.petsc_vector(blank.u).duplicate() for _ in range(2)]
    values = known(blank)
    gdim = blank.mesh.geometry.dim
    for factor, vector in enumerate(vectors, 1):
        vector.array[:] = np.outer(factor * values, np.arange(1, gdim + 1)).ravel()
    memory = {"0 slip": np.outer(values, [3, 4, 5.0])}
    costs = {"accepted": 3, "rejected": 1, "iterations": 9}
    state = {
        "load": 0.25,
        "step": 0.1,
        "last_step": 0.1,
        "work": 2.5,
        "stored": 2.0,
        "memory": memory,
        "solver": {"shift": 0.5},
    }
    return Progress(
        x=vectors[0], previous=vectors[1], viscosity=Viscosity(), **(state | costs | changes)
    )


@pytest.mark.versions
@pytest.mark.mpi
@pytest.mark.parametrize("degree, spatial", [(1, False), (2, False), (3, False), (1, True)])
@pytest.mark.parametrize("alone", [True, False])
def test_lips_of_a_slit_are_not_mixed_up(shared_path, degree, spatial, alone):
    """Written on one rank or on all, read on all."""
    if alone and COMM.rank == 0:
        blank = slit(MPI.COMM_SELF, degree, spatial)
        Checkpoint(shared_path / "c.npz", blank, {"a": 1}).save(progress(blank), {"n": [1]})
    elif not alone:
        blank = slit(COMM, degree, spatial)
        Checkpoint(shared_path / "c.npz", blank, {"a": 1}).save(progress(blank), {"n": [1]})
    COMM.barrier()
    blank = slit(COMM, degree, spatial)
    expected = progress(blank)
    found, notes = Checkpoint(shared_path / "c.npz", blank, {"a": 1}).load(
        expected.memory, {"shift": 0.0}
    )
    assert notes == {"n": [1]}
    assert (found.load, found.accepted, found.solver) == (
        0.25,
        3,
        {"shift": 0.5},
    )
    assert COMM.allreduce(int((known(blank) >= LIP).sum())) == {1: 3, 2: 7, 3: 11}[degree]
    for mine, other in ((found.x, expected.x), (found.previous, expected.previous)):
        assert np.allclose(mine.array, other.array, rtol=0, atol=1e-9)
    assert np.allclose(found.memory["0 slip"], expected.memory["0 slip"], rtol=0, atol=1e-9)


def of_cells(blank):
    """Two numbers for each owned cell, of its centre."""
    x = blank.midpoints()
    return np.column_stack([100 * x[0] + 10 * x[1], x[1] ** 2])


@pytest.mark.mpi
@pytest.mark.parametrize("alone", [True, False])
def test_cells_get_back_what_was_their_own(shared_path, alone):
    """Written on one rank or on all, read on all."""
    comm = MPI.COMM_SELF if alone else COMM
    if not alone or COMM.rank == 0:
        blank = slit(comm, 1)
        state = progress(blank)
        state.memory["cells 1 strain"] = of_cells(blank)
        Checkpoint(shared_path / "c.npz", blank, {}).save(state, {})
    COMM.barrier()
    blank = slit(COMM, 1)
    expected = progress(blank).memory | {"cells 1 strain": of_cells(blank)}
    found, _ = Checkpoint(shared_path / "c.npz", blank, {}).load(expected)
    assert sorted(found.memory) == sorted(expected)
    for name, values in expected.items():
        assert np.allclose(found.memory[name], values, rtol=0, atol=1e-9)


CELLS_BROKEN = {
    "no centres": (lambda arrays: arrays.pop("centres"), "centres is missing"),
    "moved centres": (
        lambda arrays: arrays.update(centres=arrays["centres"] + 1e-3),
        "is of another mesh, with 32 cells, now there are 32 or they lie elsewhere",
    ),
    "short": (
        lambda arrays: arrays.update({"memory cells 1 strain": np.zeros((31, 2))}),
        r"memory cells 1 strain has shape \(31, 2\) where \(32, 2\) should be",
    ),
    "all at one place": (
        lambda arrays: arrays.update(centres=np.repeat(arrays["centres"][:1], 32, 0)),
        "is of another mesh",
    ),
}


@pytest.mark.parametrize("case", CELLS_BROKEN)
def test_what_is_wrong_with_memories_of_cells_is_said(tmp_path, case):
    spoil, words = CELLS_BROKEN[case]
    blank = slit(MPI.COMM_SELF, 1)
    state = progress(blank)
    state.memory["cells 1 strain"] = of_cells(blank)
    checkpoint = Checkpoint(tmp_path / "c.npz", blank, {})
    checkpoint.save(state, {})
    with np.load(tmp_path / "c.npz") as file:
        arrays = dict(file)
    spoil(arrays)
    np.savez(tmp_path / "c.npz", **arrays)
    with pytest.raises(InputError, match=words):
        checkpoint.load(state.memory)


def meta(**changes):
    """Change of the meta data; None takes a key away."""

    def change(arrays):
        now = json.loads(str(arrays["meta"])) | changes
        arrays["meta"] = np.array(json.dumps({k: v for k, v in now.items() if v is not None}))

    return change


def spoilt(name, value, at=0):
    def change(arrays):
        arrays[name] = arrays[name].copy()
        arrays[name].flat[at] = value

    return change


def array(name, make):
    def change(arrays):
        arrays[name] = make(arrays[name])

    return change


def turned(content, at):
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


VISCOSITY = {"drag": 0.0, "energy": 0.0, "stiffness": 0.0, "easy_steps": 0, "easy_steps_asked": 1}
BROKEN = {
    "no file": (lambda path: path.unlink(), "finds no checkpoint"),
    "a folder": (lambda path: (path.unlink(), path.mkdir()), "finds no checkpoint"),
    "empty": (lambda path: path.write_bytes(b""), "cannot be read"),
    "text": (lambda path: path.write_text("hello"), "cannot be read"),
    "cut off": (lambda path: path.write_bytes(path.read_bytes()[:-200]), "cannot be read"),
    "cut in the middle": (lambda path: path.write_bytes(path.read_bytes()[:900]), "cannot be read"),
    "a bit turned": (
        lambda path: path.write_bytes(turned(path.read_bytes(), 1000)),
        "cannot be read",
    ),
    "no meta data": (lambda arrays: arrays.pop("meta"), "cannot be read"),
    "meta data that are no JSON": (array("meta", lambda _: np.array("{load:")), "cannot be read"),
    "meta data that are a list": (
        array("meta", lambda _: np.array("[1]")),
        "is of format None; allowed is 6",
    ),
    "earlier version": (meta(format=None), "is of format 1; allowed is 6"),
    "later version": (meta(format=7), "is of format 7; allowed is 6"),
    "no displacement": (lambda arrays: arrays.pop("u"), "u is missing"),
    "no place": (lambda arrays: arrays.pop("around"), "around is missing"),
    "short displacement": (
        array("u", lambda u: u[:-1]),
        r"u has shape \(29, 2\) where \(30, 2\) should be",
    ),
    "short state before": (array("previous", lambda u: u[:5]), r"previous has shape \(5, 2\)"),
    "short memory": (
        array("memory 0 slip", lambda m: m[:-1]),
        r"memory 0 slip has shape \(29, 3\)",
    ),
    "narrow memory": (
        array("memory 0 slip", lambda m: m[:, :2]),
        r"memory 0 slip has shape \(30, 2\)",
    ),
    "flat places": (array("x", lambda x: x[:, :2]), r"x has shape \(30, 2\) where \(30, 3\)"),
    "a single place": (array("x", lambda x: x[0, 0]), r"x has shape \(\)"),
    "NaN in u": (spoilt("u", np.nan, 7), "u has values that are no finite numbers"),
    "inf in the state before": (spoilt("previous", np.inf), "previous has values that are no"),
    "NaN in a memory": (
        spoilt("memory 0 slip", np.nan, -1),
        "memory 0 slip has values that are no",
    ),
    "NaN in a place": (spoilt("x", np.nan), "x has values that are no"),
    "words in u": (array("u", lambda u: u.astype(str)), "u has values that are no finite numbers"),
    "a memory of nothing": (
        lambda arrays: arrays.update({"memory 3 depth": arrays["u"]}),
        "remembers 0 slip, 3 depth where 0 slip should be",
    ),
    "a memory lost": (
        lambda arrays: arrays.pop("memory 0 slip"),
        "remembers nothing where 0 slip should be",
    ),
    "no load": (meta(load=None), "load is missing"),
    "load not a number": (meta(load=float("nan")), "load is nan"),
    "load of two": (meta(load=2), "load is 2 and step 0.1"),
    "step of zero": (meta(step=0), "load is 0.25 and step 0"),
    "work in words": (meta(work="much"), "work is 'much'"),
    "half a step": (meta(accepted=2.5), "accepted is 2.5"),
    "no viscosity": (meta(viscosity=[]), r"viscosity is \[\]"),
    "part of a viscosity": (meta(viscosity={"drag": 0}), "viscosity has drag where drag, energy"),
    "viscosity not a number": (
        meta(viscosity=VISCOSITY | {"stiffness": float("nan")}),
        "stiffness is nan",
    ),
    "what no solver knows": (meta(solver={"speed": 1}), "solver has speed where shift should be"),
    "shift not a number": (meta(solver={"shift": float("inf")}), "shift is inf"),
    "another problem": (meta(problem={"a": 2}), "made with a = 2, now it is 1"),
    "no problem": (meta(problem=7), "problem is 7"),
    "moved mesh": (
        array("x", lambda x: x + 1e-3),
        "is of another mesh, with 30 nodes, now there are 30",
    ),
    "turned slit": (array("around", lambda a: -a), "is of another mesh"),
}
OF_FILES = list(BROKEN)[:7]


@pytest.mark.mpi
@pytest.mark.parametrize("case", BROKEN)
def test_what_is_wrong_with_a_checkpoint_is_said_on_all_ranks(shared_path, case):
    spoil, words = BROKEN[case]
    blank = slit(COMM, 1)
    state, path = progress(blank), Path(shared_path / "c.npz")
    checkpoint = Checkpoint(path, blank, {"a": 1})
    checkpoint.save(state, {})
    if COMM.rank == 0:
        if case in OF_FILES:
            spoil(path)
        else:
            with np.load(path) as file:
                arrays = dict(file)
            spoil(arrays)
            np.savez(path, **arrays)
    COMM.barrier()
    with pytest.raises(InputError, match=words) as error:
        checkpoint.load(state.memory, {"shift": 0.0})
    assert str(path) in str(error.value) and "; allowed is" in str(error.value)


@pytest.mark.mpi
def test_nodes_that_nothing_tells_apart_are_refused(shared_path):
    """Two squares on each other, back to back at one edge, which no mesh check has seen."""
    points = np.array([[0, 0], [0, 1], [1, 0], [1, 1], [1, 0], [1, 1.0]])
    cells = np.array([[0, 2, 1, 3], [0, 4, 1, 5]])
    mine = (cells, points) if COMM.rank == 0 else (cells[:0], points[:0])
    blank = Blank(compat.create_mesh(COMM, *mine, "quadrilateral", 1))
    checkpoint = Checkpoint(shared_path / "c.npz", blank, {})
    checkpoint.save(progress(blank), {})
    COMM.barrier()
    with pytest.raises(InputError, match="lie at one place amid the same cells"):
        checkpoint.load()
