"""What is said of a result: not valid, doubtful, or with the errors of coarser cells."""

import csv
import dataclasses
import json
import re

import numpy as np
import pytest
from builders import COARSE, COMM, Elastic, everywhere, near, said, sheet
from made_results import made, strip
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.job import validity
from fabric_fenicsx.solve.stepping import LoadStepping


def moved(blank, u, *terms, supports=()):
    """The scene of a sheet displaced by u(x, y, z)."""
    scene = ff.Scene(blank, [ff.Membrane(ff.load("komeili")), *terms], supports)
    blank.u.x.array[:] = np.column_stack(u(*blank.coordinates().T)).ravel()
    scene.set(scene.u.copy())
    return scene


@pytest.mark.parametrize("length, eps, told", [(1.02, 0.101, 1), (1.02, 0.099, 0), (0.98, 0.2, 0)])
def test_yarns_may_be_stretched_by_10_percent_but_in_1_percent_of_the_area(length, eps, told):
    pulled = lambda x, y, z: (eps * np.minimum(x, length), 0 * x, 0 * x)  # noqa: E731
    scene = moved(strip((length, 100 - length)), pulled)
    found = validity.beyond_limits_now(scene, ff.Limits())
    words = "yarns are stretched by more than 10 % in 1.02 % of the sheet; the limit is 1 %"
    assert len(found) == told and all(each.startswith(words) for each in found)


@pytest.mark.parametrize("depth, told", [(0.101, 1), (0.099, 0)])
def test_tools_may_cut_into_a_tenth_of_the_thickness(monkeypatch, depth, told):
    """Of the deeper of two; the ply is 1 mm thick."""
    tools = [ff.Tool(ff.Plane((0, 0, -2), (0, 0, 1)), name=name) for name in ("high", "low")]
    contacts = [ff.Contact(tool) for tool in tools]
    scene = moved(strip(), lambda x, y, z: (0 * x, 0 * x, 0 * x), *contacts)
    monkeypatch.setattr(type(contacts[0]), "penetration_of_thickness", lambda c: 0.0)
    monkeypatch.setattr(contacts[1], "penetration_of_thickness", lambda: depth, raising=False)
    monkeypatch.setattr(contacts[1], "where_deepest", lambda: "low at (1, 2) mm", raising=False)
    found = validity.beyond_limits_now(scene, ff.Limits())
    assert len(found) == told
    assert not told or found[0].startswith(f"the sheet is penetrated by {100 * depth:g} % of its")
    assert not told or found[0].endswith("; deepest: low at (1, 2) mm")


@pytest.mark.parametrize("height, told", [(-5.0, True), (1.0, False)])
def test_a_sheet_may_not_pass_through_itself(height, told):
    """Its end is laid back over its beginning, and 1 mm aside."""

    def folded(x, y, z):
        s, along = [0, 10, 20, 30, 40], [0, 10, 20, 10, 5]
        return np.interp(x, s, along) - x, x / 40, np.interp(x, s, [0, 0, 5, 5, height])

    scene = moved(sheet(40, 10, 4, 1, "right", spatial=True), folded)
    found = validity.beyond_limits_at_end(scene, ff.Limits(), ROWS, ENERGY)
    assert len(found) == told
    assert not told or re.match(r"sheet blank passes through itself at \d places, e.g.", found[0])


def test_a_sheet_may_not_pass_through_its_image():
    """The two nodes at x = 1 mm go to -2 mm."""
    plane = ff.Support("plane", near(0, 0.0), (0,))
    back = lambda x, y, z: (-3.0 * (abs(x - 1) < 1e-6), 0 * x, z)  # noqa: E731
    scene = moved(strip(), back, supports=[plane])
    found = validity.beyond_limits_at_end(scene, ff.Limits(), ROWS, ENERGY)
    assert any("its image: 2 nodes lie up to 2 mm beyond the plane of" in each for each in found)


ENERGY = {"strain": 60.0, "metal": 20.0, "bending": 20.0, "viscous": 0.0, "external_work": 100.0}
ROWS = [{f"{name}_energy_Nmm": value for name, value in ENERGY.items()}]
ROWS[0] |= {"load": 1.0, "energy_imbalance": 0.0, "saddles": 0}


@pytest.mark.parametrize(
    "changes, told",
    [
        ({"external_work": 105.1}, "energies by 5.1 % of these"),
        ({"external_work": 94.9}, "energies by 5.1 % of these"),
        ({"external_work": 104.9}, ""),
        ({"viscous": 4.1, "external_work": 104.1}, "took 5.12 % of the strain energy"),
        ({"viscous": 3.9, "external_work": 103.9}, ""),
    ],
)
def test_a_run_may_miss_5_percent_of_its_energy(changes, told):
    """Drag is compared with what stretching stores."""
    scene = made(strip()).scene
    found = validity.beyond_limits_at_end(scene, ff.Limits(), ROWS, ENERGY | changes)
    assert len(found) == bool(told) and all(told in each for each in found)


def doubts(quantities=None, rows=ROWS, scene=None, **energy):
    result, held = made(strip()), ff.Support("all", everywhere, (0, 1, 2))
    result.rows, result.scene = rows, scene or ff.Scene(strip(), [Elastic()], [held])
    found = validity.doubts(result, ENERGY | energy, quantities or {})
    return [each.text for each in found if each.text]


def test_a_work_that_misses_2_percent_is_told_with_its_cause():
    below = {"external_work": 96.0, "bending": 14.0, "bedding": -3.0, "contact": 7.0}
    rows = [ROWS[0] | {"bedding_energy_Nmm": -3.0, "contact_energy_Nmm": 7.0}]
    assert not doubts(external_work=101.9)
    (words,) = doubts(external_work=102.1)
    assert "energy differ by 2.1 %; use smaller steps" in words
    (words,) = doubts(rows=rows, **below)
    assert words.endswith("instead of resisting it: bedding -3 N mm")
    (words,) = doubts(rows=[*ROWS, ROWS[0] | {"saddles": 2, "load": 0.35}])
    assert words.startswith("the path branches at load 0.35:")
    (words,) = doubts(**dict.fromkeys(ENERGY, 0.0))
    assert words.startswith("nothing moves or loads the sheet")


def test_stresses_of_elements_and_kernel_differ_by_a_millionth_at_most(monkeypatch):
    held = ff.Support("all", everywhere, (0, 1, 2))
    for most, told in ((1.1e-6, True), (0.9e-6, False)):
        given = {"kernel_mismatch": ff.largest(most)}
        monkeypatch.setattr(ff.Membrane, "summary", lambda self, given=given: given)
        scene = moved(strip(), lambda x, y, z: (0.001 * x, 0 * x, 0 * x), supports=[held])
        found = doubts(scene=scene)
        assert any("of the kernel differ by 0.00011 %" in each for each in found) == told


def waves(**given):
    usual = {"cells_a_wave": 9.0, "height_mm": 1.0, "wavelength_mm": 30.0, "ripples_mm": 0.0}
    return {"wrinkles": usual | {"seen_mm": [12.0, 80.0]} | given}


def test_heights_of_waves_of_less_than_7_cells_are_rough():
    """Told of the ply with the fewest."""
    assert not doubts(waves(cells_a_wave=7.01)) and not doubts(waves(cells_a_wave=None))
    plies = {"a": waves(cells_a_wave=6.9), "b": waves(cells_a_wave=6.0, height_mm=2.0), "c": {}}
    (words,) = doubts({"plies": plies})
    assert words.startswith("heights of wrinkles, up to 2 mm, are inaccurate: a wave of 30 mm has")
    assert words.endswith("cells; use 7.5: `nx` 1.25 times as large")
    assert len(doubts(waves(cells_a_wave=6.99))) == 1


def test_ripples_from_a_tenth_of_a_millimetre_on_are_told():
    plies = {"a": waves(ripples_mm=0.05), "b": waves(ripples_mm=0.101)}
    (words,) = doubts({"plies": plies})
    assert words.startswith("ripples up to 0.101 mm high are mesh artefacts, not wrinkles")
    assert words.endswith("form no waves shorter than 12 mm")
    assert not doubts(waves(ripples_mm=0.099))


@pytest.fixture
def pressed():
    """A sheet in space, pressed together by 3, 6, 9 and 12 % along x, which is kept from buckling;
    from 5 % on it is too much."""
    blank = ff.Blank.rectangle(40, 20, nx=8, ny=4, spatial=True)
    supports = [*ff.clamped_ends(-4.8)(blank), ff.Support("flat", everywhere, (1, 2))]
    terms = [ff.Membrane(ff.load("komeili")), ff.Bending(modulus=100.0)]
    return ff.Job(ff.Scene(blank, terms, supports), steps=4)


@pytest.mark.mpi
def test_a_run_ends_at_the_step_where_a_ply_cannot_be_formed_if_asked_for(pressed):
    with pytest.raises(ff.SolverFailure, match="the run ends at load factor 0.5") as failure:
        dataclasses.replace(pressed, stop_when_invalid=True).run()
    summary, row = failure.value.result.summary, failure.value.result.rows[-1]
    assert summary["stroke_reached"] == 0.5 and summary["verdict"] == "invalid"
    assert re.search(r"at most at \([\d.]+, [\d.]+\) mm of the", summary["reasons"][0]["text"])
    assert row["shortened_by_2_percent_share"] == pytest.approx(1)
    assert row["shortening_max"] == pytest.approx(0.06, rel=0.2)


def test_a_run_ends_where_steps_fail_as_a_ply_cannot_be_formed(pressed, monkeypatch):
    """From 9 % of shortening on no step passes; the third would be a quarter of the first."""
    measure = LoadStepping._measure

    def fails(self, trial):
        measure(self, trial)
        trial.report.reject("too hard" * (trial.energies["strain"] > 4.5))

    monkeypatch.setattr(LoadStepping, "_measure", fails)
    with pytest.raises(ff.SolverFailure, match="shortens yarns by more than 5 %") as failure:
        pressed.run()
    summary = failure.value.result.summary
    assert (summary["steps_accepted"], summary["steps_rejected"]) == (3, 2)


@pytest.mark.versions
@pytest.mark.mpi
def test_a_strips_errors_are_told_by_other_cells(folder):
    """1.75 times the difference to P2 cells along the yarns on one rank; in summary.json,
    history.csv and the fields."""
    result = ff.Tensile(**COARSE).job(steps=4, error=True).run(folder, pictures=False)
    other = ff.Tensile(nx=4, element="P2", pattern="yarns").build(MPI.COMM_SELF).job(steps=2).run()
    apart, error = result.number("reaction_N") - other.number("reaction_N"), told(result)
    assert error["reaction_N"] == pytest.approx(1.75 * abs(apart), rel=1e-4)
    assert result.summary["error_run"]["cells"] == other.summary["cells"]
    assert (folder / "coarse" / "history.csv").exists()
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["error"] == result.summary["error"]
    with open(folder / "history.csv", newline="") as file:
        errors = [float(row["error_N"]) for row in csv.DictReader(file)]
    assert len(errors) == 5 and max(errors) == pytest.approx(error["curve_N"])
    assert result.fields.units["error_shear_angle"] == "rad"
    if COMM.rank == 0:
        assert np.asarray(result.grid.cell_data["error_log_eps_22"]).max() > 0


def told(result):
    return {name: error for name, error in result.summary["error"].items() if error is not None}


def test_an_own_coarser_run_has_cells_of_the_same_kind():
    """The root mean square of the curve's differences, of two rows."""

    def strip(nx, **options):
        return ff.Tensile(nx=nx, element="P1").job(steps=2, **options)

    result, other = strip(8, error=True, coarser=lambda: strip(4)).run(), strip(4).run()
    forces, others = ([row["reaction_N"] for row in each.rows[1:]] for each in (result, other))
    expected = np.sqrt(np.mean((np.divide(others, forces) - 1) ** 2)) * forces[-1]
    assert told(result)["reaction_N"] == pytest.approx(expected, rel=1e-3)


def test_errors_come_after_the_run_too(folder):
    """A run that has ended gets its errors by going on, once."""
    at_once = ff.Tensile(**COARSE).job(steps=2, error=True).run()
    ff.Tensile(**COARSE).job(steps=2).run(folder, pictures=False)
    again = ff.Tensile(**COARSE).job(steps=2, error=True)
    later = again.run(folder, resume=True, pictures=False)
    assert told(later) == pytest.approx(told(at_once), rel=1e-6)
    written = (folder / "summary.json").stat().st_mtime_ns
    ff.Tensile(**COARSE).job(steps=2, error=True).run(folder, resume=True, pictures=False)
    assert (folder / "summary.json").stat().st_mtime_ns == written


def test_a_coarser_run_that_fails_costs_the_errors_alone():
    def refused():
        raise ff.InputError("no such mesh; expected another")

    job = ff.Tensile(**COARSE).job(steps=2, coarser=refused, error=True)
    summary = job.run().summary
    assert summary["converged"] and "error" not in summary and summary["verdict"] == "doubtful"
    assert any("errors are unknown" in text and "no such mesh" in text for text in said(summary))


def test_a_coarser_run_that_is_not_valid_but_loaded_in_full_tells_errors():
    """The same run, whose yarns are stretched beyond limits four times as wide, too."""
    limited = ff.Tensile(**COARSE).job(steps=2, limits=ff.Limits(strain=1e-5))
    result = ff.Tensile(**COARSE).job(steps=2, coarser=lambda: limited, error=True).run()
    assert told(result)["reaction_N"] == pytest.approx(1e-3 * result.summary["reaction_N"])


def test_ok_needs_a_force_to_10_percent_and_an_angle_to_3_degrees():
    def doubted(*errors, angle=40.0):
        names = "reaction_N", "shear_angle_99_percent_deg"
        summary = dict(zip(names, (-200.0, angle))) | {"error": dict(zip(names, errors))}
        return validity.error_doubts(ff.Result(summary, [], {}, None, None), "force of punch")

    assert not doubted(20.0, 3.0)
    (force,), (angle,) = doubted(20.1, 2.9), doubted(0.0, 3.1)
    assert force.of == "_N" and "10 %: force of punch -200 +- 20 N" in force.text
    assert angle.of == "shear_angle" and "3 deg: 99th percentile of the shear" in angle.text
    assert [each.of for each in doubted(None, None)] == ["_N", "shear_angle"]
    assert not doubted(0.0, None, angle=2.9)  # it may be off by all of it


def test_only_errors_of_forces_are_told_where_cells_crumple(monkeypatch):
    monkeypatch.setattr("fabric_fenicsx.results.error.mesh_decides", lambda _: "cells crumple")
    result = ff.Tensile(**COARSE).job(steps=2, error=True).run()
    assert {*told(result)} == {"reaction_N", "strain_energy_Nmm", "curve_N", "curve_steps_N"}
    assert any("cells crumple" in text for text in said(result.summary))


@pytest.mark.parametrize("nx, told", [(32, True), (31, False)])
def test_strips_of_1000_cells_tell_their_errors_unasked(launch, nx, told):
    pictures = () if told else ("--no-pictures",)
    done = launch("tensile", "--nx", nx, "--element", "P1", "--steps", 2, *pictures)
    assert done.status == 0, done.err
    assert (done.folder / "error.png").exists() == told
    page = (done.folder / "report.html").read_text()
    assert ("estimated absolute errors" in page) == told
    assert ("error" in done.summary) == told == (" +- " in done.out)


def test_a_tool_is_measured_along_its_motion(monkeypatch):
    """The first one that moves, by 5 mm along (3, 0, 4); a support that moves, too, is not."""
    ways = {"a": (0, 0, 0), "b": lambda load: (3 * load + 1, 2, 4 * load)}
    tools = [ff.Tool(ff.Sphere(5, (0, 0, -20)), way, name=k) for k, way in ways.items()]
    terms = [Elastic(), *(ff.Contact(tool, 1.0, 100.0) for tool in tools)]
    scene = ff.Scene(sheet(20, 10, 2, 1, spatial=True), terms, ff.clamped_ends(1.0))
    forces = {"a": (9.0, 9.0, 9.0), "b": (1.0, 2.0, 3.0)}
    monkeypatch.setattr("fabric_fenicsx.scene.output.tool_force", lambda _, tool: forces[tool.name])
    assert ff.Setup(scene).measure(scene, 0.5) == pytest.approx((2.5, 3.0))


def test_of_supports_the_one_that_moves_furthest_is_measured(monkeypatch):
    """Along the mean motion of its nodes, which goes to 3 and 4 mm at y = 5 mm."""
    pulled = lambda x, load: load * np.array([0.6 * x[1], 4 + 0 * x[1]])  # noqa: E731
    supports = [ff.Support("small", near(0, 0.0), (0, 1), (-1.0, 0.0))]
    supports.append(ff.Support("large", near(0, 20.0), (0, 1), pulled))
    scene = ff.Scene(sheet(20, 10, 2, 2), [Elastic()], supports)
    monkeypatch.setattr(ff.Scene, "reaction", lambda _, name: {"large": [1.0, 2.0]}[name])
    assert ff.Setup(scene).measure(scene, 0.5) == pytest.approx((2.5, 0.6 + 1.6))
    still = ff.Scene(sheet(20, 10, 2, 2), [Elastic()])
    assert ff.Setup(still).measure(still, 1.0) == (0.0, 0.0)
