"""Plies of a stack, in Python and from a file."""

import re

import numpy as np
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.forming.plies import Ply, read_plies

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


def test_a_file_is_read(file):
    inner, outer = read_plies(file())
    assert (inner.name, inner.fabric, inner.fibre_angle, inner.nx, inner.friction) == (
        *("inner", None, 45.0, 5),
        0.2,
    )
    assert (outer.name, outer.fabric.name, outer.friction_to(inner)) == ("ply 2", "own", 0.334)
    assert (outer.length, outer.width, outer.thickness) == (400.0, 200.5, 0.3)


def test_a_ply_takes_what_it_lacks_from_the_scenario(file):
    made = ff.Forming(stack=str(file()), **COARSE)
    inner, outer = made.plies
    assert (inner.fabric, outer.fabric.thickness) == (made.fabric, 0.3)
    assert list(made.blank.parts) == ["inner", "ply 2"]
    both = [fabric.thickness_under(0.0) for fabric in (made.fabric, outer.fabric)]
    assert made.thickness == pytest.approx(sum(both))


@pytest.mark.parametrize("rigid", [{"penalty": 100.0}, {"permitted": 0.01}])
def test_rigid_contact_makes_each_fabric_keep_its_thickness(rigid):
    thin = ff.load("komeili").replace(thickness=0.3)
    made = ff.Forming(stack=[ff.Ply(fabric=thin), ff.Ply(name="own")], **COARSE, **rigid)
    assert [ply.fabric.compaction for ply in made.plies] == [None, None]
    assert made.thickness == pytest.approx(1.3)
    single = ff.Forming(nx=4, **rigid)
    assert single.fabric.compaction is None and single.thickness == pytest.approx(1.0)


def test_plies_given_are_those_of_a_file(file):
    plies = [
        ff.Ply(name="inner", fibre_angle=45, nx=5, friction=0.2),
        ff.Ply(fabric=ff.load("komeili"), length=400, width=200.5, thickness=0.3),
    ]
    one, other = (ff.Forming(stack=stack, **COARSE) for stack in (str(file()), plies))
    assert [t.name for t in one.scene.terms] == [t.name for t in other.scene.terms]
    assert one.blank.heights == pytest.approx(other.blank.heights)


def test_a_ply_beyond_a_shorter_one_meets_the_next(file):
    plies = [ff.Ply(), ff.Ply(length=300, width=200), ff.Ply(name="top")]
    made = ff.Forming(stack=plies, **COARSE)
    names = [term.name for term in made.scene.terms if term.name.startswith("contact of ply")]
    assert names == [f"contact of {a} and {b}" for a, b in PAIRS]


PAIRS = ("ply 1", "ply 2"), ("ply 2", "top"), ("ply 1", "top")


def table(words, unit='unit = "mm"'):
    return f"{unit}\n[[ply]]\n{words}\n"


@pytest.mark.parametrize(
    "text, words",
    [
        (table("", ""), 'unit is missing; allowed is a line `unit = "mm"`'),
        (table("", 'unit = "cm"'), "unit is 'cm'; allowed is a line"),
        ('unit = "mm"', "there is no ply; allowed is a table [[ply]] for each"),
        ('unit = "mm"\nply = []', "there is no ply; allowed is a table [[ply]] for each"),
        ('unit = "mm"\nply = 3', "there is no ply; allowed is a table [[ply]] for each"),
        ('unit = "mm"\nplies = 3', "key 'plies'"),
        (table("angle = 3"), "key 'angle' of ply 1 is unknown (did you mean fibre_angle?)"),
        (table('material = "komeili"'), "'material' of ply 1 is unknown (did you mean fabric?)"),
        (table("Width = 3"), "key 'Width' of ply 1 is unknown (did you mean width?)"),
        (table("[[ply]]\nlenght = 3"), "key 'lenght' of ply 2"),
        (table("nx = 2.5"), "nx of ply 1 is 2.5; allowed is a whole number of 1 or more"),
        (table('name = "top"\nwidth = 0'), "width of top is 0; allowed is a number above 0"),
        (table("[[ply]]\nlength = nan"), "length of ply 2 is nan; allowed is a number above 0"),
        (table("thickness = -1"), "thickness of ply 1 is -1; allowed is a number above 0"),
        (table("friction = -0.1"), "friction of ply 1 is -0.1; allowed is a number from 0"),
        (
            table('fibre_angle = "bias"'),
            "fibre_angle of ply 1 is 'bias'; allowed is a finite number",
        ),
        (table("yarn_angle = 180"), "yarn_angle of ply 1 is 180; allowed is an angle above 0"),
        (table("nx = true"), "nx of ply 1 is True; allowed is a whole number of 1 or more"),
        (table('fabric = "silk"'), "fabric of ply 1: "),
        (table('metal = "gold"'), "metal of ply 1: metal 'gold' is unknown; allowed is a preset"),
        (table("metal = 3"), "metal of ply 1 is 3; allowed is a name or a file"),
        (table('metal = "dc04"\nfabric = "komeili"'), "ply 1 is given fabric and metal; allowed"),
        (table("fabric = 3"), "fabric of ply 1 is 3; allowed is a name or a file"),
        (table("mesh = 3"), "mesh of ply 1 is 3; allowed is a name or a file"),
        (table('mesh = "none.msh"'), "mesh of ply 1 is 'none.msh', no file; allowed is"),
        (table('name = " "'), "name of ply 1 is ' '; allowed is a word"),
        (table("name = 3"), "name of ply 1 is 3; allowed is a word"),
        (table('name = "a"\n[[ply]]\nname = "a"'), "name of ply 2 is 'a', as of ply 1; allowed"),
        (table("[[ply]\n"), "is not valid TOML"),
    ],
)
def test_what_is_wrong_with_a_file(file, text, words):
    path = file(text)
    with pytest.raises(ff.InputError, match=f"^{re.escape(str(path))}: ") as error:
        read_plies(path)
    assert words in str(error.value) and "; allowed " in str(error.value)


@pytest.mark.parametrize("given", [{"nx": 4}, {"length": 100.0, "width": 50.0}])
def test_sizes_beside_a_mesh(given):
    words = f"^{', '.join(given)} of a ply is given beside mesh, which has its own; allowed is one"
    with pytest.raises(ff.InputError, match=words):
        Ply(mesh="ply.msh", **given)


def test_a_file_that_is_not_there(tmp_path):
    path = tmp_path / "none.toml"
    with pytest.raises(ff.InputError, match="^stack file .*none.toml' does not exist or is not a"):
        ff.Forming(stack=str(path), **COARSE)


@pytest.mark.parametrize(
    "fields, words",
    [
        ({"fibre_angle": 45}, "`fibre_angle` is given beside `stack`; allowed is to say it of"),
        ({"weave_angle": 80}, "`weave_angle` is given beside `stack`; allowed is to say it of"),
        (
            {"clearance": 0.9},
            "`clearance` 0.9 is less than the thickness of ply or stack under 1 MPa; allowed is",
        ),
        ({"element": "Q1"}, "on other cells; allowed are P1, and P2"),
        ({"element": "P3"}, "sheet ply 1 of the stack has other cells; allowed are P1"),
        ({"stack": []}, "`stack` has no ply; allowed are one or more"),
        ({"stack": [ff.Ply(name="a"), ff.Ply(name="a")]}, "named ['a', 'a']; allowed are"),
        ({"stack": [ff.Ply(name="ply 2"), ff.Ply()]}, "named ['ply 2', 'ply 2']; allowed are"),
    ],
)
def test_what_no_stack_is_formed_of(fields, words):
    with pytest.raises(ff.InputError) as error:
        ff.Forming(**({"stack": [ff.Ply(), ff.Ply()]} | COARSE | fields))
    assert words in str(error.value)


@pytest.mark.parametrize("field, value", [("nx", 0), ("yarn_angle", 0), ("friction", -1)])
def test_a_ply_with_a_bad_number(field, value):
    with pytest.raises(ff.InputError, match=f"{field} of a ply is {value}; allowed is"):
        ff.Ply(**{field: value})


def test_what_a_file_says_is_of_the_problem(tmp_path):
    """So that a run is not gone on from with a file that was changed."""
    path, found = tmp_path / "stack.toml", []
    for angle in (0, 45):
        path.write_text(f'unit = "mm"\n[[ply]]\nfibre_angle = {angle}\n[[ply]]\n')
        found.append(ff.Forming(nx=4, stack=path).problem())
    assert found[0] != found[1]


def test_a_ply_in_metres_is_doubted():
    with pytest.raises(ff.InputError, match="ply metres is 0.235 x 0.135"):
        ff.Forming(nx=4, stack=[ff.Ply(name="metres", length=0.47, width=0.27), ff.Ply()])


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
    plies = read_plies(file(METAL))
    assert [ply.metal and ply.metal.name for ply in plies] == ["dc04", None, None, "mine"]
    assert [ply.fabric for ply in plies] == [None] * 4
    # Table 2 of the paper: metal on fabric, fabric on fabric; and one that is given
    pairs = zip(plies, plies[1:])
    assert [lower.friction_to(upper) for lower, upper in pairs] == [0.25, 0.334, 0.3]


@pytest.fixture
def laid():
    """Two plies, smaller metal below them, no bending of plies of metal."""
    metal = ff.Ply(name="sheet", metal=ff.load_metal("dc04"), thickness=0.8, length=380, width=220)
    return ff.Forming(stack=[metal, ff.Ply(name="a"), ff.Ply(name="b")], **COARSE)


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
    die = next(term for term in laid.contacts if term.tool is laid.die)
    part = laid.blank.part("sheet").nodes
    assert np.allclose(die.thickness[part], 0.8) and np.allclose(die.thickness[~part], t)
    depth = die.depth_under(2.0)
    assert depth[part].max(initial=0) < 0.01 * t < depth[~part].min(initial=t)


def test_a_holder_begins_with_sheets_pressed_as_it_presses(laid):
    laid.start()
    scene = laid.scene
    scene.accept()
    whole = laid.holder.pressure * laid.length * laid.width / 4
    for pair in (term for term in scene.terms if isinstance(term, ff.SheetContact)):
        assert 0.1 * whole < pair.force()[2] < whole


def test_friction_of_tools_is_that_of_the_sheet_they_touch(laid):
    part = laid.blank.part("sheet").nodes
    for term in laid.pressing:
        mu = term.friction.coefficient
        assert np.allclose(mu[part], 0.1) and np.allclose(mu[~part], 0.25)


def test_fabric_and_metal_in_one_ply():
    words = "a ply is given fabric and metal; allowed is one of them"
    with pytest.raises(ff.InputError, match=words):
        ff.Ply(fabric=ff.load("komeili"), metal=ff.load_metal("dc04"))
