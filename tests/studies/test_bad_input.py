"""Bad input: one sentence that names what is wrong, exit status 2, nothing overwritten, on 1 and on
2 ranks."""

import meshio
import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.material.presets import PRESETS

COMM = MPI.COMM_WORLD
KOMEILI = PRESETS["komeili"].dumps()
SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])


def toml(old, new):
    assert old in KOMEILI
    return lambda path: (path / "input.toml").write_text(KOMEILI.replace(old, new, 1))


def mesh(points, *blocks):
    return lambda path: meshio.write_points_cells(path / "input.vtk", points, list(blocks))


MATERIAL, MESH = ("--material", "input.toml"), ("--mesh", "input.vtk")
TRIANGLES, LINES = ("triangle", [[0, 1, 2], [0, 2, 3]]), ("line", [[0, 1]])
# options, what is there before, and words of the sentence: one case a door
CASES = {
    "count below one": (("--nx", "-3"), None, ["--nx", "-3", "1 or more"]),
    "material not there": (("--material", "nowhere.toml"), None, ["nowhere.toml", "komeili"]),
    "negative thickness": (
        MATERIAL,
        toml("thickness = 1.0", "thickness = -1.0"),
        ["input.toml", "thickness", "-1.0", "above 0"],
    ),
    "mesh not there": (("--mesh", "nowhere.msh"), None, ["nowhere.msh"]),
    "mesh of lines": (MESH, mesh(SQUARE, LINES), ["input.vtk", "no surface cells", "triangle"]),
    "element and mesh differ": (
        (*MESH, "--element", "Q1"),
        mesh(SQUARE, TRIANGLES),
        ["--element Q1", "input.vtk"],
    ),
    "output below a file": (
        ("--out", "taken/deep"),
        lambda path: (path / "taken").write_text("mine"),
        ["--out taken/deep", "Not a directory"],
    ),
    "nothing to resume": (("--resume",), None, ["--resume", "checkpoint"]),
}


# On ranks: a word, a value and a mesh in a file, and files that one rank looks for.
ON_RANKS = "count below one", "negative thickness", "mesh not there", "nothing to resume"


@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=pytest.mark.mpi) if case in ON_RANKS else case for case in CASES],
)
def test_bad_input(launch, shared_path, case):
    is_refused(launch, shared_path, case)


def test_bad_input_ends_all_processes(launch, shared_path):
    """Under mpirun; that all ranks refuse each case the test above asks when it runs on ranks."""
    is_refused(launch, shared_path, "mesh of lines", ranks=2)


def is_refused(launch, folder, case, ranks=1):
    options, prepare, words = CASES[case]
    earlier = folder / "out" / "summary.json"
    if COMM.rank == 0:
        if prepare:
            prepare(folder)
        earlier.parent.mkdir()
        earlier.write_text("{}")
    COMM.barrier()
    done = launch("tensile", "--quick", *options, ranks=ranks, out="--out" not in options)
    assert done.status == 2, done.err
    begin = "studies/tensile.py: error: "
    spoken = [line for line in done.err.splitlines() if line.startswith(begin)]
    assert len(spoken) == 1 and "Traceback" not in done.err
    for word in words:
        assert word in spoken[0]
    assert earlier.read_text() == "{}"
    assert [p.name for p in earlier.parent.iterdir()] == ["summary.json"]
    if (folder / "taken").is_file():
        assert (folder / "taken").read_text() == "mine"


def test_a_strip_too_short_for_full_shear(launch):
    done = launch("bias_extension", "--quick", "--length", 80)
    assert done.status == 2 and "80 mm long and 50 mm wide" in done.err
