"""A scene described in another way gives the same numbers."""

import shutil

import numpy as np
import pytest
import scenes
from changes import CHANGES, COUPON_CHANGES, allowed, changed, coupon_changed, reason_against, runs
from mpi4py import MPI
from outcome import differences, outcome
from scenes import COUPONS, PRESSES

import fabric_fenicsx as ff


def test_three_changes_a_scene_and_three_scenes_a_change(tmp_path):
    """Of the scenes that allow a change, if these are fewer."""
    presses = {scene: make(tmp_path) for scene, make in PRESSES.items()}
    made = {scene: {*sum(runs(scene, press), ())} for scene, press in presses.items()}
    assert min(len(names) for names in made.values()) > 4  # and data, twice
    for name in CHANGES:
        can = sum(not reason_against(name, *each) for each in presses.items())
        assert sum(name in names for names in made.values()) >= min(3, can) > 0, name


@pytest.mark.parametrize("scene", PRESSES)
def test_a_press_in_other_words(scene, tmp_path):
    press = PRESSES[scene](tmp_path)
    first, told = formed(press), []
    for made in runs(scene, press):
        if words := off(scene, press, first, made, tmp_path):
            alone = {name: off(scene, press, first, [name], tmp_path) for name in made if made[1:]}
            told += [f"{' and '.join(made)}: {words}", *(f"  {n}: {w}" for n, w in alone.items())]
    assert not told, "\n".join(told)


def off(scene, press, first, names, folder):
    """Numbers that differ after these changes."""
    other = changed(press, names, folder)
    if all(CHANGES[name].same for name in names):
        return [] if other.replace(title=press.title) == press else ["its data"]
    within, besides = allowed(names, scene)
    return differences(first, formed(other), within, besides)


def formed(press):
    return outcome(press.job(balance=None).run(), 1 / press.share)


def test_steps_count_for_nothing_where_no_energy_is_lost():
    how = {"balance": None, "path_tolerance": 1e-8}
    few, many = (outcome(slippery(steps).job(**how).run()) for steps in (1, 3))
    last = {"force": few.pop("1.force") / many.pop("3.force")}
    assert last["force"] == pytest.approx(1, rel=1e-6)
    curve = [name for name in {*few, *many} if name.endswith(".force")]
    work = "energy.external_work", "energy.viscous"  # integrated over the steps
    ends = ({k: v for k, v in each.items() if k not in curve} for each in (few, many))
    assert not differences(*ends, 1e-5, work)


def slippery(steps):
    stage = ff.Stage("forming", moves={"ball": 3.0}, steps=steps)
    return scenes.press(interface=ff.Interface(friction=0.0, lag=1e-9), stages=stage)


def test_a_patch_off_the_flange_changes_as_little_as_it_is_thick():
    """It is a sheet of its own, a hundredth as thick as the ply; the holder acts as without it."""
    ply, thin = scenes.sheet(name="ply", nx=4), scenes.TWILL.replace(thickness=0.01)
    patch = ff.Sheet(fabric=thin, length=20.0, width=20.0, nx=2, bending_modulus=0.0)
    sheets = [ply], [ply, patch], [patch, ply]
    short = ff.Stage("forming", moves={"ball": 2.0}, steps=1)
    made = [scenes.press(*each, stages=short).job(balance=None).run() for each in sheets]
    for name in ("reaction_N", "holder_force_of_whole_N"):
        alone, *patched = (result.rows[-1][name] for result in made)
        assert patched == pytest.approx([alone, alone], rel=0.02)


PRESS_FILE = """
unit = "mm"
title = "A press"
blank = { fabric = "komeili", length = 100, width = 80, nx = 6 }
contact = { friction = 0.2 }
tools.ball = { shape = "sphere", radius = 24 }
tools.ring = { shape = "plate", length = 56, entry = 5, side = "above" }
holders.holder = { pressure = 0.02 }
stage = [{ name = "forming", moves = { ball = 4.0 }, steps = 2 }]
"""


def test_a_file_says_what_a_program_says(tmp_path):
    (tmp_path / "press.toml").write_text(PRESS_FILE)
    written = ff.Press.read(tmp_path / "press.toml")
    program = scenes.press(scenes.sheet(ff.load("komeili")), title="A press")
    assert written == program
    assert not differences(*(formed(each) for each in (written, program)), 1e-12)


@pytest.mark.parametrize("scene", COUPONS)
def test_a_coupon_in_other_words(scene, tmp_path):
    coupon = COUPONS[scene](tmp_path)
    first, told = pulled(coupon), []
    for names in COUPON_CHANGES:
        other = pulled(coupon_changed(coupon, names, tmp_path))
        found = differences(first, other, *allowed(names, scene))
        told += [f"{' and '.join(names)}: {found}"] if found else []
    assert not told, "\n".join(told)


def pulled(coupon):
    return outcome(coupon.job(steps=3, balance=None).run())


STOPPED = ["gap", "by_force", "springs", "own_term", "stl", "back", "two_stages", "inner"]
STOPPED += ["slippery", "two_plies", "ply_and_metal", "self", "yarn_friction", "fields"]


@pytest.mark.parametrize("scene", STOPPED)
def test_a_run_that_was_killed_goes_on(scene, tmp_path):
    """From what its folder held as the third row came; and with a stage that was added, as near as
    solves go whose accuracy depends on a step's share of the whole run."""
    press, rows = PRESSES[scene](tmp_path), []

    def run(press, folder, resume=False, balance: float | None = 0.02, seen=lambda: None):
        """As a command runs it: stages may be added."""
        built = press.build()
        columns = built.columns
        built.columns = lambda scene: seen() or columns(scene)
        job = built.job(balance=balance, limits=ff.Limits(imbalance=0.5))
        how = {"resume": resume, "pictures": False, "problem": built.fingerprint()}
        return outcome(job.run(tmp_path / folder, **how))

    def kept():
        rows.append(1)
        if len(rows) == 3:
            shutil.copytree(tmp_path / "whole", tmp_path / "killed")

    first = run(press, "whole", seen=kept)
    assert not differences(first, run(press, "killed", resume=True), 1e-9)
    if len(press.stages) > 1:
        run(press.replace(stages=press.stages[:1]), "added", balance=None)
        added = run(press, "added", resume=True, balance=None)
        once = run(press, "once", balance=None)
        assert not differences(once, added, 1e-3, ["energy.external_work"])


@pytest.mark.parametrize("scene", ["ply_and_metal", "yarn_friction"])
def test_a_second_unloading_ends_where_the_first_did(scene, tmp_path):
    result = PRESSES[scene](tmp_path).job(balance=None).run()
    how = {"steps": 2, "balance": None, "limits": ff.Limits(imbalance=9)}
    first, second = (outcome(ff.unloading(result, **how).run()) for _ in range(2))
    assert first["springback_largest_mm"] > 1e-3 and not differences(first, second, 1e-9)


@pytest.mark.parametrize("scene", [*STOPPED, "whole", "segments", "die_of", "edge_springs"])
def test_what_is_found_once_is_found_anew(scene, tmp_path):
    """Forces and energies of a state are those of a scene that was asked of no other before:
    whatever is kept was found for the same displacements, tools and loads."""
    press = PRESSES[scene](tmp_path)
    asked, fresh = (press.build().scene for _ in range(2))
    states = [(state(asked, seed), load) for seed, load in ((1, 0.3), (2, 0.3), (2, 1.0), (1, 0.7))]
    *_, before, found = (forces(asked, x, load) for x, load in states)
    alone = forces(fresh, *states[-1])
    assert abs(found - alone).max() < 1e-12 * abs(alone).max() < 1e-9 * abs(before - alone).max()


def state(scene, seed):
    """A displacement that presses the sheet against its tools, and bends it."""
    x, rng = scene.u.duplicate(), np.random.default_rng(seed)
    x.array[:] = rng.uniform(-0.3, 0.3, x.local_size)
    return x


def forces(scene, x, load):
    """Energy and internal forces [N mm, N]."""
    scene.set_load(load)
    scene.set(x)
    r = scene.u.duplicate()
    scene.residual(r)
    return np.append(scene.forces.array, scene.energy())


ON_RANKS = "whole", "quarter", "stl", "two_plies", "ply_and_metal", "inner", "springs", "fields"


@pytest.mark.parametrize("scene", [pytest.param(n, marks=pytest.mark.mpi) for n in ON_RANKS])
def test_ranks_change_no_number(scene, tmp_path):
    """Work is measured within steps, where areas lag: five runs on two ranks differ by 3e-8."""
    comm, work = MPI.COMM_WORLD, "energy.external_work"
    press = PRESSES[scene](comm.bcast(tmp_path))
    how, ranks = {"balance": None, "path_tolerance": 1e-8}, (MPI.COMM_SELF, comm)
    alone, together = (outcome(press.build(each).job(**how).run()) for each in ranks)
    within = 1e-8 if len(press.sheets) == 1 else 1e-6  # faces of sheets lag
    assert comm.rank or not differences(alone, together, within, [work])
    assert together[work] == pytest.approx(alone[work], rel=1e-6)
