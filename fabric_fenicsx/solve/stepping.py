"""Load stepping: from the unloaded scene to the full load, in steps as large as they converge."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..core.formatting import rounded, share
from . import step_criteria
from .newton import Newton
from .progress import Accepted, Outcome, Progress, Report, Termination
from .settings import Settings
from .staggered import keep_contact, predict, solve_staggered


@dataclass
class TrialStep:
    """A step to a load factor: its size; `tolerance` of its state, 0 for the solver's; supports'
    values there. Once solved: report, distance from the extrapolated path over the displacement,
    energies by kind, energy that drag took and work [N mm], forces of the supports [N]."""

    load: float
    size: float
    tolerance: float
    values: np.ndarray
    report: Report = field(default_factory=Report)
    deviation: float = 0.0
    energies: dict[str, float] = field(default_factory=dict)
    drag_loss: float = 0.0
    work: float = 0.0
    forces: np.ndarray = field(default_factory=lambda: np.empty(0))

    @property
    def energy(self) -> float:
        """Sum of all kinds [N mm]."""
        return sum(self.energies.values())


class LoadStepping:
    """Brings the supports of `newton.scene` to load factor 1, from 0 or from the `Progress`
    `start`: next load, trial step, criteria, accept or back off.

    A scene that is not in equilibrium at load 0, as under a blank holder's dead pressure, is first
    brought to it there. The energy stored at load 0 counts as work done.

    on_accept(Accepted) is called at load 0 and at each accepted state, with the scene in that
    state, on_reject(load, Report) after each failed trial. stop() is called after each trial, on
    all ranks; a text that it returns ends the run, with that reason.
    """

    GROWTH, CUT = 1.5, 0.5  # of a step, by one that passed and one that failed
    MIN_STEP = 1e-5  # load step that is still halved
    HARD_STEP = 1 / 16  # of the largest step, from where on cutting alone does not help
    MAX_CHECKED_STEPS = 8  # make the largest step; of smaller ones no energy balance is asked
    MAX_STEPS_AT_REST = 40  # at full load, for the sheet to creep to where it needs no drag

    def __init__(
        self,
        newton: Newton,
        settings: Settings | None = None,
        start: Progress | None = None,
        on_accept: Callable[[Accepted], object] = lambda accepted: None,
        on_reject: Callable[[float, Report], object] = lambda load, report: None,
        stop: Callable[[], str] = lambda: "",
    ) -> None:
        self.newton, self.scene, self.settings = newton, newton.scene, settings or Settings()
        self.on_accept, self.on_reject, self.stop = on_accept, on_reject, stop
        self.largest = self.settings.largest_step
        self._is_new, x, step = start is None, newton.x, 1.0 / self.settings.steps
        self.progress = start or Progress(self.scene.u.copy(), x.duplicate(), step)
        self.progress.step = min(self.progress.step, self.largest)
        self._predicted = x.duplicate()
        self._in_equilibrium = not self._is_new  # or it is to be found at load 0
        self._cuts, self._steps_at_rest, self._clock = 0, 0, time.perf_counter()

    def run(self) -> Outcome:
        """Step to full load; raises InputError for a scene that cannot begin."""
        self._begin()
        self.scene.was_loaded = True
        reason, p = "", self.progress
        while not reason and (p.load < 1 or p.viscosity.drag or not self._in_equilibrium):
            reason = self.stop() or self._step()
        self.scene.drag = 0.0
        if not self._in_equilibrium:  # observers get one state at least
            self._notify(Report(reason=reason), self._energies())
        return Outcome(p.load, reason, p.accepted, p.rejected, p.iterations)

    def _begin(self):
        scene, progress, newton = self.scene, self.progress, self.newton
        (scene.check_start if self._is_new else scene.check_held)()
        scene.set(progress.x)
        scene.set_load(progress.load)
        if progress.memory:
            scene.recall(progress.memory)
        if progress.solver:
            newton.recall(progress.solver)
        scene.accept()
        self._restore()
        if not progress.memory:
            places = progress.x.array[scene.fixed_dofs]
            scene.supports.work.accept(progress.load, scene.forces.array[scene.fixed_dofs], places)
        if not self._is_new:
            scene.release_locating_supports()
            return
        progress.stored = sum(self._energies().values())
        self._in_equilibrium = newton.is_at_rest(progress.x)
        if self._in_equilibrium:
            progress.work = progress.stored
            self._notify(Report(converged=True), self._energies())

    def _step(self):
        """Accept a trial step or back off from it; the reason to give up, or ""."""
        trial = self._next_trial()
        self._solve(trial)
        self._apply_criteria(trial)
        return self._accept(trial) if trial.report.converged else self._back_off(trial)

    def _next_trial(self):
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
        return TrialStep(load, load - progress.load, tolerance, self.scene.supports.values(load))

    def _solve(self, trial, start=None):
        """Find the trial's state, from a prediction or the vector `start`."""
        scene, progress, x = self.scene, self.progress, self.newton.x
        scene.set_load(trial.load)
        if start:
            start.copy(x)
        else:
            predict(self.newton, progress, trial.size, trial.values)
        x.copy(self._predicted)
        if scene.keeping and not start and not keep_contact(scene, x):
            self._predicted.copy(x)
        scene.set(x)
        scene.on_prediction()
        scene.drag, scene.origin = progress.viscosity.drag, progress.x
        trial.report, iterations = solve_staggered(self.newton, x, trial.tolerance, bool(start))
        progress.iterations += iterations
        if self.settings.accuracy and progress.last_step and not start:
            self._predicted.axpy(-1.0, x)
            trial.deviation = share(self._predicted.norm(), x.norm())

    def _apply_criteria(self, trial):
        """Reject the trial's state, if there is one, by the criteria of steps."""
        if trial.report.converged:
            trial.report.reject(step_criteria.off_path(trial.deviation, self.settings.accuracy))
        if trial.report.converged:
            self._measure(trial)
        if not (self._in_equilibrium and trial.report.converged):
            return
        missing, balance = self._missing_work(trial), self.settings.balance
        # energies that grow as the load or faster are 1 / size times as large in the end
        matters = share(step_criteria.UNBALANCED, trial.size)
        if not self.progress.last_step:  # work along a straight line, which halving does not mend
            matters = min(balance or np.inf, matters / 2)
        allowed = min(balance or np.inf, matters)
        for part in (1 / 2, 1 / 4, 3 / 4):  # of the step, at which its work is measured
            if missing <= allowed or not trial.report.converged:
                break
            allowed = matters
            if self._measure_on_the_way(trial, part):
                missing = self._missing_work(trial)
        if trial.report.converged:
            trial.report.reject(step_criteria.imbalance(missing, balance))

    def _missing_work(self, trial):
        if trial.size <= 1.5 * self.largest / self.MAX_CHECKED_STEPS:
            return 0.0
        stored, contact = self.progress.stored, trial.energies.get("contact", 0.0)
        return step_criteria.missing_work(trial.work, trial.energy - stored, stored, contact)

    def _measure_on_the_way(self, trial, part):
        """Remeasure work with the state at this part of the step; True if both are found."""
        solution, iterations = self.newton.x.copy(), trial.report.iterations
        load, size = self.progress.load + part * trial.size, part * trial.size
        inner = TrialStep(load, size, trial.tolerance, self.scene.supports.values(load))
        self._solve(inner)
        if inner.report.converged:
            self._measure(inner)
        else:
            self.scene.reject()
        self._solve(trial, start=solution)
        trial.report.iterations = max(iterations, trial.report.iterations)
        if trial.report.converged:
            self._measure(trial)
        return inner.report.converged and trial.report.converged

    def _measure(self, trial):
        """Set energies, forces and work of the trial's state."""
        scene = self.scene
        trial.drag_loss = 2 * scene.drag_energy()
        trial.energies = self._energies()
        trial.energies["viscous"] += trial.drag_loss
        trial.forces = scene.forces.array[scene.fixed_dofs]
        of_supports = scene.supports.work.since(trial.load, trial.forces, trial.values)
        trial.work = scene.work() + scene.comm.allreduce(of_supports)

    def _accept(self, trial):
        scene, progress = self.scene, self.progress
        progress.viscosity.energy += trial.drag_loss
        progress.previous, progress.x = progress.x, progress.previous
        self.newton.x.copy(progress.x)
        scene.supports.work.accept(trial.load, trial.forces, trial.values)
        scene.accept()
        scene.release_locating_supports()
        progress.memory, progress.solver = scene.memory(), self.newton.memory()
        progress.accepted += self._in_equilibrium
        progress.work = progress.work + trial.work if self._in_equilibrium else trial.energy
        self._in_equilibrium = True
        progress.load, progress.stored = trial.load, trial.energy
        progress.last_step = trial.size or progress.last_step
        progress.step = self._next_step_size(trial)
        progress.viscosity.note_accepted(uncut=not self._cuts, at_rest=not trial.size)
        self._notify(trial.report, trial.energies)
        self._steps_at_rest += progress.load == 1 and not trial.size
        most = self.MAX_STEPS_AT_REST
        creeps = progress.viscosity.drag and self._steps_at_rest == most
        return f"the state still creeps after {most} steps at constant load" if creeps else ""

    def _next_step_size(self, trial):
        progress, accuracy = self.progress, self.settings.accuracy
        if accuracy and trial.deviation:
            growth = np.clip(np.sqrt(accuracy / trial.deviation), self.CUT, self.GROWTH)
            return min(max(trial.size * growth, 2 * self.MIN_STEP), self.largest)
        if self._cuts:  # not by iterations: these may differ by rounding
            return progress.step
        return min(self.GROWTH * progress.step, self.largest)

    def _back_off(self, trial):
        """Return, and strengthen the drag or halve the step; the reason to give up, or ""."""
        progress, viscosity = self.progress, self.progress.viscosity
        progress.rejected += 1
        self._cuts += 1
        self.on_reject(trial.load, trial.report)
        self._restore()
        gave_up = f"gave up at load factor {rounded(progress.load, 6)}"
        viscosity.stiffness = viscosity.stiffness or self.newton.stiffness(progress.x)
        if not np.isfinite(viscosity.stiffness):
            return f"{gave_up}: the tangent of the state is not a number"
        is_hard = self.settings.viscosity == "auto" and trial.size <= self.HARD_STEP * self.largest
        if is_hard and viscosity.strengthen():
            return ""
        if trial.size > 2 * self.MIN_STEP:
            progress.step = self.CUT * trial.size
            return ""
        even = f", even with a step of {rounded(trial.size)}" if trial.size else ""
        return f"{gave_up}: {trial.report.reason}{self._law_there(trial)}{even}"

    def _law_there(self, trial):
        told = [term.history().get("min_stability") for term in self.scene.terms]
        least = min((float(getattr(each, "value", 0.0)) for each in told), default=0.0)
        words = f", where the law is unstable (ellipticity {rounded(least)}; 1 at rest)"
        return words if least < 0 and trial.report.reason == Termination.INVERTED.value else ""

    def _restore(self):
        self.scene.reject()
        self.scene.drag = 0.0
        self.scene.set(self.progress.x)
        self.scene.set_load(self.progress.load)
        self.scene.residual(self.newton.objective.r)

    def _energies(self):
        return self.scene.energies() | {"viscous": self.progress.viscosity.energy}

    def _notify(self, report, energies):
        now, p = time.perf_counter(), self.progress
        wall = now - self._clock if p.load or p.iterations else 0.0
        self.on_accept(Accepted(p.load, energies, p.work, report, self._cuts, wall, p))
        self._clock, self._cuts = now, 0
