"""Sheets of a stack, in Python and from a file."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from builders import KOMEILI, dome

import fabric_fenicsx as ff
from fabric_fenicsx.forming import quantities
from fabric_fenicsx.forming.press import EXAMPLES

COARSE = {"nx": 4, "stroke": 5}
OWN = ff.load("komeili").replace(name="own")
TWO = [
    {"name": "inner", "fibre_angle": 45, "nx": 5, "friction": 0.2},
    {"fabric": OWN, "length": 400, "width": 200.5, "thickness": 0.3},
]


@pytest.fixture
def plies_of(tmp_path):
    """Function of tables of plies to the sheets of a press file that has them, with a fabric and a
    metal beside it."""
    for name, material in (("own", OWN), ("own_metal", ff.load_metal("dc04"))):
        (tmp_path / f"{name}.toml").write_text(material.replace(name=name).dumps())
    before, after = (EXAMPLES / "double_dome.toml").read_text().split("[tools.die]")

    def read(text):
        (tmp_path / "press.toml").write_text(f"{before}{text}\n[tools.die]{after}")
        return ff.Press.read(tmp_path / "press.toml", ["blank.nx=4"]).sheets

    return read


def test_plies_of_a_file_take_what_they_lack_from_the_blank(plies_of):
    inner, outer = plies_of("""
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
""")
    assert (inner.name, inner.fibre_angle, inner.nx, inner.friction) == ("inner", 45.0, 5, 0.2)
    assert (inner.fabric, inner.length, inner.width, outer.nx) == (KOMEILI, 470, 270, 4)
    assert (outer.name, outer.fabric.name, outer.friction_to(inner)) == ("ply 2", "own", 0.334)
    assert (outer.length, outer.width, outer.thickness) == (400.0, 200.5, 0.3)


def test_rigid_contact_makes_each_fabric_keep_its_thickness():
    thin = ff.load("komeili").replace(thickness=0.3)
    made = dome(plies=[{"fabric": thin}, {"name": "own"}], **COARSE, penalty=100.0)
    assert [sheet.fabric.compaction for sheet in made.sheets] == [None, None]
    assert made.thickness == pytest.approx(1.3)
    single = dome(nx=4, penalty=100.0)
    assert single.sheets[0].fabric.compaction is None and single.thickness == pytest.approx(1.0)


def test_a_ply_beyond_a_shorter_one_meets_the_next():
    made = dome(plies=[{}, {"length": 300, "width": 200}, {"name": "top"}], **COARSE)
    names = [term.name for term in made.scene.terms if term.name.startswith("contact of ply")]
    assert names == [f"contact of {a} and {b}" for a, b in PAIRS]


PAIRS = ("ply 1", "ply 2"), ("ply 2", "top"), ("ply 1", "top")


@pytest.mark.parametrize(
    "text, words",
    [
        ("angle = 3", "ply.1.angle is unknown (did you mean fibre_angle?)"),
        ("[[ply]]\nlength = nan", ".length is nan; allowed is a number above 0"),
        ('metal = "gold"', ".metal: metal 'gold' is unknown; allowed is a preset"),
        ("metal = 3", ".metal is 3; allowed is a preset or a material file"),
        ('metal = "dc04"\nfabric = "komeili"', ".fabric is not allowed beside ply.1.metal"),
        ("mesh = 3", ".mesh is 3; allowed is a file's name"),
        ('name = " "', ".name is ' '; allowed is a word"),
        ('name = "a"\n[[ply]]\nname = "a"', "two plies are called a; allowed are different names"),
    ],
)
def test_what_is_wrong_with_a_ply(plies_of, text, words):
    with pytest.raises(ff.InputError, match=re.escape(words)):
        plies_of(f"[[ply]]\n{text}\n")


# -- plies of metal


def test_a_ply_of_metal_is_read(plies_of):
    plies = plies_of("""
[[ply]]
name = "sheet"
metal = "dc04"
[[ply]]
[[ply]]
friction = 0.3
[[ply]]
metal = "own_metal.toml"
""")
    assert [ply.metal and ply.metal.name for ply in plies] == ["dc04", None, None, "own_metal"]
    assert [ply.fabric and ply.fabric.name for ply in plies] == [None, "komeili", "komeili", None]
    # Table 2 of the paper: metal on fabric, fabric on fabric; and one that is given
    pairs = zip(plies, plies[1:])
    assert [lower.friction_to(upper) for lower, upper in pairs] == [0.25, 0.334, 0.3]


@pytest.fixture(scope="module")
def laid():
    """Two plies, smaller metal below them, no bending of plies of metal."""
    metal = {"metal": ff.load_metal("dc04"), "thickness": 0.8, "length": 380, "width": 220}
    metal["name"] = "sheet"
    return dome(plies=[metal, {"name": "a"}, {"name": "b"}], **COARSE)


def test_thickness_and_face_are_those_of_the_metal(laid):
    t = ff.load("komeili").thickness_under(0.0)
    assert laid.thickness == pytest.approx(0.8 + 2 * t)
    heights = np.unique(laid.blank.coordinates()[:, 2].round(6))
    assert heights == pytest.approx([-t, -t / 2 + 0.4, t / 2 + 0.4], abs=2e-6)
    die = next(term for term in laid.contacts if term.tool is laid.tools["die"])
    part = laid.blank.part("sheet").nodes
    assert np.allclose(die.thickness[part], 0.8) and np.allclose(die.thickness[~part], t)
    depth = die.depth_under(2.0)
    assert depth[part].max(initial=0) < 0.01 * t < depth[~part].min(initial=t)


def test_a_holder_begins_with_sheets_pressed_as_it_presses(laid):
    scene = laid.scene
    scene.accept()
    whole = 2.0 * 470 * 270 / 4
    for pair in (term for term in scene.terms if isinstance(term, ff.SheetContact)):
        assert 0.1 * whole < pair.force()[2] < whole


def test_friction_of_tools_is_that_of_the_sheet_they_touch(laid):
    part = laid.blank.part("sheet").nodes
    for term in laid.pressing:
        mu = term.friction_state.coefficient
        assert np.allclose(mu[part], 0.1) and np.allclose(mu[~part], 0.25)


def test_heights_are_those_off_the_faces_of_the_stack(laid, monkeypatch):
    """The holder's plate touches the stack from below, the die its flange from above, as seen from
    each mid-surface: what lies below and above it is between."""
    monkeypatch.setattr(quantities, "height_map", lambda grid, over, wave: over)
    result = SimpleNamespace(scene=laid.scene, grids=dict.fromkeys(("sheet", "a", "b")))
    over, t = quantities.wrinkle_heights(laid, result), ff.load("komeili").thickness_under(0.0)
    for name, z in zip(over, (-t, -t / 2 + 0.4, t / 2 + 0.4)):
        heights = over[name](np.array([[152.0, 0, z + 0.1], [230, 130, z + 0.1]]))
        assert heights == pytest.approx([0.1, -0.1], abs=1e-6)
