"""Changes of a press, and runs that follow its run: finer, disturbed, without couplings."""

import json
import re

import meshio
import numpy as np
import pytest
from builders import COMM

import fabric_fenicsx as ff
from fabric_fenicsx.press.press import EXAMPLES
from fabric_fenicsx.results import pictures
from fabric_fenicsx.results.states import read_state
from fabric_fenicsx.studies.lib.press_study import PressStudy, press_parser

ROOT = EXAMPLES.parents[1]
PRESS = EXAMPLES / "hemisphere.toml"
COARSE = "--steps", 2, "--balance", 9, "--no-pictures", "--set", "stage.1.moves.punch=3"
SMALL = PRESS, "--set", "blank.nx=4", *COARSE, "--no-error"


def test_the_press_as_it_was_run_is_beside_its_results(launch, run_script, tmp_path):
    """It runs again from its folder, with files that were named from another, but not into it."""
    (tmp_path / "ply.csv").write_text("x,y\n-50,-50\n50,-50\n50,50\n-50,50\n")
    change = "stage.1.moves.punch=3", "fabric.s1=0.05", "blank.outline=ply.csv", "blank.size=25"
    small = SMALL[0], *SMALL[3:], *(word for each in change for word in ("--set", each))
    run = launch("form", *small)
    assert run.status == 0, run.err
    press = run.folder / "press.toml"
    press.write_text("# mine\n" + press.read_text())
    script = ROOT / "studies/form.py", "press.toml", *SMALL[3:], "--out"
    status, _, err = run_script(run.folder, *script, ".", "--overwrite")
    assert status == 2 and "holds inputs, or files that no run of it wrote: press.toml" in err
    assert run_script(run.folder, *script, "../again")[0] == 0
    again = json.loads((tmp_path / "again/summary.json").read_text())
    assert again["reaction_N"] == pytest.approx(run.summary["reaction_N"], rel=1e-9)
    assert press.read_text().startswith("# mine")


def test_a_disturbed_run_is_of_the_whole_ply(launch):
    run = launch("form", *SMALL, "--disturb", 2)
    assert run.status == 0, run.err
    disturbed = json.loads((run.folder / "disturbed" / "summary.json").read_text())
    assert disturbed["cells"] == 4 * run.summary["cells"]
    number = disturbed["quantities"]["force_of_whole_blank_N"]
    assert run.summary["disturbed"]["force_of_whole_blank_N"] == pytest.approx(number)


def test_a_press_tells_its_error_unasked(launch):
    """By the same press on cells twice as large, in half the steps, root mean square of the curve's
    relative differences over the second half of the load; in report and verdict."""
    press = PRESS, *COARSE, "--set", "stage.1.moves.punch=10"
    run = launch("form", *press, "--set", "blank.nx=6", "--steps", 4)
    assert run.status == 0, run.err
    page, force = (run.folder / "report.html").read_text(), run.summary["reaction_N"]
    curve = lambda: np.genfromtxt(run.folder / "history.csv", names=True, delimiter=",")  # noqa: E731
    own, _ = curve(), launch("form", *press, "--set", "blank.nx=3", "--no-error")
    coarse = (other := curve())[other["load"] >= 0.5]
    own = np.interp(coarse["load"], own["load"], own["reaction_N"])
    apart = force * np.sqrt(np.mean((coarse["reaction_N"] / own - 1) ** 2))
    assert run.summary["error"]["reaction_N"] == pytest.approx(apart, rel=1e-3)
    assert f"{force:.5g} +- {apart:.2g}" in page
    (doubt,) = [reason for reason in run.summary["reasons"] if reason["of"] == "_N"]
    assert f"10 %: force of punch on a quarter of the blank {force:.5g} +- " in doubt["text"]


def test_the_disturbed_press_is_whole_and_its_punch_aside():
    press = ff.Press.read(PRESS, ["blank.nx=4"]).build()
    other = press.disturbed(2.0)
    (sheet,) = other.sheets
    assert not other.planes and sheet.nx == 8
    assert other.tools["punch"].at == pytest.approx((2 * 0.75**0.5, 1.0))
    assert other.tools["ring"] == press.data.tools["ring"]


def test_a_mesh_from_a_file_gets_no_finer_cells(tmp_path):
    sheet = ff.Sheet(ff.load("komeili"), mesh=str(tmp_path / "ply.msh"))
    with pytest.raises(ff.InputError, match="ply.msh cannot be refined; expected a rectangle"):
        sheet.finer(2.0)
    outline = ff.Sheet(ff.load("komeili"), outline="ply.dxf", size=9.0)
    assert outline.finer(3.0).size == 3.0


def test_short_forms_are_of_all_plies(tmp_path):
    two = ff.Press.read("two_plies", ["nx=6", "fibre_angle=30"]).sheets
    laminate = ff.Press.read("laminate", ["blank.nx=12", "nx=6"]).sheets
    assert [(ply.nx, ply.fibre_angle) for ply in two] == [(6, 30), (6, 30)]
    assert [ply.nx for ply in laminate] == [10, 6, 6, 6, 10]  # metal keeps its share of cells
    out = "--out", str(tmp_path), "--yarn-angle", "80", "--element", "P2", "--without", "biaxial"
    words = ["two_plies", "--nx", "4", "--set", "ply.2.nx=3", "--material", "komeili", *out]
    sheets = PressStudy("form", press_parser(""), words).read().sheets
    assert [(s.nx, s.yarn_angle, s.element) for s in sheets] == [(4, 80, "P2"), (3, 80, "P2")]
    assert all(s.fabric == ff.load("komeili").without("biaxial") for s in sheets)
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


@pytest.mark.versions
def test_a_laminate_is_formed(launch, monkeypatch):
    monkeypatch.setattr(pictures, "draw_compared", lambda *_: None)  # as of a single ply
    # a step of hardly any work: what is missing of it differs from machine to machine
    short = "--set", "stage.1.moves.punch=1.5", "--steps", 1, "--max-imbalance", 0.5
    done = launch("laminate", "--nx", 3, *short, "--balance", 9, "--no-error")
    assert done.status == 0, done.err
    s = done.summary
    q, energy = s["quantities"], s["energy"]
    assert s["converged"] and " ".join(q["plies"]) == "lower metal lower middle upper upper metal"
    # of the fabric, not of the smaller metal below it
    assert [s["options"][name] for name in ("nx", "length", "width")] == [3, 760, 460]
    assert energy["viscous"] <= 0.01 * energy["metal"]
    assert energy["metal"] > energy["strain"] > 0 and energy["plastic"] >= 0
    assert q["penetration_of_thickness"] < 0.02
    assert q["unbalanced_force_N"] < 1e-4 * q["contact_forces_N"]["die"]
    for name, ply in q["plies"].items():
        assert ("thinning_max" in ply) == ("metal" in name) != ("shear_angle_max_deg" in ply)
    assert q["plies"]["middle"]["shear_contrast_deg"] > 0 and "shear_contrast_deg" not in q
    assert q["sheet_pressure_largest_MPa"] > 1  # of 2 MPa beneath the holder
    drawn = "middle", "middle_paths", "between", "metal", "formed", "states_middle"
    if COMM.rank == 0:
        assert all((done.folder / f"{name}.png").stat().st_size > 10_000 for name in drawn)
        grid = read_state(done.folder)
        is_metal = np.isin(np.asarray(grid.cell_data["part"]), (0, 4))
        thickness = np.asarray(grid.cell_data["metal_thickness"])
        assert np.array_equal(np.isfinite(thickness), is_metal)
        assert np.allclose(thickness[is_metal], 1.0, atol=0.01)


@pytest.mark.mpi
def test_a_dry_run_tells_the_size_and_leaves_the_folder_free(launch):
    press = PRESS, "--set", "blank.nx=4", "--set", "stage.1.moves.punch=1", "--steps", 1
    checked = launch("form", *press, "--dry-run", "--error", overwrite=False)
    assert checked.status == 0, checked.err
    assert "64 cells (P1), 123 degrees of freedom; membrane, bending, contact" in checked.out
    told = re.findall(r"^(.*?),? takes ([\d.]+) to ([\d.]+) s", checked.out, re.MULTILINE)
    assert [n.split(",")[0] for n, *_ in told] == ["the run", "the error estimate on coarser cells"]
    assert all(float(low) < float(high) for _, low, high in told)
    assert "MiB" in checked.out
    assert (checked.folder / "setup.png").stat().st_size > 10_000
    assert not (checked.folder / "history.csv").exists()
    run = launch("form", *press, "--no-pictures", "--no-error", overwrite=False)
    assert run.status == 0 and run.summary["dofs"] == 123
    assert f" {run.summary['newton_iterations']} iterations at the first" in checked.out
