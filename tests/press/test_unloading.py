"""Unloading: springback of metal against closed forms, of fabric to the flat sheet."""

import re

import builders
import numpy as np
import pytest
from bench.hard_sheets import on_bar
from builders import dome, everywhere, near, said

import fabric_fenicsx as ff
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.scene.rigid_motions import isostatic

LENGTH, WIDTH, CELLS = 10.0, 5.0, 10
# ideally plastic and incompressible, 1 mm thick; curvature [1/mm] at which its faces yield
IDEAL = ff.Metal(186600.0, 0.5, ff.Swift(159.0, 1.0, 0.0), thickness=1.0)
YIELDS = 2 / np.sqrt(3) * 159.0 / (186600.0 / 0.75) * 2


def over_a_bar(times, steps=8, path=lambda load: load, **options):
    """`Result` of half of a wide strip of metal that is laid on a bar of `times` that curvature;
    path: by how much of it at a load factor."""
    bar = on_bar(LENGTH, CELLS, lambda load: path(load) * times * YIELDS)
    blank = builders.sheet(LENGTH, WIDTH, CELLS, 2, "left", spatial=True)
    sides = [near(0, 0.0), near(1, 0.0), near(1, WIDTH)]
    held = [ff.Support("plane of symmetry", near(0, 0.0), (0,))]
    held += [ff.Support("wide", everywhere, (1,)), ff.Support("bar", everywhere, (0, 2), bar)]
    scene = ff.Scene(blank, [ff.SheetMetal(IDEAL, symmetric=sides)], held)
    return ff.Job(scene, steps=steps, viscosity="off").run(**options)


def curvatures(blank):
    """Of the polygon through the nodes along y = 0 [1/mm], on one rank."""
    x, u = blank.coordinates(), blank.u.x.array.reshape(-1, 3)
    line = [i for i in np.argsort(x[:, 0]) if abs(x[i, 1]) < 1e-6]
    along, _, up = np.diff((x + u)[line], axis=0).T
    return np.diff(np.arctan2(up, along)) / (LENGTH / CELLS)


@pytest.mark.parametrize(
    "times, within", [(0.9, 1e-4), (2, 1e-2), pytest.param(9, 5e-3, marks=pytest.mark.mpi)]
)
def test_a_strip_bent_over_a_bar_springs_back_by_its_moment(times, within):
    """Elastic from there: by M / D, with M = M_p (1 - (k_y / k)^2 / 3) of an ideally plastic
    plate; so what yielded nowhere is straight again."""
    formed = over_a_bar(times)
    unloaded = ff.unloading(formed, keep=["wide"]).run()
    D = 186600.0 / 0.75 / 12
    plastic = 2 / np.sqrt(3) * 159.0 / 4 * (1 - 1 / times**2 / 3)
    back = times * YIELDS if times < 1 else plastic / D
    half = LENGTH**2 / 2 * back  # of a flat arc's end
    q = unloaded.summary["quantities"]
    assert q["springback_largest_mm"] == pytest.approx(half, rel=max(within, 0.02))
    assert q["supports_bear_N"] < 1e-4
    assert unloaded.summary["energy_imbalance"] < 1e-3
    assert unloaded.summary["energy"]["plastic"] == formed.summary["energy"]["plastic"]
    if formed.scene.comm.size == 1:
        left = times * YIELDS - curvatures(formed.scene.blank)
        assert left == pytest.approx(np.full(CELLS - 1, back), rel=within)


@pytest.mark.mpi
def test_a_run_that_was_finished_before_is_unloaded_as_at_once(tmp_path):
    """Metal then still knows what it yielded; and so may the unloading be gone on from."""
    given = {"out": tmp_path, "path": lambda load: min(1.6 * load, 2 - load)}  # and back
    first = ff.unloading(over_a_bar(9, **given), keep=["wide"]).run(tmp_path / "unloaded")
    again = over_a_bar(9, **given, resume=True)
    other = ff.unloading(again, keep=["wide"]).run(tmp_path / "other")
    known = ff.unloading(again, keep=["wide"]).run(tmp_path / "unloaded", resume=True)
    names = "springback_largest_mm", "energy_left_Nmm"
    told = [[each.number(name) for name in names] for each in (first, other, known)]
    assert told[1] == pytest.approx(told[0], rel=1e-9) and told[2] == told[0]


@pytest.mark.parametrize("full", [pytest.param(False, marks=pytest.mark.mpi), True])
def test_fabric_gives_back_what_it_stored(full):
    formed = dome(nx=6, stroke=10.0, full=full).job(steps=4, balance=None).run()
    stored = sum(formed.summary["energy"][kind] for kind in ("strain", "bending"))
    job = ff.unloading(formed)
    unloaded = job.run()
    assert unloaded.rows[0]["iterations"] == 0  # in equilibrium as it was formed
    q = unloaded.summary["quantities"]
    assert q["energy_left_Nmm"] < 1e-6 * stored
    assert q["energy_released_Nmm"] == pytest.approx(stored, rel=0.01)
    (told,) = [each for each in said(unloaded.summary) if "keeps no shape" in each]
    (back,) = map(float, re.findall(r"[\d.e-]+(?= mm)", told))
    assert back == pytest.approx(q["springback_largest_mm"], rel=0.01)
    blank, u = formed.scene.blank, builders.displacement(formed.scene.blank)
    x = np.concatenate(formed.scene.comm.allgather(blank.coordinates()[: len(u)] + u))
    assert full or np.ptp(x[:, 2]) < 0.02  # a whole ply lies as its three nodes did
    normal = np.linalg.svd(x - x.mean(0), full_matrices=False)[2][2]
    assert np.ptp(x @ normal) < 0.5  # of 10
    held = {"point 1 of blank": (0, 1, 2), "point 2 of blank": (1, 2), "point 3 of blank": (2,)}
    given = {s.name: s.components for s in job.scene.supports}
    assert given.items() >= (held if full else {"point 1 of blank": (2,)}).items()


@pytest.mark.parametrize(
    "strength, low, high",
    [pytest.param(0.02, 24.43, 24.45, marks=pytest.mark.mpi), (5e-4, 0.0, 0.1)],
)
def test_fabric_whose_yarns_rub_more_than_the_law_keeps_its_height(strength, low, high):
    """Without friction it goes flat, see above; the law takes some 1e-3 MPa at these angles."""
    fabric = builders.KOMEILI.replace(shear_friction=ff.ShearFriction(0.5, strength))
    formed = dome(fabric, nx=6, stroke=25.0).job(steps=4, balance=None).run()
    unloaded = ff.unloading(formed).run()
    z = np.concatenate(formed.scene.comm.allgather(builders.displacement(formed.scene.blank)[:, 2]))
    assert low <= np.ptp(z) <= high
    assert unloaded.summary["energy_imbalance"] < 5e-3
    energy = unloaded.summary["energy"]  # what yarns rubbed away is not left in the sheet
    left = energy["strain"] + energy["bending"]
    assert unloaded.number("energy_left_Nmm") == pytest.approx(left, rel=1e-9)
    assert not [each for each in said(unloaded.summary) if "keeps no shape" in each]


def test_gravity_stays_when_the_tools_are_taken_away():
    """The fixed nodes bear the weight of the quarter: 0.75 kg/m2."""
    changes = ["blank.nx=4", "gravity=9.81", "stage.1.moves.punch=6", "stage.1.steps=2"]
    formed = ff.Press.read("hemisphere", changes).job(balance=None).run()
    weight = 9.81 * 0.75e-6 * 200 * 200 / 4
    assert formed.scene.terms[-1].applied_forces()[2::3].sum() == pytest.approx(-weight)
    assert formed.summary["quantities"]["unbalanced_force_N"] < 1e-3 * weight
    unloaded = ff.unloading(formed).run()
    assert unloaded.number("supports_bear_N") == pytest.approx(weight, rel=1e-3)


@pytest.mark.mpi
def test_sheets_of_a_stack_spring_back_on_each_other_or_alone():
    plies = [{"metal": ff.load_metal("dc04"), "name": "metal"}, {"name": "fabric"}]
    gentle = ["tools.punch.entry_radius=45", "tools.punch.wall_angle=20"]
    forming = dome(plies=plies, nx=4, stroke=4.0, changes=gentle)
    formed = forming.job(steps=2, balance=None).run()
    late = ff.unloading(formed)
    for together in (False, True):
        unloaded = ff.unloading(formed, together=together).run()
        q, energy = unloaded.summary["quantities"], unloaded.summary["energy"]
        sheets = [each["springback_largest_mm"] for each in q["sheets"].values()]
        told = [each for each in said(unloaded.summary) if "keeps no shape" in each]
        assert len(told) == 1 and told[0].startswith("fabric springs back by up to ")
        assert len(sheets) == 2 and max(sheets) == q["springback_largest_mm"]
        assert all(1.0 < each < 2.0 for each in sheets)  # of 4 mm
        assert energy["metal"] < 1e-6 * formed.summary["energy"]["metal"]  # nothing yielded
        assert q["supports_bear_N"] < 0.1 and unloaded.summary["energy_imbalance"] < 5e-3
        assert ("contact of metal and fabric" in unloaded.summary["terms"]) == together
    with pytest.raises(InputError, match="the sheets moved after"):
        late.run()


def test_what_cannot_be_unloaded():
    formed = over_a_bar(0.5)
    with pytest.raises(InputError, match="`keep` contains 'grip'; expected supports of the scene"):
        ff.unloading(formed, keep=["grip"])
    formed.summary["stroke_reached"] = 0.4
    with pytest.raises(InputError, match="a run that reached full load, not 0.4"):
        ff.unloading(formed)


@pytest.mark.parametrize("angle", [2.0, np.pi, 4 * np.pi])
def test_nodes_that_hold_a_rolled_up_strip_hold_it_rolled_and_flat(angle):
    """With a stiffness of 0 in one of both shapes they would let it turn there."""
    strip, k = builders.sheet(40.0, 10.0, 10, 2, "left", spatial=True), angle / 40
    X = strip.coordinates()
    rolled = np.array([np.sin(k * X[:, 0]) / k, X[:, 1], (1 - np.cos(k * X[:, 0])) / k]).T
    strip.u.x.array[:] = (rolled - X).ravel()
    held = isostatic(strip, [])
    ends = [(np.flatnonzero(s.where(X.T))[0], axis) for s in held for axis in s.components]
    for shape in (rolled, X):
        arms = (shape - shape.mean(0)) / 40
        rows = [[*np.eye(3)[axis], *np.cross(arms[k], np.eye(3)[axis])] for k, axis in ends]
        assert len(rows) == 6
        assert np.linalg.svd(rows)[1].min() > 0.01
