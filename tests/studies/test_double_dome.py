"""Forming studies, run as a user would."""

import csv
import json

import numpy as np
import pytest

from fabric_fenicsx.command_line.forming_study import DomeTest, build, dome_parser
from fabric_fenicsx.command_line.study import Study
from fabric_fenicsx.forming.build import FormingScene
from fabric_fenicsx.plot import pictures
from fabric_fenicsx.postprocess.states import read_last
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.studies.lib import compression_parameters

EXACT = "--tolerance", 1e-9, "--path-tolerance", 1e-8, "--viscosity", "off", "--no-pictures"


def last_row(folder):
    """Of history.csv."""
    with open(folder / "history.csv", newline="") as file:
        return list(csv.DictReader(file))[-1]


def placed(folder):
    """Undeformed places and displacements of the nodes [mm], once each and in an order of their
    own."""
    grid = read_last(folder)
    x = np.round(np.asarray(grid.points), 6) + 0.0
    _, first = np.unique(x, axis=0, return_index=True)
    return x[first], np.asarray(grid.point_data["u"])[first]


# that ranks find the same is asked below of yarns that lie askew
@pytest.mark.parametrize(
    "angle",
    [
        pytest.param(0, marks=[pytest.mark.mpi, pytest.mark.versions]),
        pytest.param(45, marks=pytest.mark.long),
    ],
)
def test_a_ply_is_formed(launch, angle):
    done = launch("double_dome", "--quick", "--nx", 8, "--steps", 16, "--fibre-angle", angle)
    assert done.status == 0, done.err
    s = done.summary
    q, energy = s["quantities"], s["energy"]
    assert s["converged"]
    assert s["kernel_mismatch"] < 1e-12
    assert {"membrane", "bending", "contact", "blank holder"} == set(s["terms"])
    assert s["energy_imbalance"] < 0.02
    assert energy["viscous"] <= 0.01 * energy["strain"]
    assert q["penetration_of_thickness"] < 0.02
    assert q["unbalanced_force_N"] < 1e-4 * q["contact_forces_N"]["die"]
    assert 35 < q["shear_angle_max_deg"] < 60
    assert 0.7 < q["shear_angle_99_percent_deg"] / q["shear_angle_max_deg"] < 1
    assert 15 < q["draw_in"]["largest_mm"] < 48
    assert q["wrinkles"]["height_mm"] < 1
    (warning,) = [w for w in s["warnings"] if "mm long where" in w]
    # edges at 43 deg do not follow yarns at 45
    assert (s["element"], s["integration"]) == ("P2" if angle else "P1", "full")
    assert not any("linear cells" in w for w in s["warnings"])
    size = "halves of quadratic cells are 14.1" if angle else "cells are 28.2"
    assert f"{size} mm long where the die has a radius of 7.45 mm" in warning
    assert done.err.count(warning) == 1
    for name in ("formed", "states", "paths", "outline", "curve"):
        assert (done.folder / f"{name}.png").stat().st_size > 10_000
    grid = read_last(done.folder)
    assert grid.point_data["contact_pressure"].max() > 1.0
    assert (done.folder / "paths.csv").read_text().count("\n") > 50


def test_a_formed_ply_is_the_same_again(launch):
    """At default tolerances, with yarns that do not follow the tools: on other ranks, and with a
    length that differs by as much as rounding; every force on the way, too."""
    found = []
    for ranks, length in ((1, 470), (3, 470), (1, 470.0000000001)):
        coarse = ("--nx", 4, "--steps", 4, "--stroke", 24, "--max-imbalance", 0.2, "--balance", 1)
        options = (*coarse, "--fibre-angle", 30, "--length", length, "--no-pictures")
        done = launch("double_dome", *options, ranks=ranks)
        assert done.status == 0, done.err
        with open(done.folder / "history.csv", newline="") as file:
            forces = [float(row["reaction_N"]) for row in csv.DictReader(file)]
        q = done.summary["quantities"]
        found.append([*forces, q["shear_angle_max_deg"], q["draw_in"]["largest_mm"]])
    for again in found[1:]:
        assert again == pytest.approx(found[0], rel=1e-6)


def test_the_whole_ply_is_four_quarters(launch):
    same = "--ny", 5, "--steps", 3, "--stroke", 12, *EXACT
    quarter = launch("double_dome", "--nx", 8, *same)
    x, u = placed(quarter.folder)
    of_whole = float(last_row(quarter.folder)["reaction_of_whole_N"])
    whole = launch("double_dome", "--full", "--nx", 16, "--ny", 10, *same[2:])
    assert quarter.status == whole.status == 0, whole.err
    assert not any("keep the sheet in its place" in w for w in whole.summary["warnings"])
    reaction = float(last_row(whole.folder)["reaction_N"])
    assert of_whole == pytest.approx(reaction, rel=1e-6)
    full_x, full_u = placed(whole.folder)
    at = {tuple(place): k for k, place in enumerate(full_x)}
    for mirror in np.array([[1, 1, 1], [-1, 1, 1], [1, -1, 1], [-1, -1, 1]]):
        there = full_u[[at[tuple(place + 0.0)] for place in x * mirror]]
        assert abs(there * mirror - u).max() < 1e-6 * abs(u).max()
    assert whole.summary["reaction_N"] == pytest.approx(4 * quarter.summary["reaction_N"], rel=1e-6)


@pytest.mark.parametrize("holder, stroke", [("force", 40), ("gap", 5), ("grippers", 20)])
def test_blank_holders(launch, holder, stroke):
    done = launch(
        "double_dome",
        "--quick",
        "--nx",
        8,
        "--stroke",
        stroke,
        "--steps",
        8,
        "--holder",
        holder,
        "--no-pictures",
    )
    assert done.status == 0, done.err
    s = done.summary
    assert s["energy_imbalance"] < 0.03
    if holder == "gap":
        assert s["quantities"]["contact_forces_N"]["blank holder"] > 0
    if holder == "force":  # of a quarter
        assert s["quantities"]["contact_forces_N"]["blank holder"] == pytest.approx(
            25_000, rel=1e-6
        )


def test_a_run_goes_on_from_its_checkpoint(launch):
    options = "double_dome", "--nx", 6, "--steps", 10, "--stroke", 12, *EXACT
    whole = launch(*options)
    u = placed(whole.folder)[1]
    launch(*options, kill_at_row=5)
    done = launch(*options, "--resume", ranks=2)
    assert done.status == 0, done.err
    assert abs(placed(done.folder)[1] - u).max() < 1e-5 * abs(u).max()
    assert done.summary["energy"]["friction"] == pytest.approx(
        whole.summary["energy"]["friction"], rel=1e-4
    )


@pytest.mark.parametrize(
    "options, words",
    [
        (("--dome", "depth=-3"), ["depth", "-3", "above 0"]),
        (("--dome", "height=60"), ["--dome", "height", "entry_radius"]),
        (("--dome", "depth"), ["--dome NAME=VALUE", "depth is ''", "above 0"]),
        (("--stroke", 70), ["--stroke is 70", "up to 60"]),
        (("--clearance", 0.5), ["--clearance is 0.5", "from 0.697 mm"]),
        (("--penalty", 0), ["--penalty", "above 0"]),
        (("--holder", "gap", "--holder-gap", 0.2), ["gap", "is 0.2", "from 0.537"]),
        (("--holder-force", 5e4), ["--holder-force needs", "--holder force"]),
        (
            ("--holder", "gap", "--holder-pressure", 1),
            ["--holder-pressure needs", "--holder pressure"],
        ),
        (("--punch", "nowhere.stl"), ["--punch is", "nowhere.stl", "no file"]),
        (("--element", "P3"), ["P1", "P2"]),
        (("--friction", "nan"), ["--friction", "nan", "from 0"]),
        (("--dome", "depth=10"), ["--dome NAME=VALUE", "top_radius + entry_radius"]),
    ],
)
def test_bad_input(launch, options, words):
    done = launch("double_dome", "--quick", *options)
    assert done.status == 2 and "Traceback" not in done.err, done.err
    (line,) = [line for line in done.err.splitlines() if "error:" in line]
    assert all(word in line for word in words), line
    assert not done.folder.exists()


def test_a_punch_from_a_file(launch, tmp_path):
    import meshio
    from dome_triangles import double_dome

    points, triangles = double_dome(size=8.0, turn=6.0)
    meshio.write_points_cells(tmp_path / "punch.stl", points, [("triangle", triangles)])
    part, of_it = double_dome(size=8.0, turn=6.0, quarter=True)
    meshio.write_points_cells(tmp_path / "quarter.stl", part, [("triangle", of_it)])
    options = "--quick", "--nx", 6, "--stroke", 12, "--steps", 4, "--no-pictures"
    forces = []
    for punch in ((), ("--punch", "punch.stl")):
        done = launch("double_dome", *options, *punch)
        assert done.status == 0, done.err
        forces.append(done.summary["quantities"]["punch_force_N"])
    assert forces[1] == pytest.approx(forces[0], rel=0.02)
    for options, words in [
        (("--punch", "punch.stl", "--stroke", 61), ["--stroke is 61", "up to 60 mm"]),
        (("--punch", "quarter.stl"), ["--punch is open at (0, ", "the blank of 470 mm"]),
    ]:
        done = launch("double_dome", "--nx", 4, *options)
        assert done.status == 2 and all(word in done.err for word in words), done.err


def test_a_stroke_up_to_the_top_of_a_file_closes_its_die(tmp_path):
    import meshio
    from dome_triangles import double_dome

    points, triangles = double_dome(size=8.0, turn=6.0)
    file = tmp_path / "punch.stl"
    meshio.write_points_cells(file, points, [("triangle", triangles)])
    words = ["--nx", "4", "--punch", str(file), "--out", str(tmp_path / "out"), "--stroke"]
    left = []
    for stroke in ("60", "59"):
        made = build(Study("double_dome", dome_parser(DomeTest, ""), [*words, stroke]), DomeTest)
        left.append(made.schedule.distance("punch", 1.0))
    assert left[0] == pytest.approx(1.2 * made.thickness, abs=0.01)
    assert left[1] == pytest.approx(left[0] + 1, abs=0.01)


def test_a_file_of_an_option_is_not_one_beside_the_stack(tmp_path, monkeypatch):
    for name in ("plies", "here"):
        (tmp_path / name).mkdir()
    (tmp_path / "plies" / "sheet.csv").write_text("x,y\n0,0\n9,0\n9,9\n0,9\n")
    (tmp_path / "here" / "sheet.csv").write_text("x,y\n0,0\n235,0\n235,135\n0,135\n")
    (tmp_path / "plies" / "stack.toml").write_text('unit = "mm"\n[[ply]]\n[[ply]]\n')
    monkeypatch.chdir(tmp_path / "here")
    words = ["--nx", "4", "--outline", "sheet.csv", "--stack", "../plies/stack.toml"]
    study = Study("double_dome", dome_parser(DomeTest, ""), words)
    assert build(study, DomeTest).extent[1][0] == 235


def test_errors_of_a_stack_name_its_file(tmp_path):
    file = tmp_path / "stack.toml"
    for text, words in (
        ("[[ply]]\nfibre_angle = 'x'", "stack.toml: ply.1.fibre_angle is 'x'"),
        ("[[ply]", "stack.toml: is not valid TOML"),
        ("foo = 1", "stack.toml: entry foo is unknown"),
    ):
        file.write_text(f'unit = "mm"\n{text}\n')
        study = Study("double_dome", dome_parser(DomeTest, ""), ["--stack", str(file)])
        with pytest.raises(InputError, match=words):
            build(study, DomeTest)
    for options, words in (
        (["--nx", "4", "--clearance", "0.3"], "`clearance` is"),
        (["--layer", "A"], "^`layer` needs `outline`"),
    ):
        study = Study("double_dome", dome_parser(DomeTest, ""), options)
        with pytest.raises(InputError, match=words):
            build(study, DomeTest)


@pytest.mark.parametrize(
    "options, words",
    [
        ("--yarn-angle 80", "take the whole ply (--full)"),
        ("--holder-pressure 0", "--holder-pressure is 0: it does not hold the rim"),
        ("--holder grippers --gripper-tension 0", "--gripper-tension is 0: it does not hold"),
    ],
)
def test_warnings_speak_of_options(tmp_path, options, words):
    given = ["--nx", "4", "--out", str(tmp_path), *options.split()]
    study = Study("double_dome", dome_parser(DomeTest, ""), given)
    build(study, DomeTest)
    assert any(words in each for each in study.output.warnings)


@pytest.mark.versions
def test_compression_parameters(launch, monkeypatch):
    # of each ply, which others test
    monkeypatch.setattr(FormingScene, "pictures", lambda *_: None)
    options = "--nx", 6, "--steps", 2, "--vary", "s_C", "--stroke", 2
    done = launch("compression_parameters", *options)
    assert done.status == 0, done.err
    lines = (done.folder / "parameters.csv").read_text().splitlines()
    assert len(lines) == 4
    assert lines[0].startswith("figure,parameter,value")
    assert (done.folder / "s_C.png").stat().st_size > 10_000
    assert set(json.loads((done.folder / "summary.json").read_text())["quantities"]) == {
        f"s_C = {v}" for v in (10, 100, 1000)
    }


def test_plies_that_end_early_are_drawn_with_the_reason(launch, monkeypatch):
    """Without a floor of the biaxial coupling yarns have no stiffness left beside squeezed ones."""
    monkeypatch.setattr(FormingScene, "pictures", lambda *_: None)
    monkeypatch.setitem(compression_parameters.VARIED, "p_min", (0.0, 0.75))
    drawn = {}
    monkeypatch.setattr(
        pictures, "maps", lambda path, plies, *_, **__: drawn.update({path.name: plies})
    )
    done = launch("compression_parameters", "--quick", "--nx", 7, "--vary", "p_min")
    assert done.status == 3 and "1 of 2 plies were not formed to the end" in done.err
    with open(done.folder / "parameters.csv") as file:
        ended, formed = csv.DictReader(file)
    words, load = "yarns are stretched by more than 10 % in ", float(ended["stroke_reached"])
    assert words in ended["reason"] and "(--max-strain)" in ended["reason"]
    assert 0.2 < load < 0.5 and not formed["reason"] and float(formed["stroke_reached"]) == 1
    because = ended["reason"].split(";")[0]
    assert [title.replace("\n", " ") for title in drawn["p_min.png"]] == [
        f"p_min = 0: ends at load {load:.2f} {because}",
        "p_min = 0.75",
    ]
