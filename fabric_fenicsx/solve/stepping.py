"""Load stepping: from the unloaded scene to the full load, in steps that adapt to how hard they are."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from petsc4py import PETSc

from ..errors import InputError
from .newton import Newton, Report

EASY = 15  # iterations up to which the next step may grow
GROWTH, CUT = 1.5, 0.5
HARD = 1 / 16  # of the largest step, from where on cutting alone does not help
WEAK, STRONG = 1e-7, 1e-1  # drag on a node, of the mean stiffness of one
REVISIONS = 30  # of what terms hold during a solve
RESTS = 40  # steps without load, to let a held sheet creep to where no drag is needed


@dataclass
class Viscosity:
    """Regularisation by a drag on every node [N/mm per step], measured by the mean `stiffness` of one [N/mm]; energy
    taken by it [N mm]. It fades by one stage after `patience` easy steps in a row, of which each failure asks more."""

    drag: float = 0.0
    energy: float = 0.0
    stiffness: float = 0.0
    easy: int = 0
    patience: int = 1

    def strengthen(self) -> bool:
        """One stage more; False if it is as strong as allowed."""
        if self.drag >= STRONG * self.stiffness:
            return False
        if self.drag:
            self.patience = min(2 * self.patience, 16)
        self.drag, self.easy = max(WEAK * self.stiffness, 10 * self.drag), 0
        return True

    def passed(self, easy: bool, resting: bool) -> None:
        """Note a step that passed, whether easily and whether without load."""
        self.easy = self.easy + 1 if easy else 0
        if self.easy >= (1 if resting else self.patience):
            self.drag, self.easy = (self.drag / 4 if self.drag > WEAK * self.stiffness else 0.0), 0


@dataclass
class Progress:
    """Where a march stands: load factor, size of the next step and of the last one (None before the first), work of
    supports, loads and tools [N mm], displacement and the one before it (PETSc vectors, of the march itself), the
    memories of scene and solver, and what it cost so far."""

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


@dataclass(frozen=True)
class Accepted:
    """An accepted state: load factor, energies by kind (with "viscous", what drag took so far) and external work
    [N mm], its solve's report and cost."""

    load: float
    energies: dict[str, float]
    external_work: float
    report: Report
    cuts: int  # of the load step, before it was accepted
    wall: float  # seconds since the last accepted state
    progress: Progress


@dataclass
class Outcome:
    """How a march ended: `reached` in [0, 1] and, if that is below 1 or the state there is not at rest, why; steps and
    iterations, also of the march that this one went on from."""

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
    stop: Callable[[], str] | None = None,
) -> Outcome:
    """Bring the supports of `newton.scene` to load factor 1, from 0 or from the `Progress` `start`; an `Outcome`.

    A scene that is not in equilibrium at load 0, as under a blank holder's dead pressure, is first brought to it there:
    what it then stores counts as work done.

    steps: the first step is 1/steps; max_step: largest step, default 1/steps; a failed step is halved down to
    `min_step`, an easy one lets the next grow. on_accept(Accepted) is called at load 0 and at each accepted state,
    with the scene in that state, on_reject(load, Report) after each failed step. stop() is asked after each step,
    failed ones too, on all ranks; a text that it returns ends the march, with that reason. Work of supports and tools
    is summed by parabolas, see `Work`.
    milestones: load factors to be hit exactly.
    viscosity: whether steps that halving does not mend get a drag on every node, strengthened until they pass; it
    fades in those that follow, at full load in steps without load, so the last state is in equilibrium without it.
    accuracy: for scenes that depend on the path, the largest distance between a state and its linear extrapolation
    from the two before, over the displacement's norm; steps beyond twice that are cut. None: any.
    path_tolerance: looser than the solver's, for the states between the start and the next milestone or full load.
    Raises InputError for steps or an accuracy that are not above 0.
    """
    if not (np.isfinite(steps) and steps >= 1):
        raise InputError(f"steps is {steps}; allowed is 1 or more")
    max_step = 1.0 / steps if max_step is None else max_step
    if not 0 < max_step <= 1:
        raise InputError(f"max-step is {max_step}; allowed is a load factor above 0 and up to 1")
    if accuracy is not None and not accuracy > 0:
        raise InputError(f"accuracy is {accuracy}; allowed is a number above 0")
    scene, x = newton.scene, newton.x
    scene.check_held()
    at, r, predicted = start, x.duplicate(), x.duplicate()
    if at is None:
        at = Progress(0.0, min(1.0 / steps, max_step), None, 0.0, Viscosity(), scene.u.copy(), x.duplicate())
    at.step = min(at.step, max_step)
    reason = ""

    def back():
        scene.drag = 0.0
        scene.set(at.x)
        scene.at(at.load)
        scene.residual(r)

    scene.set(at.x)
    scene.at(at.load)
    if at.memory:
        scene.recall(at.memory)
    if at.solver:
        newton.recall(at.solver)
    scene.accept()
    back()
    if not at.memory:
        scene.support_work.accept(at.load, scene.held_forces(), at.x.array[scene.held])
    cuts, rests, clock = 0, 0, time.perf_counter()
    settled = start is not None or newton.is_at_rest(at.x)
    if on_accept and start is None and settled:
        on_accept(Accepted(0.0, _energies(scene, at), 0.0, Report(converged=True), 0, 0.0, at))
    while at.load < 1 or at.viscosity.drag or not settled:
        reason = stop() if stop else ""
        if reason:
            break
        load = at.load + at.step if settled else at.load
        if abs(load * steps - round(load * steps)) < 1e-9:  # so that tenths are tenths
            load = round(load * steps) / steps
        goal = min((m for m in milestones if m > at.load), default=1.0)
        if settled and load > goal - 1e-3 * at.step:  # nor is a sliver left before it
            load = goal
        taken = load - at.load
        values = scene.held_values(load)
        scene.at(load)
        _predict(newton, at, taken, values)
        x.copy(predicted)
        scene.drag, scene.origin = at.viscosity.drag, at.x
        allowed = None if load == goal or not settled else path_tolerance
        report = newton.solve_for(x, allowed)
        at.iterations += report.iterations
        for revision in range(REVISIONS):
            if not (report.converged and scene.revise()):
                break
            before = report.iterations
            report = newton.solve_for(x, allowed)
            at.iterations += report.iterations
            report.iterations = max(before, report.iterations)
            if revision == REVISIONS - 1:
                report.converged, report.reason = False, f"contact was not settled by {REVISIONS} solutions"
        error = (x - predicted).norm() / max(x.norm(), 1e-300) if accuracy and at.last_step else 0.0
        if report.converged and accuracy and error > 2 * accuracy:
            report.converged, report.reason = False, f"the path is not known to {accuracy:g}"
        if not report.converged:
            at.rejected += 1
            cuts += 1
            if on_reject:
                on_reject(load, report)
            back()
            at.viscosity.stiffness = at.viscosity.stiffness or newton.stiffness(at.x)
            if not np.isfinite(at.viscosity.stiffness):
                reason = f"gave up at load factor {at.load:.6g}: the tangent of the state there is not a number"
                break
            hard = viscosity and taken <= HARD * max_step
            if hard and at.viscosity.strengthen():
                pass
            elif taken > 2 * min_step:
                at.step = CUT * taken
            else:
                reason = f"gave up at load factor {at.load:.6g}: {report.reason}, even with a step of {taken:.3g}"
                break
            continue
        at.viscosity.energy += 2 * scene.drag_energy()
        at.previous, at.x = at.x, at.previous
        x.copy(at.x)
        forces = scene.held_forces()
        energies = _energies(scene, at)
        at.work += scene.work() + scene.comm.allreduce(scene.support_work.since(load, forces, values))
        scene.support_work.accept(load, forces, values)
        scene.accept()
        at.memory, at.solver = scene.memory(), newton.memory()
        at.accepted += settled  # equilibrium at load 0 is no step
        if not settled:
            settled, at.work = True, sum(energies.values())
        at.load = load
        at.last_step = taken or at.last_step
        if accuracy and error:
            at.step = min(max(taken * np.clip(np.sqrt(accuracy / error), CUT, GROWTH), 2 * min_step), max_step)
        elif report.iterations <= EASY:
            at.step = min(GROWTH * at.step, max_step)
        if at.viscosity.drag:
            at.viscosity.passed(report.iterations <= EASY, resting=not taken)
        now = time.perf_counter()
        if on_accept:
            on_accept(Accepted(load, energies, at.work, report, cuts, now - clock, at))
        clock, cuts = now, 0
        rests += load == 1 and not taken
        if at.viscosity.drag and rests == RESTS:
            reason = f"the state at full load still creeps after {RESTS} steps at rest"
            break
    scene.drag = 0.0
    if on_accept and not settled:  # whoever listens hears of one state at least
        on_accept(Accepted(0.0, _energies(scene, at), 0.0, Report(reason=reason), cuts, 0.0, at))
    return Outcome(at.load, reason, at.accepted, at.rejected, at.iterations)


def _energies(scene, at):
    return scene.energies() | {"viscous": at.viscosity.energy}


def _predict(newton, at, taken, values):
    """A start for the step `taken` [load factor] to support `values`, into newton.x: extrapolated if cells allow it."""
    scene, x = newton.scene, newton.x
    at.x.copy(x)
    if not taken:
        return
    if at.last_step:
        x.axpby(-taken / at.last_step, 1 + taken / at.last_step, at.previous)
        x.array[scene.held] = values
        scene.set(x)
        if scene.energy() != scene.INVERTED:
            return
        at.x.copy(x)
    newton.tangent_predictor(x, values - x.array[scene.held])
