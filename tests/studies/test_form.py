"""Changes of a press, and runs that follow its run: finer, disturbed, without couplings."""

import json

import meshio
import numpy as np
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.cli.press_study import PressStudy, press_parser
from fabric_fenicsx.press.press import EXAMPLES

PRESS = EXAMPLES / "hemisphere.toml"
SMALL = PRESS, "--set", "blank.nx=4", "--steps", 2, "--balance", 9, "--no-pictures"


def test_the_press_as_it_was_run_is_beside_its_results(launch):
    change = "stage.1.moves.punch=3", "fabric.s1=0.05"
    run = launch("form", *SMALL, *(word for each in change for word in ("--set", each)))
    assert run.status == 0, run.err
    press = ff.Press.read(run.folder / "press.toml")
    given = ff.Press.read(PRESS, ["blank.nx=4", *change])
    assert press.build().fingerprint() == given.build().fingerprint()


def test_a_disturbed_run_is_of_the_whole_ply(launch):
    run = launch("form", *SMALL, "--set", "stage.1.moves.punch=3", "--disturb", 2)
    assert run.status == 0, run.err
    disturbed = json.loads((run.folder / "disturbed" / "summary.json").read_text())
    assert disturbed["cells"] == 4 * run.summary["cells"]
    number = disturbed["quantities"]["force_of_whole_blank_N"]
    assert run.summary["disturbed"]["force_of_whole_blank_N"] == pytest.approx(number)


def test_the_disturbed_press_is_whole_and_its_punch_aside():
    press = ff.Press.read(PRESS, ["blank.nx=4"]).build()
    other = press.disturbed(2.0)
    (sheet,) = other.sheets
    assert not other.planes and sheet.nx == 8
    assert other.tools["punch"].at == pytest.approx((2 * 0.75**0.5, 1.0))
    assert other.tools["ring"] == press.data.tools["ring"]


def test_a_mesh_from_a_file_gets_no_finer_cells(tmp_path):
    sheet = ff.Sheet(ff.load("komeili"), mesh=str(tmp_path / "ply.msh"))
    with pytest.raises(ff.InputError, match="ply.msh can't be made finer; allowed is a rectangle"):
        sheet.finer(2.0)
    outline = ff.Sheet(ff.load("komeili"), outline="ply.dxf", size=9.0)
    assert outline.finer(3.0).size == 3.0


TWO = ("two_plies", ["nx=6", "fibre_angle=30"]), ("laminate", ["blank.nx=12", "nx=6"])


def test_short_forms_are_of_all_plies(tmp_path):
    two, laminate = (ff.Press.read(*each).sheets for each in TWO)
    assert [(ply.nx, ply.fibre_angle) for ply in two] == [(6, 30), (6, 30)]
    assert [ply.nx for ply in laminate] == [10, 6, 6, 6, 10]  # metal keeps its share of cells
    out = "--out", str(tmp_path), "--yarn-angle", "80", "--element", "P2", "--without", "biaxial"
    words = ["two_plies", "--nx", "4", "--set", "ply.2.nx=3", "--material", "komeili", *out]
    sheets = PressStudy("form", press_parser(""), words).read().sheets
    assert [(s.nx, s.yarn_angle, s.element) for s in sheets] == [(4, 80, "P2"), (3, 80, "P2")]
    assert all(s.fabric == ff.load("komeili").without("biaxial") for s in sheets)


def test_a_press_of_metal_alone_is_read(tmp_path):
    words = ["hemisphere", "--set", "blank.metal=dc04", "--out", str(tmp_path)]
    (sheet,) = PressStudy("form", press_parser(""), words).read().sheets
    assert sheet.metal == ff.load_metal("dc04") and not sheet.fabric


def test_a_change_replaces_what_it_excludes(tmp_path):
    meshio.write_points_cells(tmp_path / "p.stl", np.eye(3), [("triangle", [[0, 1, 2]])])
    file, outline = tmp_path / "p.stl", tmp_path / "ply.csv"
    outline.write_text("x,y\n0,0\n235,0\n235,135\n0,135\n")
    changes = [f"tools.punch.file={file}", "tools.punch.chord=0.2", "stage.1.moves.punch=20"]
    changes += ["holder.tension=3", f"blank.outline={outline}", "blank.size=9"]
    press = ff.Press.read("double_dome", changes)
    punch, (sheet,), (stage,) = press.tools["punch"], press.sheets, press.stages
    assert (punch.surface, punch.chord, stage.close) == (str(file), 0.2, None)
    assert (stage.moves, press.holders) == ({"punch": 20}, {"blank holder": ff.Grippers(3)})
    assert (sheet.length, sheet.nx, sheet.size) == (None, None, 9)
    ball = ["tools.punch.shape=sphere", "tools.punch.radius=40", "ply.2.metal=dc04"]
    plies = ff.Press.read("two_plies", ball)
    assert plies.tools["punch"].surface == ff.Sphere(40) and plies.sheets[1].fabric is None
