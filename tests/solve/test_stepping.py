"""Steps whose work is missing from the energies."""

import builders
import pytest
import ufl
from builders import march

import fabric_fenicsx as ff
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.progress import Viscosity
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.stepping import LoadStepping, TrialStep


def scene_of(*terms):
    """A strip of a membrane and these."""
    blank = ff.Blank.rectangle(20, 10, nx=2)
    return ff.Scene(blank, [builders.Elastic(), *terms], ff.clamped_ends(0.2))


class Losing(ff.Term):
    """Says that it did work, as much as `share` of the load factor's rise, which nothing stores."""

    name = "losing"

    def __init__(self, share):
        self.share, self._load, self._from = share, 0.0, 0.0

    def set_load(self, load):
        self._load = load

    def accept(self):
        self._from = self._load

    def add_forces(self, f):
        pass

    def work(self):
        return self.share * (self._load - self._from) * (self.blank.mesh.comm.rank == 0)


class Snapping(Losing):
    """Says that it did all this work at load 0.6."""

    def work(self):
        passed = self._from < 0.6 <= self._load
        return self.share * passed * (self.blank.mesh.comm.rank == 0)


def stretched(share, balance, term=Losing):
    """Loads of the accepted states and reasons of the rejected ones, of a strip."""
    states, reasons = [], []
    told = {"on_accept": states.append, "on_reject": lambda _, r: reasons.append(r.reason)}
    march(Newton(scene_of(term(share))), steps=4, balance=balance, **told)
    return [accepted.load for accepted in states], reasons


@pytest.mark.mpi
def test_steps_that_lose_work_are_halved_but_not_for_ever():
    loads, reasons = stretched(0.5, 0.02)
    steps = [b - a for a, b in zip(loads, loads[1:])]
    assert loads[-1] == 1
    assert reasons and all("of the step's work is missing from the energies" in r for r in reasons)
    # the first step must meet it, too, and the finest ones need not
    assert steps[0] < 0.25 and 0.75 <= min(steps[:-1]) * 8 / 0.25 <= 1.5


def test_a_snap_is_passed_in_the_smallest_step_that_is_checked():
    """An eighth of the largest, as its loss is that of any step; from there on they grow."""
    loads, reasons = stretched(0.2, 0.02, Snapping)
    steps = {a < 0.6 <= b: b - a for a, b in zip(loads, loads[1:])}
    assert loads[-1] == 1 and 1 <= len(reasons) <= 3 and steps[True] <= 1.5 * 0.25 / 8


@pytest.mark.parametrize("share, balance", [(0.0, 0.02), (100.0, None)])
def test_steps_stay_where_work_is_stored_or_nobody_asks(share, balance):
    assert stretched(share, balance) == ([0, 0.25, 0.5, 0.75, 1], [])


def test_milestones_are_hit_and_no_sliver_is_left_before_them():
    found, wound = [], builders.Springs(0.0)
    wound.stored = lambda: 3.0  # from the start on, which counts as work
    march(Newton(scene_of(wound)), 4, milestones=(0.3, 0.5501), on_accept=found.append)
    loads = [accepted.load for accepted in found]
    assert loads == pytest.approx([0, 0.25, 0.3, 0.5501, 0.8001, 1], abs=1e-9)
    assert found[0].external_work == 3.0
    stored = sum(found[-1].energies.values())
    assert found[-1].external_work == pytest.approx(stored, rel=1e-3) and stored > 4


@pytest.mark.parametrize(
    "deviation, step", [(0.02, 0.1 / 2**0.5), (0.01, 0.1), (0.001, 0.15), (1.0, 0.05)]
)
def test_a_step_is_as_long_as_its_accuracy_asks(deviation, step):
    """What it is off by goes with its square; it is halved or grows by half at most."""
    stepping = LoadStepping(Newton(scene_of()), Settings(steps=4, accuracy=0.01))
    trial = TrialStep(0.5, 0.1, 0.0, None, deviation=deviation)
    assert stepping._next_step_size(trial) == pytest.approx(step)


def test_drag_grows_tenfold_and_fades_by_a_quarter():
    """From 1e-7 to 1e-1 of the stiffness; each failure doubles the easy steps that are asked."""
    drag = Viscosity(stiffness=2.0)
    stages = [drag.drag for _ in range(9) if drag.strengthen()]
    assert stages == pytest.approx([2.0 * 10.0**k for k in range(-7, 0)])
    assert drag.easy_steps_asked == 16
    drag.easy_steps_asked = 2
    for uncut, at_rest, weaker in ((1, 0, 1), (0, 0, 1), (1, 0, 1), (1, 0, 4), (0, 1, 16)):
        drag.note_accepted(uncut=bool(uncut), at_rest=bool(at_rest))
        assert drag.drag == pytest.approx(0.2 / weaker)
    drag.drag = 2e-7
    drag.note_accepted(uncut=True, at_rest=True)
    assert drag.drag == 0.0


class Hardening(ff.Term):
    """Stores 250 |u|^4 a mm^2: its forces grow with the third power of the load."""

    name, energy_kind, resists = "hardening", "strain", ("stretch", "move", "turn")

    def set_up(self, scene):
        u = scene.blank.displacement
        self.energy = 250.0 * ufl.dot(u, u) ** 2 * self.part.dx(4)


def test_the_first_step_is_believed_where_forces_grow_as_a_power():
    """A trapezoid would take twice the energy for its work."""
    everywhere = ff.Support("all", lambda x: x[0] < 1e9, (0, 1), (0.1, 0.0))
    scene, found = ff.Scene(ff.Blank.rectangle(20, 10, nx=2), [Hardening()], [everywhere]), []
    march(Newton(scene), steps=2, balance=0.02, on_accept=found.append)
    assert (found[1].load, found[1].cuts) == (0.5, 0)
    assert found[1].external_work == pytest.approx(250.0 * 0.05**4 * 200)


@pytest.mark.mpi
def test_only_states_on_the_way_are_looser(monkeypatch):
    """Not that at rest before load, here under a pull that is there from the start."""
    asked, solve = [], Newton.solve

    def noted(self, x, tolerance=0.0, *given, **more):
        asked.append(tolerance)
        return solve(self, x, tolerance, *given, **more)

    monkeypatch.setattr(Newton, "solve", noted)
    pull = ff.EdgeTension(5.0, (0.0, 1.0), builders.near(1, 10.0))
    march(Newton(scene_of(pull), 1e-8), steps=3, path_tolerance=1e-4)
    assert asked == [1e-8, 1e-4, 1e-4, 1e-8]


def test_steps_grow_once_one_passed_uncut_however_many_iterations_it_took(monkeypatch):
    solve, failures = Newton.solve, iter([True])

    def counted(self, *args, **options):
        report = solve(self, *args, **options)
        report.converged = report.converged and not next(failures, False)
        report.iterations = 99
        return report

    monkeypatch.setattr(Newton, "solve", counted)
    states = []
    march(Newton(scene_of()), steps=4, on_accept=states.append)
    # the first is halved, so the second stays as it is
    loads = [accepted.load for accepted in states]
    assert loads == pytest.approx([0, 0.125, 0.25, 0.4375, 0.6875, 0.9375, 1])
