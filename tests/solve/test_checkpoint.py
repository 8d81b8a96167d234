"""Checkpoints: every node gets back what was its own, and a file that is not what it should be is
refused in words."""

import json

import numpy as np
import pytest
from builders import COMM, slit_strip
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.solve.checkpoint import Checkpoint
from fabric_fenicsx.solve.progress import Progress

LIP = 1e4


def slit(comm, degree, spatial=False):
    """Sheet of 8 x 2 mm with a slit from (2, 1) to (6, 1), whose lips have nodes of their own."""
    arrays = slit_strip() if comm.rank == 0 else (None,) * 3
    return ff.Blank.from_arrays(comm, *arrays, degree=degree, spatial=spatial)


def known(blank):
    """A number for each owned node: of its place and, on the slit, of the lip that it is on."""
    x, nodes = blank.coordinates(), compat.dofmap(blank.V)
    values = 100 * x[:, 0] + 10 * x[:, 1]
    cells = blank.mesh.geometry.x[compat.geometry_dofmap(blank.mesh)].mean(1)
    above = nodes[cells[:, 1] > 1]
    on_lip = (np.abs(x[above, 1] - 1) < 1e-9) & (np.abs(x[above, 0] - 4) < 2 - 1e-9)
    values[np.unique(above[on_lip])] += LIP
    return values[: blank.V.dofmap.index_map.size_local]


def progress(blank):
    """A state in which u, the state before and what terms remember follow from `known`."""
    vectors = [compat.petsc_vector(blank.u).duplicate() for _ in range(2)]
    values = known(blank)
    gdim = blank.mesh.geometry.dim
    for factor, vector in enumerate(vectors, 1):
        vector.array[:] = np.outer(factor * values, np.arange(1, gdim + 1)).ravel()
    state = {"load": 0.25, "step": 0.1, "last_step": 0.1, "work": 2.5, "stored": 2.0}
    state |= {"accepted": 3, "rejected": 1, "iterations": 9, "solver": {"shift": 0.5}}
    return Progress(*vectors, **state, memory={"0 slip": np.outer(values, [3, 4, 5.0])})


@pytest.mark.versions
@pytest.mark.mpi
@pytest.mark.parametrize("degree, spatial", [(1, True), (2, False), (3, False)])
@pytest.mark.parametrize("alone", [True, False])
def test_lips_of_a_slit_are_not_mixed_up(shared_path, degree, spatial, alone):
    """Written on one rank or on all, read on all."""
    if not alone or COMM.rank == 0:
        blank = slit(MPI.COMM_SELF if alone else COMM, degree, spatial)
        state = progress(blank)
        state.memory["cells 1 strain"] = of_cells(blank)
        Checkpoint(shared_path / "c.npz", blank, {"a": 1}).save(state, {"n": [1]})
    COMM.barrier()
    blank = slit(COMM, degree, spatial)
    expected = progress(blank)
    expected.memory["cells 1 strain"] = of_cells(blank)
    loaded, notes = Checkpoint(shared_path / "c.npz", blank, {"a": 1}).load(expected.memory)
    assert notes == {"n": [1]}
    assert (loaded.load, loaded.accepted, loaded.solver) == (0.25, 3, {"shift": 0.5})
    assert COMM.allreduce(int((known(blank) >= LIP).sum())) == {1: 3, 2: 7, 3: 11}[degree]
    for mine, other in ((loaded.x, expected.x), (loaded.previous, expected.previous)):
        assert np.allclose(mine.array, other.array, rtol=0, atol=1e-9)
    assert sorted(loaded.memory) == sorted(expected.memory)
    for name, values in expected.memory.items():
        assert np.allclose(loaded.memory[name], values, rtol=0, atol=1e-9)


def of_cells(blank):
    """Two numbers for each owned cell, of its centre."""
    x = blank.midpoints()
    return np.column_stack([100 * x[0] + 10 * x[1], x[1] ** 2])


def changed(path, **changes):
    """Entries of the file replaced, its checksum as it was."""
    arrays = dict(np.load(path))
    np.savez(path, **arrays | {name: change(arrays[name]) for name, change in changes.items()})


def of_format_9(meta):
    return np.array(json.dumps(json.loads(str(meta)) | {"format": 9}))


BROKEN = {
    "no file": (lambda path: path.unlink(), "finds no checkpoint"),
    "cut off": (lambda path: path.write_bytes(path.read_bytes()[:-200]), "cannot be read"),
    "version": (lambda path: changed(path, meta=of_format_9), "format 9; this version reads 10"),
    "displacement": (lambda path: changed(path, u=lambda u: 2 * u), "another checksum"),
}


@pytest.mark.mpi
@pytest.mark.parametrize("case", BROKEN)
def test_what_is_wrong_with_a_checkpoint_is_said_on_all_ranks(shared_path, case):
    (spoil, words), blank, path = BROKEN[case], slit(COMM, 1), shared_path / "c.npz"
    (checkpoint := Checkpoint(path, blank, {"a": 1})).save(state := progress(blank), {})
    if COMM.rank == 0:
        spoil(path)
    COMM.barrier()
    with pytest.raises(ff.InputError, match=words) as error:
        checkpoint.load(state.memory)
    assert str(path) in str(error.value)


@pytest.mark.mpi
def test_a_checkpoint_of_another_problem_or_mesh_is_refused(shared_path):
    blank, path = slit(COMM, 1), shared_path / "c.npz"
    state, given = progress(blank), {"a": 2}
    Checkpoint(path, blank, given).save(state, {})
    COMM.barrier()
    slip = state.memory["0 slip"]
    for sheet, problem, memory, words in (
        (blank, {"a": 1}, None, "made with a = 2, now it is 1"),
        (blank, given, {"0 slip": slip[:, :2]}, "where the terms have 0 slip .2,.$"),
        (blank, given, {"0 slip": slip, "3 d": slip}, "terms have 0 slip .3,., 3 d .3,.$"),
        (slit(COMM, 2), given, None, "is of another mesh, with 30 nodes; now there are"),
        (slit(COMM, 1, True), given, None, "is of another mesh, with 30 nodes; now there are"),
    ):
        with pytest.raises(ff.InputError, match=words):
            Checkpoint(path, sheet, problem).load(memory)
    blank.mesh.geometry.x[:] *= 1 + 1e-8
    with pytest.raises(ff.InputError, match="with 30 nodes; now there are 30, or they lie elsewh"):
        Checkpoint(path, blank, given).load()


def test_a_run_with_more_stages_goes_on_at_its_share_of_the_load(shared_path):
    """6 of 16 steps; work and energies stay."""
    blank, stages = slit(COMM, 1), "steps of stages"
    path, first = shared_path / "c.npz", {"1": 2, "2": 4}
    notes = {"rows": [{"load": 0.25, "step": 1}], "states": [[0.25, [0]]]}
    Checkpoint(path, blank, {stages: first}).save(progress(blank), notes)
    loaded, notes = Checkpoint(path, blank, {stages: first | {"3": 10}}).load()
    at = loaded.load, loaded.step, loaded.last_step, loaded.work, loaded.stored
    assert at == pytest.approx((0.25 * 0.375, 0.0375, 0.0375, 2.5, 2.0))
    assert notes == {"rows": [{"load": 0.09375, "step": 1}], "states": [(0.09375, [0])]}
    with pytest.raises(ff.InputError, match="made with steps of stages = "):
        Checkpoint(path, blank, {stages: {"1": 3, "2": 4, "3": 10}}).load()
