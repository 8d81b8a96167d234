"""Tests as dataclasses: their fields are checked, and scripts have the same ones."""

import dataclasses

import numpy as np
import pytest
from builders import COMM
from mpi4py import MPI
from scipy.spatial import Delaunay

import fabric_fenicsx as ff
from fabric_fenicsx.command_line.study import parser
from fabric_fenicsx.forming.dome import DIMENSIONS
from fabric_fenicsx.meshes.double_dome import double_dome

SCENARIOS = ff.Tensile, ff.BiasExtension, ff.PictureFrame, ff.Forming


def built(test):
    """The `Setup` of a coupon, or a `Forming`, which is one by itself."""
    return test.build() if hasattr(test, "build") else test


@pytest.mark.parametrize("kind", SCENARIOS)
def test_options_are_the_fields_with_their_defaults(kind):
    options = vars(parser(kind, "").parse_args([]))
    for each in dataclasses.fields(kind):
        if "help" in each.metadata:
            default = [] if "repeated" in each.metadata else each.default
            if "kinds" in each.metadata:  # an object by its name, with an option of its own
                made = each.metadata["kinds"][options[each.name]](options[default.OPTION])
                assert made == default
            else:
                assert options[each.name] == default, each.name


@pytest.mark.parametrize(
    "kind, fields, words",
    [
        (ff.Tensile, {"nx": 0}, "`nx` is 0; allowed is a whole number of 1 or more"),
        (
            ff.Tensile,
            {"fabric": "komeili"},
            "`fabric` is 'komeili'; allowed is a fabric, as `load(",
        ),
        (ff.Ply, {"fabric": "komeili", "name": "top"}, "fabric of top is 'komeili'; allowed is a "),
        (
            ff.Membrane,
            {"fabric": "komeili"},
            "fabric of a membrane is 'komeili'; allowed is a fabr",
        ),
        (ff.Forming, {"stack": [0, 45], "nx": 4}, "`stack` holds 0; allowed are plies, as `Ply(fi"),
        (
            ff.Tensile,
            {"fibre_angle": 400},
            "`fibre_angle` is 400; allowed is an angle from -360 to 360 deg",
        ),
        (ff.Forming, {"holdr": 1}, "field `holdr` of Forming is unknown (did you "),
        (
            ff.Tensile,
            {"fiber_angle": 1},
            "(did you mean fibre_angle?); allowed are fabric, mesh, outline",
        ),
        (ff.Tensile, {"nx": 2.5}, "`nx` is 2.5; allowed is a whole number of 1 or more"),
        (ff.Tensile, {"strain": float("nan")}, "`strain` is nan; allowed is a fraction"),
        (ff.Tensile, {"width": "wide"}, "`width` is 'wide'; allowed is a number above 0"),
        (ff.Tensile, {"pattern": "zigzag"}, "`pattern` is 'zigzag'; allowed is one of crossed"),
        (ff.Tensile, {"grips": "glue"}, "`grips` is 'glue'; allowed is one of clamped, rollers"),
        (ff.BiasExtension, {"length": 80}, "allowed is a length of 2 widths or more"),
        (ff.BiasExtension, {"in_plane_bending": 1, "element": "P3"}, "allowed are P1, and P2"),
        (ff.PictureFrame, {"fibre_angle": 30}, "allowed is 0 and 90, along its arms"),
        (ff.PictureFrame, {"pre_tension": 0.5}, "allowed is a strain from 0 to 0.1"),
        (ff.Forming, {"dome": {"depht": 3}}, "`dome`: depht (did you mean depth?): no dimension"),
        (
            ff.Forming,
            {"dome": ["60", "waist=wide", "hight=3", "depth=-1"]},
            "`dome` NAME=VALUE: 60, hight: no dimension of the double dome has this name; allowed "
            f"are {', '.join(DIMENSIONS)}; waist is 'wide'; allowed is a number above 0; "
            "depth is -1.0; allowed is a number above 0",
        ),
        (ff.Forming, {"stroke": 1000, "nx": 4}, "`stroke` 1000 is deeper than the die"),
        (ff.Forming, {"punch": ff.Sphere(5, (0, 0, -5)), "nx": 4}, "does not rise over z = 0"),
        (ff.Forming, {"punch": ff.Sphere(30), "nx": 4}, "Sphere of the punch has no flange in z"),
        (ff.Forming, {"punch": ff.Sphere, "nx": 4}, "`punch` is the class Sphere; allowed is a su"),
        (
            ff.Forming,
            {"punch": ff.Tool(ff.Sphere(30)), "nx": 4},
            "`punch` is a Tool; allowed is a surface, as `DoubleDome()`, or a file's name",
        ),
        (
            ff.Forming,
            {"clearance": 30, "nx": 4},
            "`clearance` 30 leaves the die no radius where the punch is hollow; allowed is from ",
        ),
        (
            ff.Forming,
            {"fabric": ff.load("komeili").replace(thickness=40), "nx": 4},
            "`clearance` 51.5647, 1.2 thicknesses, leaves the die no radius",
        ),
    ],
)
def test_a_field_that_is_not_allowed(kind, fields, words):
    with pytest.raises(ff.InputError) as error:
        built(kind(**fields))
    assert words in str(error.value)


@pytest.mark.parametrize("make", [*SCENARIOS, lambda mesh: ff.Blank.read(mesh)])
def test_a_mesh_that_is_no_name_of_a_file(make):
    words = "mesh file is given as Blank; allowed is its name, as a text or a path"
    with pytest.raises(ff.InputError, match=words):
        built(make(mesh=ff.Blank.rectangle(20, 10, nx=2)))


@pytest.mark.parametrize("kind", [ff.Tensile, ff.BiasExtension, ff.PictureFrame])
def test_a_coupon_is_data(kind):
    """It compares, is replaced field by field, and stays as it was given when it is built."""
    test = kind(nx=4)
    assert test == kind(nx=4) == dataclasses.replace(kind(nx=5), nx=4) != kind(nx=5)
    built = test.build()
    assert test == kind(nx=4) and test.integration is None
    assert (built.data.nx, built.data.integration) == (4, "full")
    assert built.data.build().data == built.data
    with pytest.raises(dataclasses.FrozenInstanceError):
        test.nx = 5


@pytest.mark.parametrize("kind", [ff.Tensile, ff.BiasExtension])
def test_defaults_are_those_of_the_scripts(kind):
    made = kind().build()
    job = made.job()
    assert (made.data.nx, made.data.element, job.steps) == (32, "P2", 20)
    assert (job.tolerance, job.path_tolerance, job.every) == (1e-8, 1e-4, 5)


def test_a_ply_over_ones_own_punch():
    """A dome given as a surface is the dome given by its dimensions, but for being asked twice."""
    coarse = {"nx": 6, "stroke": 10}
    found = []
    for punch in ({"punch": ff.DoubleDome(depth=55)}, {"dome": {"depth": 55}}):
        result = ff.Forming(**coarse, **punch).job(steps=4).run()
        assert result.summary["converged"]
        found.append([row["reaction_N"] for row in result.rows])
    assert found[0] == pytest.approx(found[1], rel=1e-9) and found[0][-1] > 0


class Own(ff.Surface):
    """Another surface, of which nothing else is known."""

    def __init__(self, other):
        self.other, self.radii = other, other.radii

    def nearest(self, points, reach):
        return self.other.nearest(points, reach)


def test_a_punch_of_ones_own_forms_part_of_the_way():
    """As the dome does that it is, whose top is 0.0003 mm below its nominal depth. Its triangles
    are asked for in tests of the study, from a file."""
    coarse, found = {"nx": 6, "penalty": 680.0}, []
    for punch in (ff.DoubleDome(), Own(ff.DoubleDome())):
        ply = ff.Forming(punch=punch, stroke=10, **coarse)
        told = ply.job(steps=4).run().summary["quantities"]
        assert not ply.closes and told["wrinkles"] is None
        found.append((told["punch_force_N"], told["draw_in"]["largest_mm"]))
    assert found[1] == pytest.approx(found[0], rel=1e-3)


def test_the_whole_way_of_a_punch_of_ones_own_is_found():
    """And is the one that is asked for, if this is a rounded number."""
    sizes = {"length": 300, "width": 200, "nx": 8}
    whole = ff.Forming(punch=Bump(25.0, 80.0), **sizes)
    assert whole.closes and whole.stroke == pytest.approx(25.0, abs=1e-7)
    assert not ff.Forming(punch=Bump(25.0, 80.0), stroke=24.9, **sizes).closes
    rounded = ff.Forming(punch=Bump(25.001, 80.0), stroke=25.0, **sizes)
    assert rounded.closes and rounded.stroke == 25.0
    words = "`stroke` 26 is deeper than the die; allowed is up to 25 mm"
    with pytest.raises(ff.InputError, match=words):
        ff.Forming(punch=Bump(25.0, 80.0), stroke=26, **sizes)


def test_a_punch_whose_normals_point_down_is_turned_round():
    points, triangles = double_dome(size=20, turn=15)
    surface = ff.TriangulatedSurface(points, triangles[:, ::-1])
    ply = ff.Forming(punch=surface, stroke=5, nx=4)
    assert ply.punch_tool.surface.evaluate([[0, 0, 80.0]]).gap[0] > 0
    assert any("turned round" in text for text in ply.warnings)


def test_a_dome_is_given_by_itself_or_by_its_dimensions():
    dome = ff.DoubleDome(depth=55)
    given = [ff.Forming(nx=4, dome=each) for each in (dome, {"depth": 55}, ["depth=55"])]
    assert all(ply.punch_tool.surface == dome and ply.stroke == 55 for ply in given)


def test_a_whole_ply_has_a_node_at_its_centre():
    assert [(ply.nx, ply.ny) for ply in (ff.Forming(full=True, nx=n) for n in (12, 22))] == [
        (12, 6),
        (22, 12),
    ]


@pytest.mark.parametrize(
    "fields, words",
    [
        (
            {"holder": ff.PressureHolder(5e4)},
            ["pressure of `PressureHolder` is 50000, which is much: pressures"],
        ),
        ({"metal_friction": 0.1}, []),
    ],
)
def test_numbers_that_speak_of_another_unit_are_doubted(fields, words):
    told = ff.Forming(nx=4, **fields).warnings
    assert len(told) == len(words) and all(map(str.startswith, told, words))


@pytest.mark.parametrize(
    "fields, words",
    [({"punch": "punch.stl", "dome": {"depth": 50}}, "`dome` is given beside `punch`")],
)
def test_fields_that_nothing_would_use_are_refused(fields, words):
    with pytest.raises(ff.InputError, match=words):
        ff.Forming(nx=4, **fields)


@pytest.mark.mpi
@pytest.mark.parametrize("cells", [{"nx": 12}, {"nx": 11}, {"nx": 6, "pattern": "unstructured"}])
def test_a_whole_ply_is_held_in_the_nodes_nearest_to_centre_and_end(cells):
    """One of each, also where several are as near."""
    ply = ff.Forming(full=True, **cells)
    x = ply.blank.coordinates()[: ply.blank.V.dofmap.index_map.size_local]
    for support, place in zip(ply.supports(), ((0, 0), (235, 0))):
        held = np.vstack(COMM.allgather(x[support.where(x.T)]))
        least = COMM.allreduce(np.hypot(*(x[:, :2] - place).T).min(initial=np.inf), MPI.MIN)
        assert len(held) == 1
        assert np.hypot(*(held[0, :2] - place)) == pytest.approx(least, abs=1e-5)


@pytest.mark.parametrize(
    "angle, said",
    [
        (0, False),
        (45, False),
        (30, True),
        (90, False),
        (45 + 1e-10, False),
        (-45, False),
        (1e-10, False),
    ],
)
def test_a_quarter_whose_yarns_no_plane_mirrors_is_warned_of(angle, said):
    ply = ff.Forming(nx=4, fibre_angle=angle)
    assert any("mirror images" in text for text in ply.warnings) == said


def test_a_quarter_of_an_unbalanced_fabric_at_45_deg_is_warned_of(unbalanced):
    assert any("mirror" in text for text in ff.Forming(unbalanced, nx=4, fibre_angle=45).warnings)


class Bump(ff.ImplicitSurface):
    """z = h (1 - r^2 / R^2)^3 within R of the origin, a flange beyond."""

    def __init__(self, height, radius):
        self.height, self.radius = height, radius
        self.radii = (radius**2 / (6 * height),) * 2

    def implicit(self, x):
        zero, squared = 0 * x[0], self.radius**2
        s = np.maximum(0, 1 - (x[0] ** 2 + x[1] ** 2) / squared)
        d, dd = -6 * self.height * s**2 / squared, 24 * self.height * s / squared**2
        mixed = dd * x[0] * x[1]
        flat = [[d + dd * x[0] ** 2, mixed, zero], [mixed, d + dd * x[1] ** 2, zero], [zero] * 3]
        gradient = np.array([-d * x[0], -d * x[1], zero + 1])
        return x[2] - self.height * s**3, gradient, -np.array(flat)

    def bound(self, F, x):
        return abs(F) / np.hypot(1, 1.72 * self.height / self.radius)


class Changed(Bump):
    """A bump of 25 mm that rises from x = `at` [mm], with F, gradient and Hessian times `by`."""

    def __init__(self, at=0.0, by=1.0):
        super().__init__(25.0, 80.0)
        self.at, self.by = np.array([[at], [0], [0]]), by

    def implicit(self, x):
        return tuple(self.by * each for each in super().implicit(x - self.at))


@pytest.mark.parametrize(
    "changed, words",
    [
        ({"by": np.nan}, "gap of surface Changed of the punch is not a number in z = 0; allowed"),
        ({"by": -1}, "Changed of the punch has a flange whose normals point down; allowed are nor"),
    ],
)
def test_a_punch_of_ones_own_that_can_be_none(changed, words):
    with pytest.raises(ff.InputError, match=words):
        ff.Forming(punch=Changed(**changed), length=300, width=200, nx=8)


@pytest.mark.parametrize(
    "at, full, said", [(20, False, True), (20, True, False), (0, False, False)]
)
@pytest.mark.parametrize("triangles", [False, True])
def test_a_punch_that_is_not_its_own_mirror_image_is_warned_of(at, full, said, triangles):
    punch = Changed(at)
    if triangles:
        x, y = np.meshgrid(np.linspace(-200, 200, 41), np.linspace(-150, 150, 31))
        z = 25 * np.maximum(0, 1 - ((x - at) ** 2 + y**2) / 80**2) ** 3
        plan = np.column_stack([x.ravel(), y.ravel()])
        triangles = Delaunay(plan).simplices.astype(np.int64)
        punch = ff.TriangulatedSurface(np.column_stack([plan, z.ravel()]), triangles)
    ply = ff.Forming(punch=punch, length=300, width=200, nx=8, full=full)
    words = "`punch` is not its own mirror image: it is at ("
    assert any(words in text for text in ply.warnings) == said


def test_a_ply_over_a_surface_of_ones_own_is_drawn(tmp_path):
    sizes = {"length": 300, "width": 200, "stroke": 25.0, "holder": ff.Grippers(), "nx": 8}
    ply = ff.Forming(punch=Bump(25.0, 80.0), **sizes)
    result = ply.job(steps=8, limits=ff.Limits(imbalance=0.3)).run(tmp_path / "bump")
    assert result.summary["quantities"]["punch_force_N"] > 0
    for name in ("formed", "outline", "paths", "states"):
        assert (tmp_path / "bump" / f"{name}.png").stat().st_size > 10_000


def test_a_report_says_what_is_formed_over_what():
    sizes = {"length": 300, "width": 300, "nx": 4}
    assert ff.Forming(nx=4).about() == ("", "")
    title, words = ff.Forming(punch=Bump(25.0, 80.0), **sizes).about()
    assert title == "Forming over Bump" and words.startswith("Forming of a ply over Bump")
    plies = [ff.Ply(fibre_angle=45), ff.Ply()]
    assert ff.Forming(nx=4, stack=plies).about()[0] == "Forming over the double dome"
    assert ff.Laminate(nx=4).about() == ("", "")


def test_quadratic_cells_of_a_ply_are_twice_as_large_by_default(monkeypatch):
    """So nodes are as many; who gives a number of rectangles gets it."""
    monkeypatch.setattr(ff.Forming, "FULL", ff.Forming.FULL | {"nx": 8})
    plies = [ff.Forming(fibre_angle=30, **given) for given in ({}, {"nx": 8}, {"element": "P2"})]
    assert [(ply.nx, ply.element) for ply in plies] == [(4, "P2"), (8, "P2"), (8, "P2")]
