"""The press of the double dome: own punches, a quarter and a whole ply."""

import dataclasses

import numpy as np
import pytest
from builders import COMM, KOMEILI, dome, dome_press
from dome_triangles import double_dome
from mpi4py import MPI

import fabric_fenicsx as ff


def test_tools_close_to_the_clearance_that_is_asked():
    """Where the punch goes further, they are refused."""
    thickness = KOMEILI.thickness_under(0.0)
    for clearance in (1.2 * thickness, 1.5):
        to_it = f"tools.die.clearance={clearance}", f"stage.1.close={clearance / thickness}"
        made = dome(nx=4, changes=to_it)
        way = made.tools["punch"].path(1.0) - made.tools["punch"].path(0.0)
        assert way[2] == pytest.approx(60.0, abs=1e-6)
        assert made.schedule.distance("punch", 1.0) == pytest.approx(clearance)
    words = "tools punch and die go .* through one another at the end of forming"
    with pytest.raises(ff.InputError, match=words):
        dome(nx=4, stroke=62.0)


def test_tools_with_a_die_begin_where_they_touch_the_blank_at_once():
    """A dome 60 mm high, a fifth of the thickness beneath it, its die with the flange on it; 60 mm
    and the clearance of 1.2 thicknesses apart."""
    made, t = dome(nx=4), KOMEILI.thickness_under(0.0)
    places = [made.tools[name].path(0.0)[2] for name in ("punch", "die")]
    assert places == pytest.approx([-60 - 0.7 * t, -0.7 * t], abs=1e-6)
    assert made.schedule.distance("punch", 0.0) == pytest.approx(60 + 1.2 * t, abs=1e-6)
    (bending,) = (term for term in made.scene.terms if isinstance(term, ff.Bending))
    # E t^3 / 12 and G t^3 / 3 of 100 and 1 MPa
    assert bending.stiffnesses == pytest.approx([100 / 12, 100 / 12, 1 / 3])


@pytest.mark.parametrize("apart, crushed", [(0.71, False), (0.69, True)])
def test_tools_that_close_to_less_than_the_pressed_thickness_are_told_of(apart, crushed):
    """Of 0.697 mm under 1 MPa, between the flats."""
    t = KOMEILI.thickness_under(0.0)
    made = dome(nx=4, changes=[f"stage.1.close={apart / t}"])
    assert any("they crush it there" in words for words in made.warnings) == crushed


def test_a_stage_may_close_a_die_that_comes_later():
    """After another stage has moved the punch by part of the way."""
    press = dome_press(nx=4)
    stages = [ff.Stage("first", moves={"punch": 20}, steps=1), ff.Stage("rest", close=1.2, steps=1)]
    two = press.replace(stages=stages).build()
    heights = [two.tools["punch"].path(load)[2] for load in (0, 0.5, 1)]
    assert np.diff(heights) == pytest.approx([20, 40])


def test_a_punch_with_a_crack_beneath_the_ply_or_in_inches_is_refused():
    points, triangles = double_dome(size=20, turn=15)
    whole = (abs(points[triangles].mean(1)[:, :2]) > 30).any(1)
    with pytest.raises(ff.InputError, match="tools.punch is open at .* beneath the blank; allowed"):
        dome(surface=ff.TriangulatedSurface(points, triangles[whole]), nx=4)
    with pytest.raises(ff.InputError, match="tools.punch is open at .* is a surface in mm"):
        dome(surface=ff.TriangulatedSurface(points / 25.4, triangles), nx=4)


@pytest.mark.mpi
@pytest.mark.parametrize("cells", [{"nx": 12}, {"nx": 11}, {"nx": 6, "pattern": "unstructured"}])
def test_a_whole_ply_is_fixed_in_the_nodes_nearest_to_centre_and_end(cells):
    """One of each, also where several are as near."""
    made = dome(full=True, **cells)
    x = made.scene.blank.coordinates()[: made.scene.blank.V.dofmap.index_map.size_local]
    for support, place in zip(made.scene.supports, ((0, 0), (235, 0))):
        fixed = np.vstack(COMM.allgather(x[support.where(x.T)]))
        least = COMM.allreduce(np.hypot(*(x[:, :2] - place).T).min(initial=np.inf), MPI.MIN)
        assert len(fixed) == 1
        assert np.hypot(*(fixed[0, :2] - place)) == pytest.approx(least, abs=1e-5)


@pytest.mark.parametrize(
    "angle, said", [(30, True), (45 + 1e-10, False), (-45, False), (1e-10, False)]
)
def test_a_quarter_whose_yarns_no_plane_mirrors_is_warned_of(angle, said):
    made = dome(nx=4, fibre_angle=angle)
    assert any("mirror images" in text for text in made.warnings) == said


def test_quadratic_cells_of_a_ply_are_twice_as_large_by_default():
    """So nodes are as many; who gives a number of rectangles gets it."""
    made = []
    for given in ({}, {"nx": 8}, {"element": "P2"}):
        press = dome_press(fibre_angle=30, **given)
        sheet = press.sheets[0] if "nx" in given else dataclasses.replace(press.sheets[0], nx=None)
        made.append(press.replace(sheets=sheet).build().sheets[0])
    assert [(sheet.nx, sheet.element) for sheet in made] == [(12, "P2"), (8, "P2"), (24, "P2")]
