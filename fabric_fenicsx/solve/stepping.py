"""Load stepping: from the unloaded scene to the full load, in steps as large as they converge."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from petsc4py import PETSc

from ..runtime.errors import InputError
from .newton import Newton
from .report import Report

GROWTH, CUT = 1.5, 0.5
HARD = 1 / 16  # of the largest step, from where on cutting alone does not help
WEAK, STRONG = 1e-7, 1e-1  # drag on a node, of the mean stiffness of one
LAGGED_UPDATES = 30  # of what terms hold during a solve, at most in one step
SMALL_WORK = 0.1  # of the energies, below which a step's work is not what its balance is of
FINEST = 8  # of these make the largest step, where energies miss work
STEPS_AT_REST = 40  # at full load, at most, for the sheet to creep to where it needs no drag


@dataclass
class Viscosity:
    """Regularisation by a drag on every node [N/mm per step], measured by the mean `stiffness` of
    one [N/mm]; energy taken by it [N mm]. It fades by one stage after `easy_steps_asked` steps in
    a row that passed uncut, a number that each failure doubles."""

    drag: float = 0.0
    energy: float = 0.0
    stiffness: float = 0.0
    easy_steps: int = 0
    easy_steps_asked: int = 1

    def strengthen(self) -> bool:
        """One stage more; False if it is as strong as allowed."""
        if self.drag >= STRONG * self.stiffness:
            return False
        if self.drag:
            self.easy_steps_asked = min(2 * self.easy_steps_asked, 16)
        self.drag, self.easy_steps = max(WEAK * self.stiffness, 10 * self.drag), 0
        return True

    def note_accepted(self, easy: bool, at_rest: bool) -> None:
        """Note a step that passed. At rest, as the load does not change, the drag fades after each;
        otherwise after `easy_steps_asked` that passed uncut."""
        self.easy_steps = self.easy_steps + 1 if easy else 0
        if at_rest or self.easy_steps >= self.easy_steps_asked:
            self.drag = self.drag / 4 if self.drag > WEAK * self.stiffness else 0.0
            self.easy_steps = 0


@dataclass
class Progress:
    """Where a march stands: load factor, size of the next step and of the last one (None before the
    first), work of supports, loads and tools [N mm], displacement and the one before it (PETSc
    vectors, of the march itself), the memories of scene and solver, what it cost so far, and the
    sum of energies [N mm] as the last state was accepted."""

    load: float
    step: float
    last_step: float | None
    work: float
    viscosity: Viscosity
    x: PETSc.Vec
    previous: PETSc.Vec
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    solver: dict[str, Any] = field(default_factory=dict)
    accepted: int = 0
    rejected: int = 0
    iterations: int = 0
    stored: float = 0.0


@dataclass(frozen=True)
class Accepted:
    """An accepted state: load factor, energies by kind (with "viscous", what drag took so far) and
    external work [N mm], its solve's report and cost."""

    load: float
    energies: dict[str, float]
    external_work: float
    report: Report
    cuts: int  # of the load step, before it was accepted
    wall: float  # seconds since the last accepted state
    progress: Progress


@dataclass
class Outcome:
    """How a march ended: `reached` in [0, 1] and, if that is below 1 or the state there is not at
    rest, why; steps and iterations, also of the march that this one went on from."""

    reached: float
    reason: str
    accepted: int
    rejected: int
    iterations: int


def march(
    newton: Newton,
    steps: float = 20,
    max_step: float | None = None,
    min_step: float = 1e-5,
    on_accept: Callable[[Accepted], Any] | None = None,
    on_reject: Callable[[float, Report], Any] | None = None,
    start: Progress | None = None,
    milestones: Iterable[float] = (),
    viscosity: bool = True,
    accuracy: float | None = None,
    path_tolerance: float | None = None,
    balance: float | None = None,
    stop: Callable[[], str] | None = None,
) -> Outcome:
    """Bring the supports of `newton.scene` to load factor 1, from 0 or from the `Progress` `start`;
    an `Outcome`.

    A scene that is not in equilibrium at load 0, as under a blank holder's dead pressure, is first
    brought to it there: what it then stores counts as work done.

    steps: the first step is 1/steps; max_step: largest step, default 1/steps; a failed step is
    halved down to `min_step`, one that passes uncut lets the next grow. on_accept(Accepted) is
    called at load 0 and at each accepted state, with the scene in that state, on_reject(load,
    Report) after each failed step. stop() is asked after each step, failed ones too, on all ranks;
    a text that it returns ends the march, with that reason. Work of supports and tools is summed by
    parabolas, see `Work`. milestones: load factors to be hit exactly.
    viscosity: whether steps that halving does not mend get a drag on every node, strengthened until
    they pass; it fades in those that follow, at full load in steps without load, so the last state
    is in equilibrium without it. accuracy: for scenes that depend on the path, the largest distance
    between a state and its linear extrapolation from the two before, over the displacement's norm;
    steps beyond twice that are cut. None: any. path_tolerance: looser than the solver's, for the
    states between the start and the next milestone or full load. balance: the largest share of a
    step's work that may be missing from the energies; a step beyond is halved, down to about
    1/`FINEST` of the largest, as what is lost in a snap is missing with any step. None: any.
    Raises InputError for steps, an accuracy or a balance that are not above 0.
    """
    if not (np.isfinite(steps) and steps >= 1):
        raise InputError(f"steps is {steps}; allowed is 1 or more")
    max_step = 1.0 / steps if max_step is None else max_step
    if not 0 < max_step <= 1:
        raise InputError(f"`max_step` is {max_step}; allowed is a load factor above 0 and up to 1")
    if accuracy is not None and not accuracy > 0:
        raise InputError(f"`accuracy` is {accuracy}; allowed is a number above 0")
    if balance is not None and not balance > 0:
        raise InputError(f"`balance` is {balance}; allowed is a number above 0")
    scene, x = newton.scene, newton.x
    scene.check_held() if start else scene.check_start()
    progress, r, predicted = start, x.duplicate(), x.duplicate()
    if progress is None:
        progress = Progress(
            0.0, min(1.0 / steps, max_step), None, 0.0, Viscosity(), scene.u.copy(), x.duplicate()
        )
    progress.step = min(progress.step, max_step)
    reason = ""

    def restore_accepted():
        scene.drag = 0.0
        scene.set(progress.x)
        scene.at(progress.load)
        scene.residual(r)

    scene.set(progress.x)
    scene.at(progress.load)
    if progress.memory:
        scene.recall(progress.memory)
    if progress.solver:
        newton.recall(progress.solver)
    scene.accept()
    restore_accepted()
    if not progress.memory:
        scene.support_work.accept(progress.load, scene.held_forces(), progress.x.array[scene.held])
    cuts, steps_at_rest, clock = 0, 0, time.perf_counter()
    if start is None:
        progress.stored = sum(_energies(scene, progress).values())
    settled = start is not None or newton.is_at_rest(progress.x)
    if on_accept and start is None and settled:
        on_accept(
            Accepted(0.0, _energies(scene, progress), 0.0, Report(converged=True), 0, 0.0, progress)
        )
    while progress.load < 1 or progress.viscosity.drag or not settled:
        reason = stop() if stop else ""
        if reason:
            break
        load = progress.load + progress.step if settled else progress.load
        if abs(load * steps - round(load * steps)) < 1e-9:  # so that tenths are tenths
            load = round(load * steps) / steps
        goal = min((m for m in milestones if m > progress.load), default=1.0)
        if settled and load > goal - 1e-3 * progress.step:  # nor is a sliver left before it
            load = goal
        taken = load - progress.load
        values = scene.held_values(load)
        scene.at(load)
        _predict(newton, progress, taken, values)
        x.copy(predicted)
        scene.drag, scene.origin = progress.viscosity.drag, progress.x
        allowed = None if load == goal or not settled else path_tolerance
        report, iterations = _solve_lagged(newton, x, allowed or 0.0, moving=bool(taken))
        progress.iterations += iterations
        error = (
            (x - predicted).norm() / max(x.norm(), 1e-300)
            if accuracy and progress.last_step
            else 0.0
        )
        if report.converged and accuracy and error > 2 * accuracy:
            report.converged, report.reason = False, f"the path is not known to {accuracy:g}"
        if report.converged:
            drained = 2 * scene.drag_energy()
            energies = _energies(scene, progress)
            energies["viscous"] += drained
            forces = scene.held_forces()
            work = scene.work() + scene.comm.allreduce(
                scene.support_work.since(load, forces, values)
            )
            # work of the first step is a trapezoid's, which halving does not mend
            judged = settled and progress.last_step and taken > 1.5 * max_step / FINEST
            missing = _missing(work, sum(energies.values()), progress.stored) if judged else 0.0
            if balance and missing > balance:
                report.converged = False
                report.reason = (
                    f"{100 * missing:.3g} % of the step's work is not in the energies; allowed is "
                    f"{100 * balance:g} %"
                )
        if not report.converged:
            progress.rejected += 1
            cuts += 1
            if on_reject:
                on_reject(load, report)
            restore_accepted()
            progress.viscosity.stiffness = progress.viscosity.stiffness or newton.stiffness(
                progress.x
            )
            if not np.isfinite(progress.viscosity.stiffness):
                reason = (
                    f"gave up at load factor {progress.load:.6g}: the tangent of the state "
                    "there is not a number"
                )
                break
            hard = viscosity and taken <= HARD * max_step
            if hard and progress.viscosity.strengthen():
                pass
            elif taken > 2 * min_step:
                progress.step = CUT * taken
            else:
                even = f", even with a step of {taken:.3g}" if taken else ""
                reason = f"gave up at load factor {progress.load:.6g}: {report.reason}{even}"
                break
            continue
        at_once = cuts == 0  # not by iterations: these may differ by rounding
        progress.viscosity.energy += drained
        progress.previous, progress.x = progress.x, progress.previous
        x.copy(progress.x)
        progress.work += work
        scene.support_work.accept(load, forces, values)
        scene.accept()
        progress.memory, progress.solver = scene.memory(), newton.memory()
        progress.accepted += settled  # equilibrium at load 0 is no step
        if not settled:
            settled, progress.work = True, sum(energies.values())
        progress.stored = sum(energies.values())
        progress.load = load
        progress.last_step = taken or progress.last_step
        if accuracy and error:
            progress.step = min(
                max(taken * np.clip(np.sqrt(accuracy / error), CUT, GROWTH), 2 * min_step), max_step
            )
        elif at_once:
            progress.step = min(GROWTH * progress.step, max_step)
        if progress.viscosity.drag:
            progress.viscosity.note_accepted(at_once, at_rest=not taken)
        now = time.perf_counter()
        if on_accept:
            on_accept(Accepted(load, energies, progress.work, report, cuts, now - clock, progress))
        clock, cuts = now, 0
        steps_at_rest += load == 1 and not taken
        if progress.viscosity.drag and steps_at_rest == STEPS_AT_REST:
            reason = f"the state at full load still creeps after {STEPS_AT_REST} steps at rest"
            break
    scene.drag = 0.0
    if on_accept and not settled:  # whoever listens hears of one state at least
        on_accept(
            Accepted(
                0.0, _energies(scene, progress), 0.0, Report(reason=reason), cuts, 0.0, progress
            )
        )
    return Outcome(progress.load, reason, progress.accepted, progress.rejected, progress.iterations)


def _solve_lagged(newton, x, allowed, moving):
    """Solve for x, again and again until terms have nothing to take anew: at first to their `rough`
    tolerance, in the end to `allowed` or the solver's. The last `Report`, with the iterations of
    the hardest solve, and the iterations of all."""
    scene, every = newton.scene, []
    allowed = max(allowed, newton.tolerance)
    tolerance = max(allowed, scene.rough)
    for _ in range(LAGGED_UPDATES + 1):
        report = newton.solve_for(x, tolerance, minimum=tolerance == allowed)
        every.append(report.iterations)
        report.iterations = max(every)
        if not report.converged:
            break
        if not scene.update_lagged():
            if tolerance == allowed:
                break
            tolerance = allowed
        elif moving and _upset(scene, x):  # it would settle after hundreds of iterations, if ever
            report.converged = False
            report.reason = "contact changed by more than all forces after a solution"
            break
    else:
        report.converged = False
        report.reason = f"contact was not settled by {LAGGED_UPDATES} solutions"
    return report, sum(every)


def _upset(scene, x):
    """Whether what terms have taken anew leaves the scene further out of balance at x than the
    forces on it are large."""
    residual = x.duplicate()
    scene.set(x)
    scene.residual(residual)
    return residual.norm() > scene.force_scale()


def _missing(work, energy, stored):
    """Share of a step's work that is not in the rise of the energies from what was `stored`."""
    rise = energy - stored
    return abs(work - rise) / max(abs(work), abs(rise), SMALL_WORK * abs(stored), 1e-300)


def _energies(scene, progress):
    return scene.energies() | {"viscous": progress.viscosity.energy}


def _predict(newton, progress, taken, values):
    """A start for the step `taken` [load factor] to support `values`, into newton.x: extrapolated
    if cells allow it."""
    scene, x = newton.scene, newton.x
    progress.x.copy(x)
    if not taken:
        return
    if progress.last_step:
        x.axpby(-taken / progress.last_step, 1 + taken / progress.last_step, progress.previous)
        x.array[scene.held] = values
        scene.set(x)
        if scene.energy() != scene.INVERTED:
            return
        progress.x.copy(x)
    newton.tangent_predictor(x, values - x.array[scene.held])
