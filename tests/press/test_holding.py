"""Blank holders, segments of them, and where the flange lies."""

import dataclasses

import numpy as np
import pytest
from builders import KOMEILI, dome

import fabric_fenicsx as ff
from fabric_fenicsx.press.holders import Region
from fabric_fenicsx.press.site import Flange
from fabric_fenicsx.scene import output as reports

SIZES = {"nx": 4, "stroke": 8.0}
LEFT, RIGHT = Region({"x": [-100, 40]}), Region({"x": [0, 100]})
HALVES = [lambda x: x[0] < 140, lambda x: x[0] >= 140]


@pytest.mark.mpi
def test_segments_of_a_stack_press_its_sheets_together_as_one_does():
    plies = [{"fibre_angle": angle} for angle in (0, 45)]
    halves = [ff.PressureHolder(1.0, where=half) for half in HALVES]
    holders = ff.PressureHolder(1.0), halves
    one, two = (dome(**SIZES, plies=plies, holder=each) for each in holders)
    assert one.scene.comm.allreduce(float(np.abs(one.scene.blank.u.x.array).max())) > 0
    assert two.scene.blank.u.x.array == pytest.approx(one.scene.blank.u.x.array, abs=1e-14)
    names = [tool.name for tool in reports.tools(two.scene)] + [t.tool.name for t in two.pressing]
    assert {"blank holder", "blank holder 2"} <= {*names}


def held_whole(holders, symmetry="xy"):
    """Force of the pressures on what is modelled of the hemisphere's blank at the start [N]."""
    nx = 5 if symmetry == "xy" else 10
    press = ff.Press.read("hemisphere", [f"blank.nx={nx}", f"blank.symmetry={symmetry}"])
    built = press.replace(holders=holders).build()
    return sum(t.force()[2] for t in built.pressing if isinstance(t, ff.BlankHolderPressure))


@pytest.mark.parametrize("limit", [20, 37.3])  # on nodes, and between them
def test_segments_with_a_common_limit_press_each_node_once(limit):
    """Also those that rounding puts just beyond the blank's edge."""
    halves = (-100, limit), (limit, 100)
    segments = [ff.PressureHolder(0.02, Region({"x": ends})) for ends in halves]
    whole = held_whole({"holder": ff.PressureHolder(0.02)})
    assert held_whole(dict(zip("ab", segments))) == pytest.approx(whole, rel=1e-12)
    assert held_whole({"holder": segments}) == pytest.approx(whole, rel=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize(
    "one, other, words",
    [
        (ff.PressureHolder(0.02), ff.PressureHolder(0.02), "28800 mm2"),
        (ff.PressureHolder(0.02, LEFT), ff.ForceHolder(100, RIGHT), "7200 mm2 of the blank"),
        (*(ff.Grippers(1.0, edges=[f"{k} x", "low y"]) for k in ("low", "high")), "11 nodes of"),
    ],
)
def test_segments_that_overlap_are_refused_with_their_area(one, other, words):
    with pytest.raises(ff.InputError, match=f"holders.a and holders.b overlap on ({words})"):
        held_whole({"a": one, "b": other}, "none" if "nodes" in words else "xy")


def test_grippers_may_share_corners():
    ends = [ff.Grippers(1.0, edges=[f"{end} {axis}" for axis in "xy"]) for end in ("low", "high")]
    assert held_whole(dict(zip("ab", ends)), "none") == 0


@pytest.mark.mpi
def test_a_stack_is_pressed_where_any_of_its_sheets_lies_on_the_flange():
    """A cross of two sheets over a patch in its middle, under a flat die: the area of the cross;
    `full_stack` presses what all have in common."""
    sizes = {"patch": (20, 22), "along": (100, 60), "across": (56, 94)}
    tools = {"ball": ff.PressTool(ff.Sphere(20.0))}
    tools["die"] = ff.PressTool(ff.Plane((0, 0, 0), (0, 0, -1)), side="above")
    strip = ff.Sheet(fabric=KOMEILI, nx=7)
    cross = [dataclasses.replace(strip, length=a, width=b, name=n) for n, (a, b) in sizes.items()]
    press = ff.Press(sheets=cross, tools=tools, stages=ff.Stage(moves={"ball": 0.1}))
    for full, area, within in (False, 6000 + 56 * 34, 2e-3), (True, 20 * 22, 0.02):
        held = press.replace(holders={"holder": ff.PressureHolder(0.02, full_stack=full)}).build()
        force = held.columns(held.scene)["holder_force_of_whole_N"]
        assert force == pytest.approx(0.02 * area, rel=within)


@pytest.mark.parametrize("gap, meant", [(None, 1.1 * 1.07427), (0.54, 0.54)])
def test_a_plate_stands_at_its_gap_from_the_die(gap, meant):
    press = ff.Press.read("hemisphere", ["blank.nx=4"])
    made = press.replace(holders={"plate": ff.GapHolder(gap)}).build()
    (plate,) = made.holders["plate"]
    face = made.tools["ring"].path(0)[2]
    assert plate.tool.evaluate([[90, 90, face]]).gap == pytest.approx([meant], rel=1e-5)


def test_springs_pull_at_a_quarter_as_at_the_whole_blank():
    """Half of one on a plane of symmetry, and of the parallel ones of an edge across it."""
    springs = ff.SpringHolder(0.5, preload=8.0, edges=["high x"], at=[(100, 0), (60, 80)])
    press = ff.Press.read("hemisphere", ["blank.nx=5"])
    made = press.replace(holders={"springs": springs}).build()
    forces = [term.force() for term in made.holders["springs"]]
    assert np.array(forces) == pytest.approx(np.array([[4, 0, 0], [4, 0, 0], [4.8, 6.4, 0]]))
    with pytest.raises(ff.InputError, match=r"point \(130, 140\) mm, 50 mm off the blank"):
        press.replace(holders={"springs": ff.SpringHolder(0.5, at=[(130, 140)])}).build()
    made.scene.blank.u.x.array[::3] = -2.0  # by which those along x are longer
    pulls = [term.pull() for term in made.holders["springs"]]
    assert pulls[:2] == pytest.approx([4.5, 4.5]) and pulls[2] == pytest.approx(8.6, abs=0.01)


def test_grippers_pull_at_the_edges_that_are_marked():
    ply = dome(**SIZES, holder=ff.Grippers(3.0, where=lambda x: x[0] > 234))
    assert sum(isinstance(term, ff.EdgeTension) for term in ply.scene.terms) == 1
    with pytest.raises(ff.InputError, match="`where` of holders.blank holder selects no edge"):
        dome(**SIZES, holder=ff.Grippers(where=lambda x: x[0] < 1))


def test_a_pressure_that_is_directed_away_from_the_die_is_told_of():
    class Own:
        def terms(self, site):
            return [ff.BlankHolderPressure(1.0, (0, 0, -1), site.on_flange())]

    told = "of blank holder is directed away from the die: towards it is (0, 0, 1)"
    assert any(told in words for words in dome(**SIZES, holder=Own()).warnings)


@pytest.mark.mpi
def test_the_history_has_the_force_of_each_holder_on_the_whole_blank():
    """Of the quarter that is modelled, too, as its file gives them."""
    left, right = Region({"x": [0, 70]}), Region({"x": [70, 100]})
    holders = {
        "low": [ff.ForceHolder(300.0, left), ff.PressureHolder(0.02, right)],
        "pull": ff.Grippers(2.0),
        "springs": ff.SpringHolder(0.5, preload=80.0, edges=["high y"]),
    }
    rigid = ["blank.nx=6", "stage.1.moves.punch=3", "contact.penalty=300"]
    built = ff.Press.read("hemisphere", rigid).replace(holders=holders).build()
    result = built.job(steps=1, balance=None).run()
    row, q = result.rows[-1], result.summary["quantities"]
    assert row["springs_force_of_whole_N"] == pytest.approx(2 * 80, rel=0.05)
    assert q["force_of_whole_blank_N"] == pytest.approx(4 * row["reaction_N"])
    assert q["unbalanced_force_N"] < 1e-4 * row["reaction_N"]
    for term in built.pressing:
        forces = term.nodes.total(term._pressing_forces())
        told = q["contact_forces_N"][term.tool.name]
        assert told == pytest.approx(np.sqrt((forces**2).sum()), rel=1e-6)
    depths = [-term.gap()[term.nodes.mask] for term in built.contacts]
    most = max(built.scene.comm.allgather(max(each.max(initial=0) for each in depths)))
    assert q["penetration_mm"] == pytest.approx(most) and most > 0
    assert row["low_force_of_whole_N"] == pytest.approx(300, rel=1e-6)
    assert row["low_2_force_of_whole_N"] == pytest.approx(4 * built.pressing[-1].force()[2])
    assert row["pull_force_of_whole_N"] == pytest.approx(2.0 * 4 * 200)
    assert (row["punch_travel_mm"], row["ring_travel_mm"]) == (pytest.approx(3), 0)
    tools = [row[f"{name}_force_N"] for name in ("punch", "ring")]
    assert tools[0] == pytest.approx(row["reaction_N"])
    held = [row[f"low{k}_force_of_whole_N"] / 4 for k in ("", "_2")]
    sprung = sum(term.force()[2] for term in built.holders["springs"])
    assert sum(tools) + sum(held) + sprung == pytest.approx(0, abs=1e-4 * abs(tools[1]))


T = 2e-4
EXTENT = np.array([[-50, -60, 0], [50, 60, 0]])  # some places lie beyond
PLACES = np.random.default_rng(0).uniform(-60, 60, (3, 4000))


def test_the_share_falls_where_the_radius_begins():
    """Of 5 mm: to half of it, 0.23 mm on."""
    plate = ff.Flipped(ff.Plate(80.0, entry=5.0))
    die = ff.Tool(plate, lambda load: (0, 0, 0.5), name="die")
    x = np.array([45.1, 45.0, 44.95, 44.77, 44.6])
    share = Flange(die, 1.0, 1.0, EXTENT)(np.array([x, 0 * x, 0 * x]))
    assert share[[0, 1, 2, 4]].tolist() == [1, 1, 1, 0] and share[3] == pytest.approx(0.49, abs=0.1)


def test_the_share_is_that_of_each_place():
    """Though most places are judged by the lattice about them; whatever was asked before, and
    where the die has moved to: its opening of radius 40 mm, just over z = 0, goes 3 mm along x."""
    die = ff.Tool(ff.Flipped(ff.Plate(80.0)), lambda load: (3 * load, 0, T / 2), name="die")
    flange = Flange(die, T, 1.0, EXTENT)
    for load, places in ((0.0, PLACES), (0.0, PLACES[:, ::-7]), (1.0, PLACES)):
        die.at(load)
        right = np.hypot(places[0] - 3 * load, places[1]) >= 40
        assert np.array_equal(flange(places), right) and {0.0, 1.0} == {*right}
