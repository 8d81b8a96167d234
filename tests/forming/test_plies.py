"""Sheets of a stack, in Python and from a file."""

import re

import numpy as np
import pytest
from builders import KOMEILI, dome, dome_press

import fabric_fenicsx as ff
from fabric_fenicsx.command_line.forming_study import in_options

TWO = """
unit = "mm"
[[ply]]
name = "inner"
fibre_angle = 45
nx = 5
friction = 0.2
[[ply]]
fabric = "own.toml"
length = 400
width = 200.5
thickness = 0.3
"""
COARSE = {"nx": 4, "stroke": 5}


@pytest.fixture
def file(tmp_path):
    """Function that writes a stack file, and a fabric beside it, to the stack file's path."""

    def write(text=TWO):
        (tmp_path / "own.toml").write_text(ff.load("komeili").replace(name="own").dumps())
        path = tmp_path / "stack.toml"
        path.write_text(text)
        return path

    return write


def plies_of(path):
    """The sheets of a stack file over the double dome."""
    return dome_press(stack=str(path), **COARSE).sheets


def test_a_file_is_read(file):
    inner, outer = plies_of(file())
    assert (inner.name, inner.fibre_angle, inner.nx, inner.friction) == ("inner", 45.0, 5, 0.2)
    assert (outer.name, outer.fabric.name, outer.friction_to(inner)) == ("ply 2", "own", 0.334)
    assert (outer.length, outer.width, outer.thickness) == (400.0, 200.5, 0.3)


def test_faces_of_sheets_follow_a_tighter_lag(file):
    made = dome(stack=str(file()), lag=1e-4, **COARSE)
    (between,) = (t for t in made.scene.terms if isinstance(t, ff.SheetContact))
    assert (between.coulomb.lag, between.faces.lag) == pytest.approx((1e-4, 5e-4))


def test_a_ply_takes_what_it_lacks_from_the_blank(file):
    made = dome(stack=str(file()), **COARSE)
    inner, outer = made.sheets
    assert (inner.fabric, outer.fabric.thickness) == (KOMEILI, 0.3)
    assert (inner.length, inner.width, outer.nx) == (470, 270, 4)
    assert list(made.blank.parts) == ["inner", "ply 2"]
    both = [fabric.thickness_under(0.0) for fabric in (KOMEILI, outer.fabric)]
    assert made.thickness == pytest.approx(sum(both))


def test_rigid_contact_makes_each_fabric_keep_its_thickness():
    thin = ff.load("komeili").replace(thickness=0.3)
    made = dome(plies=[{"fabric": thin}, {"name": "own"}], **COARSE, penalty=100.0)
    assert [sheet.fabric.compaction for sheet in made.sheets] == [None, None]
    assert made.thickness == pytest.approx(1.3)
    single = dome(nx=4, penalty=100.0)
    assert single.sheets[0].fabric.compaction is None and single.thickness == pytest.approx(1.0)


def test_plies_given_are_those_of_a_file(file):
    whole = {"length": 470, "width": 270}
    plies = [
        ff.Sheet(KOMEILI, name="inner", fibre_angle=45, nx=5, friction=0.2, **whole),
        ff.Sheet(KOMEILI, length=400, width=200.5, thickness=0.3, nx=4),
    ]
    one = dome(stack=str(file()), **COARSE)
    other = dome_press(**COARSE).replace(sheets=plies).build()
    assert [t.name for t in one.scene.terms] == [t.name for t in other.scene.terms]
    assert one.blank.heights == pytest.approx(other.blank.heights)


def test_a_ply_beyond_a_shorter_one_meets_the_next(file):
    made = dome(plies=[{}, {"length": 300, "width": 200}, {"name": "top"}], **COARSE)
    names = [term.name for term in made.scene.terms if term.name.startswith("contact of ply")]
    assert names == [f"contact of {a} and {b}" for a, b in PAIRS]


PAIRS = ("ply 1", "ply 2"), ("ply 2", "top"), ("ply 1", "top")


def table(words, unit='unit = "mm"'):
    return f"{unit}\n[[ply]]\n{words}\n"


@pytest.mark.parametrize(
    "text, words",
    [
        (table("", ""), 'unit is missing or another; allowed is a line `unit = "mm"`'),
        (table("", 'unit = "cm"'), "unit is missing or another; allowed is a line"),
        ('unit = "mm"', "ply is missing; allowed is a table [[ply]] for each"),
        ('unit = "mm"\nply = []', "ply is empty; allowed is a table [[ply]] for each"),
        ('unit = "mm"\nply = 3', "ply is missing; allowed is a table [[ply]] for each"),
        ('unit = "mm"\nplies = 3', "entry plies is unknown; allowed are unit and ply"),
        (table("angle = 3"), "ply.1.angle is unknown (did you mean fibre_angle?)"),
        (table('material = "komeili"'), "ply.1.material is unknown (did you mean fabric?)"),
        (table("Width = 3"), "ply.1.Width is unknown (did you mean width?)"),
        (table("[[ply]]\nlenght = 3"), "ply.2.lenght is unknown (did you mean length?)"),
        (table("nx = 2.5"), ".nx is 2.5; allowed is a whole number of 1 or more"),
        (table('name = "top"\nwidth = 0'), ".width is 0; allowed is a number above 0"),
        (table("[[ply]]\nlength = nan"), ".length is nan; allowed is a number above 0"),
        (table("thickness = -1"), ".thickness is -1; allowed is a number above 0"),
        (table("friction = -0.1"), ".friction is -0.1; allowed is a number from 0"),
        (table('fibre_angle = "bias"'), ".fibre_angle is 'bias'; allowed is an angle"),
        (table("yarn_angle = 180"), ".yarn_angle is 180; allowed is an angle above 0"),
        (table("nx = true"), ".nx is True; allowed is a whole number of 1 or more"),
        (table('fabric = "silk"'), ".fabric: material 'silk' is unknown"),
        (table('metal = "gold"'), ".metal: metal 'gold' is unknown; allowed is a preset"),
        (table("metal = 3"), ".metal is 3; allowed is a preset or a material file"),
        (table('metal = "dc04"\nfabric = "komeili"'), ".fabric is not allowed beside ply.1.metal"),
        (table("fabric = 3"), ".fabric is 3; allowed is a preset or a material file"),
        (table("mesh = 3"), ".mesh is 3; allowed is a file's name"),
        (table('mesh = "none.msh"'), ".mesh is 'none.msh', no file; allowed is"),
        (table('name = " "'), ".name is ' '; allowed is a word"),
        (table("name = 3"), ".name is 3; allowed is a word"),
        (
            table('name = "a"\n[[ply]]\nname = "a"'),
            "two plies are called a; allowed are different names",
        ),
        (table("[[ply]\n"), "is not valid TOML"),
    ],
)
def test_what_is_wrong_with_a_file(file, text, words):
    with pytest.raises(ff.InputError, match=re.escape(words)):
        plies_of(file(text))


def test_a_file_that_is_not_there(tmp_path):
    path = tmp_path / "none.toml"
    with pytest.raises(ff.InputError, match="^stack file .*none.toml does not exist or is not a"):
        plies_of(path)


@pytest.mark.parametrize(
    "fields, words",
    [
        ({"clearance": 0.9}, "`clearance` is 0.9, less than the blank's thickness under 1 MPa"),
        ({"element": "Q1"}, "on other cells; allowed are P1, and P2"),
        ({"element": "P3"}, "sheet ply 1 of the stack has other cells; allowed are P1"),
        ({"plies": []}, "ply is empty; allowed is a table"),
        ({"plies": [{"name": "a"}, {"name": "a"}]}, "two plies are called a; allowed are"),
        ({"plies": [{"name": "ply 2"}, {}]}, "two plies are called ply 2; allowed are"),
    ],
)
def test_what_no_stack_is_formed_of(fields, words):
    with pytest.raises(ff.InputError) as error:
        dome(**({"plies": [{}, {}]} | COARSE | fields))
    assert words in in_options(str(error.value))


def test_what_a_file_says_is_of_the_problem(tmp_path):
    """So that a run is not gone on from with a file that was changed."""
    path, found = tmp_path / "stack.toml", []
    for angle in (0, 45):
        path.write_text(f'unit = "mm"\n[[ply]]\nfibre_angle = {angle}\n[[ply]]\n')
        found.append(dome(nx=4, stack=str(path)).fingerprint())
    assert found[0] != found[1]


def test_a_ply_in_metres_is_doubted():
    with pytest.raises(ff.InputError, match="0.235 x 0.135"):
        dome(nx=4, plies=[{"name": "metres", "length": 0.47, "width": 0.27}, {}])


# -- plies of metal

METAL = """
unit = "mm"
[[ply]]
name = "sheet"
metal = "dc04"
thickness = 0.8
length = 380
width = 220
nx = 3
[[ply]]
[[ply]]
friction = 0.3
[[ply]]
metal = "own_metal.toml"
"""


def test_a_ply_of_metal_is_read(file, tmp_path):
    (tmp_path / "own_metal.toml").write_text(ff.load_metal("dc04").replace(name="mine").dumps())
    plies = plies_of(file(METAL))
    assert [ply.metal and ply.metal.name for ply in plies] == ["dc04", None, None, "mine"]
    assert [ply.fabric and ply.fabric.name for ply in plies] == [None, "komeili", "komeili", None]
    # Table 2 of the paper: metal on fabric, fabric on fabric; and one that is given
    pairs = zip(plies, plies[1:])
    assert [lower.friction_to(upper) for lower, upper in pairs] == [0.25, 0.334, 0.3]


@pytest.fixture
def laid():
    """Two plies, smaller metal below them, no bending of plies of metal."""
    metal = {"name": "sheet", "metal": "dc04", "thickness": 0.8, "length": 380, "width": 220}
    return dome(plies=[metal, {"name": "a"}, {"name": "b"}], **COARSE)


def test_terms_of_a_stack_with_metal(laid):
    names = [term.name for term in laid.scene.terms]
    assert [name for name in names if name.startswith(("membrane", "bending", "sheet metal"))] == [
        *("membrane of a", "membrane of b", "bending of a", "bending of b"),
        "sheet metal of sheet",
    ]
    # the rim beyond the metal meets the holder's face
    assert "contact of a" in names and "contact of b" not in names


def test_thickness_and_face_are_those_of_the_metal(laid):
    t = ff.load("komeili").thickness_under(0.0)
    assert laid.thickness == pytest.approx(0.8 + 2 * t)
    die = next(term for term in laid.contacts if term.tool is laid.tools["die"])
    part = laid.blank.part("sheet").nodes
    assert np.allclose(die.thickness[part], 0.8) and np.allclose(die.thickness[~part], t)
    depth = die.depth_under(2.0)
    assert depth[part].max(initial=0) < 0.01 * t < depth[~part].min(initial=t)


def test_a_holder_begins_with_sheets_pressed_as_it_presses(laid):
    laid.press_together(laid.tools["die"])
    scene = laid.scene
    scene.accept()
    whole = 2.0 * 470 * 270 / 4
    for pair in (term for term in scene.terms if isinstance(term, ff.SheetContact)):
        assert 0.1 * whole < pair.force()[2] < whole


def test_friction_of_tools_is_that_of_the_sheet_they_touch(laid):
    part = laid.blank.part("sheet").nodes
    for term in laid.pressing:
        mu = term.friction.coefficient
        assert np.allclose(mu[part], 0.1) and np.allclose(mu[~part], 0.25)
