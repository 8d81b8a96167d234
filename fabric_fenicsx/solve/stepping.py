"""Load stepping: from the unloaded scene to the full load, in steps as large as they converge."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..runtime.formatting import rounded
from .newton import Newton
from .progress import Accepted, Outcome, Progress
from .report import Report
from .settings import Settings
from .staggered import solve_lagged
from .step_criteria import EnergyBalance, StraightPath
from .viscosity import Viscosity

GROWTH, CUT = 1.5, 0.5
SMALLEST = 1e-5  # load step that is still halved
HARD = 1 / 16  # of the largest step, from where on cutting alone does not help
ON_THE_WAY = 1 / 2, 1 / 4  # shares of the first step, where its work is looked at if in doubt
STEPS_AT_REST = 40  # at full load, at most, for the sheet to creep to where it needs no drag


@dataclass
class Attempt:
    """A step to a load factor: how much of it is `taken`, to which `tolerance` the state is sought
    (0: the solver's), and the supports' values there. Then its report, how far the state is off the
    straight continuation of the path; energies by kind, what drag took, work [N mm], forces of the
    supports [N]."""

    load: float
    taken: float
    tolerance: float
    values: np.ndarray
    report: Report = field(default_factory=Report)
    deviation: float = 0.0
    energies: dict[str, float] = field(default_factory=dict)
    drained: float = 0.0
    work: float = 0.0
    forces: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def energy(self) -> float:
        """Sum of all kinds [N mm]."""
        return sum(self.energies.values())


class LoadStepping:
    """Brings the supports of `newton.scene` to load factor 1, from 0 or from the `Progress`
    `start`: next load, attempt, judges, accept or back off.

    A scene that is not in equilibrium at load 0, as under a blank holder's dead pressure, is first
    brought to it there. What it stores at load 0 counts as work done. Work of supports and tools is
    summed by parabolas, see `Work`.

    on_accept(Accepted) is called at load 0 and at each accepted state, with the scene in that
    state, on_reject(load, Report) after each failed attempt. stop() is asked after each attempt, on
    all ranks; a text that it returns ends the run, with that reason.
    """

    def __init__(
        self,
        newton: Newton,
        settings: Settings | None = None,
        start: Progress | None = None,
        on_accept: Callable[[Accepted], Any] = lambda accepted: None,
        on_reject: Callable[[float, Report], Any] = lambda load, report: None,
        stop: Callable[[], str] = lambda: "",
    ) -> None:
        self.newton, self.scene, self.settings = newton, newton.scene, settings or Settings()
        self.on_accept, self.on_reject, self.stop = on_accept, on_reject, stop
        self.largest = self.settings.largest_step
        self.path = StraightPath(self.settings.accuracy)
        self.balance = EnergyBalance(self.settings.balance, self.largest)
        self._is_new, x = start is None, newton.x
        self.progress = start or Progress(
            0.0,
            min(1.0 / self.settings.steps, self.largest),
            None,
            0.0,
            Viscosity(),
            self.scene.u.copy(),
            x.duplicate(),
        )
        self.progress.step = min(self.progress.step, self.largest)
        self._residual, self._predicted = x.duplicate(), x.duplicate()
        self._in_equilibrium = not self._is_new  # or it is to be found at load 0
        self._cuts, self._steps_at_rest, self._clock = 0, 0, time.perf_counter()

    def run(self) -> Outcome:
        """Step to full load; raises InputError for a scene that cannot begin."""
        self._begin()
        self.scene.was_loaded = True
        reason = ""
        while not reason and not self._is_finished():
            reason = self.stop() or self._step()
        self.scene.drag = 0.0
        if not self._in_equilibrium:  # whoever listens hears of one state at least
            self._tell(Report(reason=reason), self._energies())
        progress = self.progress
        return Outcome(
            progress.load, reason, progress.accepted, progress.rejected, progress.iterations
        )

    def _begin(self):
        """Put the scene where progress stands."""
        scene, progress, newton = self.scene, self.progress, self.newton
        check = scene.check_start if self._is_new else scene.check_held
        check()
        scene.set(progress.x)
        scene.set_load(progress.load)
        if progress.memory:
            scene.recall(progress.memory)
        if progress.solver:
            newton.recall(progress.solver)
        scene.accept()
        self._restore()
        if not progress.memory:
            scene.supports.work.accept(
                progress.load, scene.held_forces(), progress.x.array[scene.held]
            )
        if not self._is_new:
            scene.let_go()
        else:
            progress.stored = sum(self._energies().values())
            self._in_equilibrium = newton.is_at_rest(progress.x)
            if self._in_equilibrium:
                progress.work = progress.stored
                self._tell(Report(converged=True), self._energies())

    def _is_finished(self):
        progress = self.progress
        return progress.load >= 1 and not progress.viscosity.drag and self._in_equilibrium

    def _step(self):
        """One attempt, which is accepted, or after which the next is smaller or damped; why to give
        up, or ""."""
        attempt = self._next_load()
        self._solve(attempt)
        self._judge(attempt)
        if attempt.report.converged:
            return self._accept(attempt)
        return self._back_off(attempt)

    def _next_load(self):
        """What is to be attempted next."""
        progress, steps = self.progress, self.settings.steps
        load = progress.load + progress.step if self._in_equilibrium else progress.load
        if abs(load * steps - round(load * steps)) < 1e-9:  # so that tenths are tenths
            load = round(load * steps) / steps
        goal = min((m for m in self.settings.milestones if m > progress.load), default=1.0)
        # nor is a sliver left before it
        if self._in_equilibrium and load > goal - 1e-3 * progress.step:
            load = goal
        is_on_the_way = self._in_equilibrium and load != goal
        tolerance = (self.settings.path_tolerance or 0.0) if is_on_the_way else 0.0
        return Attempt(load, load - progress.load, tolerance, self.scene.supports.values(load))

    def _solve(self, attempt, start=None):
        """Find the attempt's state, from a prediction or the vector `start`."""
        scene, progress, x = self.scene, self.progress, self.newton.x
        scene.set_load(attempt.load)
        if start:
            start.copy(x)
        else:
            self._predict(attempt)
        x.copy(self._predicted)
        if scene.keeps_gaps and not start:
            self._keep_contact(x)
        scene.drag, scene.origin = progress.viscosity.drag, progress.x
        attempt.report, iterations = solve_lagged(self.newton, x, attempt.tolerance)
        progress.iterations += iterations
        if self.path.accuracy and progress.last_step:
            self._predicted.axpy(-1.0, x)
            attempt.deviation = self._predicted.norm() / max(x.norm(), 1e-300)

    def _judge(self, attempt):
        """Have the judges object to the attempt's state, if there is one."""
        if attempt.report.converged:
            attempt.report.object(self.path.objection(attempt.deviation))
        if not attempt.report.converged:
            return
        self._measure(attempt)
        if not self._in_equilibrium:
            return
        objection = self._imbalance(attempt)
        for share in () if self.progress.last_step else ON_THE_WAY:
            if objection and self._look_back(attempt, share):
                objection = self._imbalance(attempt)
        attempt.report.object(objection)

    def _imbalance(self, attempt):
        """What the judge of the balance objects."""
        rise = attempt.energy - self.progress.stored
        contact = attempt.energies.get("contact", 0.0)
        known = attempt.work, rise, self.progress.stored, contact
        return self.balance.objection(attempt.taken, *known)

    def _look_back(self, attempt, share):
        """Measure the first step's work anew with the state at this share of it, as without it
        work is a trapezoid's, which halving would not mend; whether that state was found."""
        found, iterations = self.newton.x.copy(), attempt.report.iterations
        load = self.progress.load + share * attempt.taken
        values = self.scene.supports.values(load)
        back = Attempt(load, share * attempt.taken, attempt.tolerance, values)
        self._solve(back)
        if back.report.converged:
            self._measure(back)
        self._solve(attempt, start=found)
        attempt.report.iterations = max(iterations, attempt.report.iterations)
        if attempt.report.converged:
            self._measure(attempt)
        return back.report.converged and attempt.report.converged

    def _measure(self, attempt):
        """Energies, forces and work of the attempt's state."""
        scene = self.scene
        attempt.drained = 2 * scene.drag_energy()
        attempt.energies = self._energies()
        attempt.energies["viscous"] += attempt.drained
        attempt.forces = scene.held_forces()
        of_supports = scene.supports.work.since(attempt.load, attempt.forces, attempt.values)
        attempt.work = scene.work() + scene.comm.allreduce(of_supports)

    def _accept(self, attempt):
        scene, progress = self.scene, self.progress
        progress.viscosity.energy += attempt.drained
        progress.previous, progress.x = progress.x, progress.previous
        self.newton.x.copy(progress.x)
        scene.supports.work.accept(attempt.load, attempt.forces, attempt.values)
        scene.accept()
        scene.let_go()
        progress.memory, progress.solver = scene.memory(), self.newton.memory()
        if self._in_equilibrium:
            progress.accepted += 1
            progress.work += attempt.work
        else:
            self._in_equilibrium, progress.work = True, attempt.energy
        progress.load, progress.stored = attempt.load, attempt.energy
        progress.last_step = attempt.taken or progress.last_step
        progress.step = self._next_step_size(attempt)
        progress.viscosity.note_accepted(uncut=not self._cuts, at_rest=not attempt.taken)
        self._tell(attempt.report, attempt.energies)
        self._steps_at_rest += progress.load == 1 and not attempt.taken
        if progress.viscosity.drag and self._steps_at_rest == STEPS_AT_REST:
            return f"the state at full load still creeps after {STEPS_AT_REST} steps at rest"
        return ""

    def _next_step_size(self, attempt):
        progress, accuracy = self.progress, self.path.accuracy
        if accuracy and attempt.deviation:
            growth = np.clip(np.sqrt(accuracy / attempt.deviation), CUT, GROWTH)
            return min(max(attempt.taken * growth, 2 * SMALLEST), self.largest)
        if self._cuts:  # not by iterations: these may differ by rounding
            return progress.step
        return min(GROWTH * progress.step, self.largest)

    def _back_off(self, attempt):
        """Return to the last accepted state. The next attempt has a drag or a smaller step; why
        neither is left, or ""."""
        progress, taken = self.progress, attempt.taken
        progress.rejected += 1
        self._cuts += 1
        self.on_reject(attempt.load, attempt.report)
        self._restore()
        viscosity, gave_up = (
            progress.viscosity,
            f"gave up at load factor {rounded(progress.load, 6)}",
        )
        viscosity.stiffness = viscosity.stiffness or self.newton.stiffness(progress.x)
        if not np.isfinite(viscosity.stiffness):
            return f"{gave_up}: the tangent of the state there is not a number"
        is_hard = self.settings.viscosity == "auto" and taken <= HARD * self.largest
        if is_hard and viscosity.strengthen():
            return ""
        if taken > 2 * SMALLEST:
            progress.step = CUT * taken
            return ""
        even = f", even with a step of {rounded(taken)}" if taken else ""
        return f"{gave_up}: {attempt.report.reason}{even}"

    def _restore(self):
        """The scene in its last accepted state."""
        self.scene.drag = 0.0
        self.scene.set(self.progress.x)
        self.scene.set_load(self.progress.load)
        self.scene.residual(self._residual)

    def _predict(self, attempt):
        """Make `newton.x` the start of an attempt: extrapolated if cells allow it."""
        scene, progress, x = self.scene, self.progress, self.newton.x
        progress.x.copy(x)
        if not attempt.taken:
            return
        if progress.last_step:
            share = attempt.taken / progress.last_step
            x.axpby(-share, 1 + share, progress.previous)
            x.array[scene.held] = attempt.values
            scene.set(x)
            if scene.energy() != scene.INVERTED:
                return
            progress.x.copy(x)
        self.newton.follow_supports(x, attempt.values - x.array[scene.held])

    def _keep_contact(self, x):
        """Move nodes of the prediction x out of the tools that it goes through, if the energy is
        less then."""
        scene = self.scene
        scene.set(x)
        energy, motion = scene.energy(), scene.motion_to_gaps()
        x.array[:] += motion
        scene.set(x)
        if not scene.energy() < energy:
            self._predicted.copy(x)

    def _energies(self):
        return self.scene.energies() | {"viscous": self.progress.viscosity.energy}

    def _tell(self, report, energies):
        """Whoever listens, of the accepted state."""
        now, progress = time.perf_counter(), self.progress
        wall = now - self._clock if progress.load or progress.iterations else 0.0
        self.on_accept(
            Accepted(progress.load, energies, progress.work, report, self._cuts, wall, progress)
        )
        self._clock, self._cuts = now, 0
