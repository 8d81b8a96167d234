"""Bad input of studies, and own meshes and outlines."""

import meshio
import numpy as np
import pytest
from builders import dome
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import Study, parser
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.coupons.tensile import Tensile
from fabric_fenicsx.material.presets import PRESETS
from fabric_fenicsx.sheet.specimen import specimen

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
RUNS = [pytest.param(case, 1, marks=[pytest.mark.mpi] * (case in ON_RANKS)) for case in CASES]


@pytest.mark.parametrize("case, ranks", [*RUNS, ("mesh of lines", 2)])
def test_bad_input(launch, shared_path, case, ranks):
    """Under mpirun all processes end; on the ranks of the test all refuse."""
    options, prepare, words = CASES[case]
    earlier = shared_path / "out" / "summary.json"
    if COMM.rank == 0:
        if prepare:
            prepare(shared_path)
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
    if (shared_path / "taken").is_file():
        assert (shared_path / "taken").read_text() == "mine"


@pytest.fixture
def study(shared_path):
    """Function of a coupon, the points and cells of its mesh, and words, to the `Study`."""

    def make(coupon, mesh, *words):
        if COMM.rank == 0:
            points, cells, kind = mesh
            meshio.write_points_cells(shared_path / "s.vtk", points, [(kind, cells)])
        COMM.barrier()
        files = "--mesh", str(shared_path / "s.vtk"), "--out", str(shared_path / "out")
        return Study("coupon", parser(coupon, ""), [*files, *words])

    return make


@pytest.mark.mpi
@pytest.mark.parametrize("turned", [0.0, 0.5])
def test_length_and_width_are_the_meshs_own(study, turned):
    points, cells, kind = specimen(120, 30, 12, 3)
    c, s = np.cos(turned), np.sin(turned)
    points[:, :2] = points[:, :2] @ [[c, s], [-s, c]] + 7
    mine = study(Tensile, (points, cells, kind), "--turned", str(np.degrees(turned)))
    mine.build(mine.describe(Tensile))
    assert (mine.args.length, mine.args.width) == (120, 30)
    assert (mine.args.nx, mine.args.ny, mine.args.pattern) == (None, None, None)
    mine.build(mine.describe(Tensile))  # as for a second part
    assert (mine.args.length, mine.args.width, mine.output.warnings) == (120, 30, [])


@pytest.mark.parametrize("name, value", [("length", 120.5), ("width", 50)])
def test_a_length_that_is_not_the_meshs_is_refused(study, name, value):
    mine = study(Tensile, specimen(120, 30, 12, 3), f"--{name}", str(value))
    own = {"length": 120, "width": 30}[name]
    with pytest.raises(InputError, match=f"`{name}` {value} does not fit `mesh` .*, of {own} mm"):
        mine.build(mine.describe(Tensile))


def test_a_quarter_is_half_as_long_as_its_ply(tmp_path):
    points, cells, kind = specimen(200, 120, 10, 6, "left")
    meshio.write_points_cells(tmp_path / "s.vtk", points, [(kind, cells)])
    found = ff.Press.read("double_dome", [f"blank.mesh={tmp_path / 's.vtk'}"]).build().resolved
    assert (found["length"], found["width"], found["nx"]) == (400, 240, None)


@pytest.fixture
def table(tmp_path):
    """Function of length and width to a file of a rectangle with its low x at `start`."""

    def write(length, width, start=0, name="ply.csv"):
        rows = [(start, 0), (start + length, 0), (start + length, width), (start, width)]
        (tmp_path / name).write_text("\n".join(["x,y", *(f"{x},{y}" for x, y in rows)]))
        return str(tmp_path / name)

    return write


def test_a_strip_has_cells_of_the_size(table, tmp_path):
    out = "--out", str(tmp_path / "out")
    words = ["--outline", table(120, 30), "--size", "5", *out]
    study = Study("tensile", parser(Tensile, ""), words)
    strip = study.build(study.describe(Tensile))
    data = strip.data
    assert (data.length, data.width, data.nx, data.pattern) == (120, 30, None, "unstructured")
    assert strip.blank.mesh.topology.index_map(2).size_global == pytest.approx(332, rel=0.1)
    assert not strip.warnings and strip.coarser().size == 10


def test_errors_are_estimated_from_coarser_cells(table):
    result = Tensile(outline=table(120, 30), size=5).job(steps=2, error=True).run()
    assert 0 < result.summary["error"]["reaction_N"] < 0.2 * result.summary["reaction_N"]


def test_planes_of_symmetry_cut_a_whole_outline(table):
    made = {"outline": table(500, 300), "size": 40, "fibre_angle": 30, "centred": True}
    ply = dome(**made, full=True)
    assert np.ravel(ply.scene.blank.extent()) == pytest.approx([-250, -150, 0, 250, 150, 0])
    ply = dome(**made, full=False)
    assert np.ravel(ply.scene.blank.extent()) == pytest.approx([0, 0, 0, 250, 150, 0])
    with pytest.raises(ff.InputError, match="not symmetric about x = 0"):
        dome(**made | {"centred": False, "outline": table(500, 300, -100)}, full=False)
