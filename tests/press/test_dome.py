"""The press of the double dome: own punches, a quarter, a whole ply, a stack."""

from xml.etree import ElementTree

import numpy as np
import pytest
import pyvista
from builders import COMM, KOMEILI, dome, dome_press
from dome_triangles import double_dome
from mpi4py import MPI

import fabric_fenicsx as ff


def test_tools_close_to_the_clearance_that_is_asked():
    """Also after another stage; where the punch goes further, they are refused."""
    thickness = KOMEILI.thickness_under(0.0)
    first = ff.Stage("first", moves={"punch": 20}, steps=1)
    for clearance, stages in ((1.2 * thickness, []), (1.5, [first])):
        press = dome_press(nx=4, changes=[f"tools.die.clearance={clearance}"])
        stages = [*stages, ff.Stage("rest", close=clearance / thickness, steps=1)]
        made = press.replace(stages=stages).build()
        heights = [made.tools["punch"].path(load)[2] for load in np.linspace(0, 1, len(stages) + 1)]
        assert np.diff(heights) == pytest.approx([20, 40] if len(stages) > 1 else [60], abs=1e-6)
        assert made.schedule.distance("punch", 1.0) == pytest.approx(clearance)
    words = "tools punch and die overlap by .* at the end of forming"
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
    assert any("they crush the blank there" in words for words in made.warnings) == crushed


def test_a_punch_with_a_crack_beneath_the_ply_or_in_inches_is_refused():
    points, triangles = double_dome(size=20, turn=15)
    whole = (abs(points[triangles].mean(1)[:, :2]) > 30).any(1)
    with pytest.raises(ff.InputError, match="tools.punch is open at .* under the blank; expected"):
        dome(surface=ff.TriangulatedSurface(points, triangles[whole]), nx=4)
    with pytest.raises(ff.InputError, match="tools.punch is open at .* expected a surface in mm"):
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
    assert any("are not symmetric" in text for text in made.warnings) == said


PLIES = "inner", "outer"


class Stopped(Exception):
    """What ends a job in the middle."""


def job(comm, stop=2.0):
    """Of a short stroke; one that ends itself once the load factor is `stop`."""
    glass = ff.load("komeili").replace(fibre_density=2.54)
    plies = [{"name": "inner"}, {"name": "outer", "fibre_angle": 45, "nx": 5, "fabric": glass}]
    made = dome(plies=plies, nx=4, stroke=2.0, comm=comm)
    measure = made.measure

    def stops(scene, load):
        if load >= stop:
            raise Stopped
        return measure(scene, load)

    made.measure = stops
    return made.job(steps=3, every=1)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The whole job on one rank, by each."""
    folder = tmp_path_factory.mktemp("plies") / f"of_rank_{COMM.rank}"
    return job(MPI.COMM_SELF).run(folder, pictures=False)


def agree(result, alone):
    """Forces and energies to 1e-6 of their largest."""
    assert [row["load"] for row in result.rows] == [row["load"] for row in alone.rows]
    force, expected = ([row["reaction_N"] for row in r.rows] for r in (result, alone))
    assert force == pytest.approx(expected, abs=1e-6 * max(expected))
    total = sum(alone.summary["energy"].values())
    assert result.summary["energy"] == pytest.approx(alone.summary["energy"], abs=1e-6 * total)
    (pair,), (same,) = (r.summary["sheet_contacts"].values() for r in (result, alone))
    for name in ("force_N", "normal_force_N", "penetration_of_thickness"):
        assert pair[name] == pytest.approx(same[name], rel=1e-6)
    here, there = (r.summary["quantities"] for r in (result, alone))
    for name in ("shear_angle_max_deg", "shear_angle_99_percent_deg", "shortening_max"):
        assert here[name] == pytest.approx(there[name], rel=1e-6)
    for name in ("shear_angle_max_at_mm", "shear_angle_max_in", "shortening_max_at_mm"):
        assert here[name] == there[name]


@pytest.mark.versions
@pytest.mark.mpi
def test_resumed_on_other_ranks(shared_path, alone):
    """Begun on one rank, and ended on all."""
    folder = shared_path / "out"
    if COMM.rank == 0:
        with pytest.raises(Stopped):
            job(MPI.COMM_SELF, stop=0.5).run(folder, pictures=False)
    COMM.barrier()
    rest = job(COMM).run(folder, resume=True, pictures=False)
    assert rest.summary["converged"]
    agree(rest, alone)


def test_summary_tells_how_thick_plies_are(alone):
    """They lie on the die, a little compacted; fibres are known of one of them."""
    quantities, cells = alone.summary["quantities"], alone.fields["thickness_under_pressure"]
    free, plies = ff.load("komeili").thickness_under(0.0), quantities["plies"].values()
    mine = [cells[alone.scene.blank.part(name).cells] for name in quantities["plies"]]
    assert all(0.5 < each.min() < each.max() <= free for each in mine)
    least = [ply["thickness_min_mm"] for ply in plies]
    assert least == [each.min() for each in mine]
    assert quantities["thickness_min_mm"] == min(least)
    shares = [ply["fibre_volume_fraction_max"] for ply in plies]
    assert shares[0] is None and 0.75 / 2.54 / free < shares[1] < 0.6
    assert quantities["fibre_volume_fraction_max"] == shares[1]


def test_quantities_of_the_stack_are_of_all_cells_of_its_plies(alone):
    """The outer ply has the larger cells: shares are of areas."""
    q, fields, blank = alone.summary["quantities"], alone.fields, alone.scene.blank
    assert list(alone.summary["sheet_contacts"]) == ["inner, outer"]
    plies = [q["plies"][name] for name in PLIES]
    for name in ("shear_angle_deg", "log_eps_11", "log_eps_22"):
        lows, highs = zip(*(ply[name] for ply in plies))
        assert list(q[name]) == [min(lows), max(highs)]
    most = max(plies, key=lambda ply: ply["shear_angle_max_deg"])
    for name in ("shear_angle_max_deg", "shear_angle_max_at_mm"):
        assert q[name] == most[name]
    assert q["shear_angle_max_in"] == PLIES[plies.index(most)]
    below = [ply["shear_angle_99_percent_deg"] for ply in plies]
    assert min(below) <= q["shear_angle_99_percent_deg"] <= max(below)
    lost, areas = "cells_that_lost_ellipticity", blank.areas()
    assert q[lost] == sum(ply[lost] for ply in plies)
    mean = areas @ np.maximum(fields["shortening_a"], fields["shortening_b"]) / areas.sum()
    assert q["shortening_mean"] == pytest.approx(mean) and mean > 0
    assert q["sheet_pressure_largest_MPa"] == pytest.approx(np.nanmax(fields["sheet_pressure"]))
    for number, share in enumerate(q["share_of_state_1_to_4"], 1):
        expected = areas[fields["strain_state"] == number].sum() / areas.sum()
        assert share == pytest.approx(expected)


@pytest.mark.filterwarnings("error")
def test_fields_have_a_block_for_each_ply(alone):
    """Named, with the cells and the number of the ply alone, and fields that are known there."""
    path = alone.folder
    sets = [each.attrib for each in ElementTree.parse(path / "fields.pvd").iter("DataSet")]
    last = [each for each in sets if each["timestep"] == sets[-1]["timestep"]]
    assert [each["name"] for each in last] == list(PLIES)
    for k, each in enumerate(last):
        grid = pyvista.read(path / each["file"])
        assert (np.asarray(grid.cell_data["part"]) == k).all()
        assert grid.n_cells == alone.scene.blank.part(PLIES[k]).cells.size
        assert ("sliding_mm" in grid.cell_data) == (PLIES[k] == "outer")
