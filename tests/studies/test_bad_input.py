"""Bad input: one sentence that names what is wrong, exit status 2, nothing overwritten, on 1 and on
2 ranks."""

import math

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


MATERIAL = ("--material", "input.toml")
MESH = ("--mesh", "input.vtk")
CASES = {
    "count below one": (("--nx", "-3"), None, ["--nx", "-3", "1 or more"]),
    "count not a number": (("--ny", "many"), None, ["--ny", "many", "1 or more"]),
    "load of zero steps": (("--steps", "0"), None, ["--steps", "0", "1 or more"]),
    "no state ever written": (("--every", "0"), None, ["--every", "0", "1 or more"]),
    "largest step of zero": (("--max-step", "0"), None, ["--max-step", "above 0"]),
    "largest step above the load": (("--max-step", "2"), None, ["--max-step", "2", "up to 1"]),
    "negative tolerance": (("--tolerance", "-1"), None, ["--tolerance", "-1", "above 0"]),
    "tolerance not a number": (("--tolerance", "nan"), None, ["--tolerance", "nan"]),
    "strain not a number": (("--strain", "nan"), None, ["--strain", "nan", "above 0"]),
    "negative length": (("--length", "-200"), None, ["--length", "-200", "above 0"]),
    "no width": (("--width", "0"), None, ["--width", "0", "above 0"]),
    "infinite angle": (
        ("--fibre-angle", "inf"),
        None,
        ["--fibre-angle", "inf", "from -360 to 360"],
    ),
    "unknown element": (("--element", "P4"), None, ["--element", "P4", "Q2"]),
    "unknown pattern": (("--pattern", "zigzag"), None, ["--pattern", "zigzag", "crossed"]),
    "unknown solver": (
        ("--linear-solver", "magic"),
        None,
        ["--linear-solver", "magic", "mumps-cholesky"],
    ),
    "unknown model": (("--model", "steel"), None, ["--model", "steel", "fabric"]),
    "unknown coupling": (("--without", "friction"), None, ["friction", "biaxial", "tension_shear"]),
    "unknown option": (("--speed", "9"), None, ["--speed"]),
    "material not there": (("--material", "nowhere.toml"), None, ["nowhere.toml", "komeili"]),
    "material is no TOML": (
        MATERIAL,
        lambda path: (path / "input.toml").write_text("a = = 3"),
        ["input.toml", "line 1"],
    ),
    "negative thickness": (
        MATERIAL,
        toml("thickness = 1.0", "thickness = -1.0"),
        ["input.toml", "thickness", "-1.0", "above 0"],
    ),
    "value not a number": (MATERIAL, toml("b = 667.5", "b = nan"), ["input.toml", ".b", "nan"]),
    "p_min above one": (
        MATERIAL,
        toml("p_min = 0.75", "p_min = 1.5"),
        ["input.toml", "p_min", "1.5", "from 0 to 1"],
    ),
    "value in words": (MATERIAL, toml("c = 23.67", 'c = "much"'), ["input.toml", ".c", "much"]),
    "wrong unit": (
        MATERIAL,
        toml('stress = "MPa"', 'stress = "bar"'),
        ["input.toml", "stress", "bar", "MPa"],
    ),
    "wrong key": (MATERIAL, toml("p_min = 0.75", "pmin = 0.75"), ["input.toml", "pmin", "p_min"]),
    "missing key": (MATERIAL, toml("s1 = 0.02506", ""), ["input.toml", "s1"]),
    "mesh not there": (("--mesh", "nowhere.msh"), None, ["nowhere.msh"]),
    "mesh is none": (
        ("--mesh", "input.msh"),
        lambda path: (path / "input.msh").write_text("hello"),
        ["input.msh", "cannot be read"],
    ),
    "mesh of lines": (
        MESH,
        mesh(SQUARE, ("line", [[0, 1]])),
        ["input.vtk", "no surface cells", "triangle"],
    ),
    "mixed mesh": (
        MESH,
        mesh(SQUARE, ("triangle", [[0, 1, 2]]), ("quad", [[0, 1, 2, 3]])),
        ["input.vtk", "quad", "one kind"],
    ),
    "flat cell": (
        MESH,
        mesh(SQUARE, ("triangle", [[0, 1, 2], [0, 2, 2]])),
        ["input.vtk", "degenerate", "number 1"],
    ),
    "coordinate not a number": (
        MESH,
        mesh(SQUARE * [math.nan, 1, 1], ("triangle", [[0, 1, 2]])),
        ["input.vtk", "not a number", "node 0"],
    ),
    "element and mesh differ": (
        (*MESH, "--element", "Q1"),
        mesh(SQUARE, ("triangle", [[0, 1, 2], [0, 2, 3]])),
        ["--element Q1", "input.vtk"],
    ),
    "output is a file": (
        ("--out", "taken"),
        lambda path: (path / "taken").write_text("mine"),
        ["--out taken", "File exists"],
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
assert {*ON_RANKS} <= {*CASES}


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
    spoken = [
        line for line in done.err.splitlines() if line.startswith("studies/tensile.py: error: ")
    ]
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
