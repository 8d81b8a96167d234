"""What stages, limits and defaults say, as data: nothing is built."""

import numpy as np
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.core.fields import check_fields
from fabric_fenicsx.press.holders import Region
from fabric_fenicsx.press.placement import check_clearance
from fabric_fenicsx.press.stages import Schedule

BALL = ff.Sphere(10)
STAGES = [
    ff.Stage("up", moves={"punch": 10, "slide": 4}, steps=3),
    ff.Stage(moves={"slide": [3, 0, -4]}, pressures={"holder": 0.1}, forces={"ring": 200}, steps=1),
    ff.Stage("push", forces={"ring": 300}, steps=2),
    ff.Stage("back", leave=["punch"], steps=2),
    ff.Stage(unload=True),
]


def schedule(stages, reach=()):
    tools = {"punch": ff.PressTool(BALL), "slide": ff.PressTool(BALL, "above")}
    tools |= {"ring": ff.PressTool(BALL, "above", force=100.0), "die": ff.PressTool(BALL, "above")}
    holders = {"holder": ff.PressureHolder(0.02), "other": ff.PressureHolder(1.0)}
    return Schedule(stages, tools, holders, dict(reach), 2.0)


def test_tools_go_and_push_in_proportion_to_the_steps():
    """Three, one, two and two of eight."""
    made = schedule(STAGES)
    assert made.unloads and made.joints.tolist() == [0, 0.375, 0.5, 0.75, 1]
    loads = (0, 0.1875, 0.375, 0.4375, 0.75, 0.875, 1)
    path = made.path("punch", np.array([1.0, 2, -5]))
    assert path(0.5)[:2].tolist() == [1, 2]
    assert [path(load)[2] for load in loads] == pytest.approx([-5, 0, 5, 5, 5, 0, -5])
    slide = np.array([made.path("slide", np.zeros(3))(load) for load in (0.375, 0.4375, 1)])
    assert slide == pytest.approx(np.array([[0, 0, -4], [1.5, 0, -6], [3, 0, -8]]))
    force, pressure = made.force("ring", 0.5), made.pressure("holder")
    down = [-2 * force(at)[2] for at in (*loads, 0.625)]
    assert down == pytest.approx([100, 100, 100, 150, 300, 300, 300, 250])
    assert [pressure(at) for at in (0.2, 0.4375, 1)] == pytest.approx([0.02, 0.06, 0.1])
    assert made.pressure("other") is None
    assert [made.is_moved(name) for name in ("punch", "ring", "die")] == [True, True, False]
    assert [made.stage_at(load) for load in (0, 0.375, 0.4, 0.9, 1)] == [0, 0, 1, 3, 3]


def test_the_travel_is_that_of_the_tool_that_moves_furthest_in_each_stage():
    """A tool that a force moves has none, as that is not known."""
    made = schedule(STAGES)
    assert made.leaders() == ["punch", "slide", "ring", "punch"]
    travel = [made.travel(load) for load in (0.1875, 0.375, 0.4375, 0.5, 0.75, 0.875, 1)]
    assert travel == pytest.approx([5, 10, 12.5, 15, 15, 20, 25])


def test_a_stage_closes_what_is_left():
    """From 62 mm to 1.5 thicknesses of 2 mm, after 20 mm."""
    stages = [ff.Stage("on", moves={"punch": 20}, steps=1), ff.Stage(close=1.5, steps=1)]
    made = schedule(stages, {"punch": 62.0})
    distances = [made.distance("punch", at) for at in (0, 0.5, 0.75, 1)]
    assert distances == pytest.approx([62, 42, 22.5, 3])
    assert made.path("punch", np.zeros(3))(1)[2] == pytest.approx(59)


def test_places_within_limits():
    x = np.array([[30.0, 0, -30, 0], [0, 40.0, 0, -40], [0, 0, 0, 0]])
    assert Region({"x": [-1, 30]})(x).tolist() == [True, True, False, True]
    assert Region({"y": [-1, 39]})(x).tolist() == [True, False, True, False]
    assert Region({"r": [35, 45]})(x).tolist() == [False, True, False, True]
    assert Region({"angle": [80, 100]})(x).tolist() == [False, True, False, False]
    assert Region({"angle": [-100, 10]})(x).tolist() == [True, False, False, True]
    about = Region({"r": [0, 31], "angle": [-10, 10]}).about(np.array([0.0, 40]))
    assert about(x).tolist() == [False, True, False, False]
    near = Region({"at": [30, 0], "r": [0, 1]}).about(np.zeros(2))
    assert near(x).tolist() == [True, False, False, False]


def test_a_clearance_is_from_the_pressed_thickness_to_the_concave_radius():
    """Of 0.7 mm, to 14 mm."""
    ring = ff.Torus((0, 0, 0), (0, 0, 1), ring=20, tube=6)
    check_clearance("die", 0.71, 0.7, ring)
    for clearance, words in ((0.69, "from 0.7 mm"), (14.1, "below 14 mm")):
        with pytest.raises(ff.InputError, match=words):
            check_clearance("die", clearance, 0.7, ring)


def test_pressures_above_10_mpa_are_doubted():
    assert [bool(check_fields(ff.PressureHolder(p))) for p in (9.9, 10.1)] == [False, True]


def test_friction_is_that_of_the_paper():
    """Fabric on tools 0.25, metal on tools 0.1; faces lag twenty times as much as friction."""
    size = {"length": 10, "width": 10}
    fabric = ff.Sheet(ff.load("komeili"), name="a", **size)
    metal = ff.Sheet(metal=ff.load_metal("dc04"), **size)
    touch = ff.Interface(lag=1e-3)
    assert touch.on_tools([fabric]).coefficient == 0.25
    assert touch.on_tools([metal]).coefficient == 0.1
    assert touch.on_tools([fabric, metal]).coefficient == {"a": 0.25, "": 0.1}
    assert touch.on_tools([fabric]).lag == 1e-3 and touch.lag_of_faces == pytest.approx(0.02)
