"""What is said of a result that is not valid, or doubtful."""

import dataclasses
import re

import numpy as np
import pytest
from builders import Elastic, everywhere, near, sheet
from made_results import made, strip

import fabric_fenicsx as ff
from fabric_fenicsx.job import validity
from fabric_fenicsx.solve import step_criteria


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
    words = "yarns are stretched by more than 10 % in 1.02 % of the sheet; allowed is 1 % of it"
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
    assert not told or found[0].endswith("; deepest is low at (1, 2) mm")


@pytest.mark.parametrize("height, told", [(-5.0, True), (1.0, False)])
def test_a_sheet_may_not_pass_through_itself(height, told):
    """Its end is laid back over its beginning, and 1 mm aside."""

    def folded(x, y, z):
        s, along = [0, 10, 20, 30, 40], [0, 10, 20, 10, 5]
        return np.interp(x, s, along) - x, x / 40, np.interp(x, s, [0, 0, 5, 5, height])

    scene = moved(sheet(40, 10, 4, 1, "right", spatial=True), folded)
    found = validity.beyond_limits_at_end(scene, ff.Limits(), ROWS, ENERGY)
    assert len(found) == told
    assert not told or re.match(r"sheet blank passes through itself at \d places, as at", found[0])


def test_a_sheet_may_not_pass_through_its_image():
    """The two nodes at x = 1 mm go to -2 mm."""
    plane = ff.Support("plane", near(0, 0.0), (0,))
    back = lambda x, y, z: (-3.0 * (abs(x - 1) < 1e-6), 0 * x, z)  # noqa: E731
    scene = moved(strip(), back, supports=[plane])
    found = validity.beyond_limits_at_end(scene, ff.Limits(), ROWS, ENERGY)
    assert any("its image: 2 nodes lie up to 2 mm beyond the plane that" in each for each in found)


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
    assert "energy differ by 2.1 %; take smaller steps" in words
    (words,) = doubts(rows=rows, **below)
    assert words.endswith("drives the sheet, as energies are below 0: bedding -3 N mm")
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
    assert words.startswith("heights of wrinkles, up to 2 mm, are rough, as 30 mm of a wave are 6 ")
    assert words.endswith("cells; take 7.5: `nx` 1.25 times as large")
    assert len(doubts(waves(cells_a_wave=6.99))) == 1


def test_ripples_from_a_tenth_of_a_millimetre_on_are_told():
    plies = {"a": waves(ripples_mm=0.05), "b": waves(ripples_mm=0.101)}
    (words,) = doubts({"plies": plies})
    assert words.startswith("ripples of the mesh, up to 0.101 mm high, are no wrinkles")
    assert words.endswith("make no waves shorter than 12 mm")
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
    assert re.search(r"most is at \([\d.]+, [\d.]+\) mm of the", summary["reasons"][0]["text"])
    assert row["shortened_by_2_percent_share"] == pytest.approx(1)
    assert row["shortening_max"] == pytest.approx(0.06, rel=0.2)


def test_a_run_ends_where_steps_fail_as_a_ply_cannot_be_formed(pressed, monkeypatch):
    """From 9 % of shortening on no step passes; the third would be a quarter of the first."""
    criterion = step_criteria.negative_bending
    fails = lambda energies: "too hard" if energies["strain"] > 4.5 else criterion(energies)  # noqa: E731
    monkeypatch.setattr(step_criteria, "negative_bending", fails)
    with pytest.raises(ff.SolverFailure, match="shortens yarns by more than 5 %") as failure:
        pressed.run()
    summary = failure.value.result.summary
    assert (summary["steps_accepted"], summary["steps_rejected"]) == (3, 2)
