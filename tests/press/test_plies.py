"""Sheets of a stack, in Python and from a file."""

from types import SimpleNamespace

import numpy as np
import pytest
from builders import KOMEILI, dome

import fabric_fenicsx as ff
from fabric_fenicsx.press import forming_scene
from fabric_fenicsx.press.press import EXAMPLES

COARSE = {"nx": 4, "stroke": 5}


def test_plies_of_a_file_take_what_they_lack_from_the_blank(tmp_path):
    for name, material in (("own", KOMEILI), ("own_metal", ff.load_metal("dc04"))):
        (tmp_path / f"{name}.toml").write_text(material.replace(name=name).dumps())
    text = """ply = [
  {name = "inner", fibre_angle = 45, nx = 5, friction = 0.2},
  {fabric = "own.toml", length = 400, width = 200.5, thickness = 0.3},
  {metal = "dc04"},
  {},
  {metal = "own_metal.toml"}
]
"""
    (tmp_path / "press.toml").write_text(text + (EXAMPLES / "double_dome.toml").read_text())
    plies = ff.Press.read(tmp_path / "press.toml", ["blank.nx=4"]).sheets
    inner, outer, *_ = plies
    assert (inner.name, inner.fibre_angle, inner.nx, inner.friction) == ("inner", 45.0, 5, 0.2)
    assert (inner.fabric, inner.length, inner.width, outer.nx) == (KOMEILI, 470, 270, 4)
    assert (outer.name, outer.length, outer.width, outer.thickness) == ("ply 2", 400.0, 200.5, 0.3)
    assert [not ply.fabric for ply in plies] == [0, 0, 1, 0, 1]
    names = " ".join((ply.fabric or ply.metal).name for ply in plies)
    assert names == "komeili own dc04 komeili own_metal"
    # Table 2 of the paper: metal on fabric, fabric on fabric; and one that is given
    assert [one.friction_to(next) for one, next in zip(plies, plies[1:])] == [0.2, *3 * [0.25]]
    assert outer.friction_to(inner) == 0.334


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
    pairs = ("ply 1", "ply 2"), ("ply 2", "top"), ("ply 1", "top")
    assert names == [f"contact of {a} and {b}" for a, b in pairs]


@pytest.fixture(scope="module")
def laid():
    """Two plies, smaller metal below them, no bending of plies of metal."""
    metal = {"metal": ff.load_metal("dc04"), "thickness": 0.8, "length": 380, "width": 220}
    metal["name"] = "sheet"
    holder = ff.PressureHolder(2.0, full_stack=True)
    return dome(plies=[metal, {"name": "a"}, {"name": "b"}], holder=holder, **COARSE)


def test_thickness_and_face_are_those_of_the_metal(laid):
    t = ff.load("komeili").thickness_under(0.0)
    assert laid.thickness == pytest.approx(0.8 + 2 * t)
    heights = np.unique(laid.scene.blank.coordinates()[:, 2].round(6))
    assert heights == pytest.approx([-t, -t / 2 + 0.4, t / 2 + 0.4], abs=2e-6)
    die = next(term for term in laid.contacts if term.tool is laid.tools["die"])
    part = laid.scene.blank.part("sheet").nodes
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
    part = laid.scene.blank.part("sheet").nodes
    for term in laid.pressing:
        mu = term.friction_state.coefficient
        assert np.allclose(mu[part], 0.1) and np.allclose(mu[~part], 0.25)


def test_heights_are_those_off_the_faces_of_the_stack(laid, monkeypatch):
    """The holder's plate touches the stack from below, the die its flange from above, as seen from
    each mid-surface: what lies below and above it is between."""
    monkeypatch.setattr(forming_scene, "height_map", lambda grid, over, wave: over)
    result = SimpleNamespace(scene=laid.scene, grids=dict.fromkeys(("sheet", "a", "b")))
    over, t = laid.height_maps(result), ff.load("komeili").thickness_under(0.0)
    for name, z in zip(over, (-t, -t / 2 + 0.4, t / 2 + 0.4)):
        heights = over[name](np.array([[152.0, 0, z + 0.1], [230, 130, z + 0.1]]))
        assert heights == pytest.approx([0.1, -0.1], abs=1e-6)


AREA = 13568 / 20268  # of metal over that of fabric, from the paper's numbers of elements


def laminate(*changes):
    return ff.Press.read("laminate", ["nx=6", "stage.1.moves.punch=2", *changes]).build()


def test_metal_covers_two_thirds_of_the_fabric():
    """13 568 against 20 268 elements in the paper, with cells as large as the plies'."""
    blank = laminate().scene.blank
    areas = {name: blank.areas()[part.cells] for name, part in blank.parts.items()}
    covered = areas["lower metal"].sum() / areas["middle"].sum()
    assert covered == pytest.approx(AREA) == pytest.approx(0.669, abs=1e-3)
    assert areas["lower metal"].mean() == pytest.approx(areas["middle"].mean(), rel=0.3)


@pytest.mark.parametrize("sizes, loose", [((470, 400), "x = 192"), ((640, 170), "y = 69.5")])
def test_metal_that_ends_over_the_opening_is_told_of(sizes, loose):
    own = dict(zip(("length", "width"), np.multiply(sizes, AREA**0.5)))
    metal = [f"ply.{side} metal.{k}={v}" for side in ("lower", "upper") for k, v in own.items()]
    made = laminate(f"blank.length={sizes[0]}", f"blank.width={sizes[1]}", *metal)
    assert [loose in words for words in made.warnings if "opening" in words] == [True]


def test_metal_between_the_domes_need_not_shrink():
    """The laminate's punch is developable there, as no saddle or waist is: one curvature is 0."""
    x, y = np.mgrid[0:150:9j, 0:90:46j].reshape(2, -1)
    punches = ff.Press.read("laminate").tools["punch"].surface, ff.DoubleDome()
    for punch, is_developable in zip(punches, (True, False)):
        bent = punch.evaluate(punch.lift(x, y)).curvature
        product = (np.trace(bent, 0, 1, 2) ** 2 - (bent**2).sum((1, 2))) / 2
        assert (abs(product).max() < 1e-12) == is_developable


def test_cells_of_the_laminate_resolve_its_bands():
    """Least tangent of the paper's tau = s1 g + s2 g^2 + s3 g^3; bands are sqrt(B / Gt) wide."""
    ply = ff.Press.read("laminate").sheets[2]
    least = 25.06e-3 - 186.79e-3**2 / (3 * 562.39e-3)
    assert np.sqrt(ply.in_plane_stiffness / least) > 2 * ply.length / 2 / ply.nx
