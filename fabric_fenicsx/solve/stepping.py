"""Load stepping: from the unloaded scene to the full load, in steps that adapt to how hard they are."""

import time
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .newton import Report

EASY = 5  # iterations up to which the next step may grow
GROWTH, CUT = 1.5, 0.5


@dataclass
class Progress:
    """Where a march stands: load factor, size of the next step and of the last one (None before the first), work of
    the supports [N mm], displacement and the one before it (PETSc vectors, of the march itself)."""

    load: float
    step: float
    last_step: float | None
    work: float
    x: object
    previous: object


@dataclass(frozen=True)
class Accepted:
    """An accepted state: load factor, energies by kind and external work [N mm], its solve's report and cost."""

    load: float
    energies: dict
    external_work: float
    report: Report
    cuts: int  # of the load step, before it was accepted
    wall: float  # seconds since the last accepted state
    progress: Progress


@dataclass
class Outcome:
    """How a march ended: `reached` in [0, 1] and, if below 1, why."""

    reached: float = 0.0
    reason: str = ""
    accepted: int = 0
    rejected: int = 0
    iterations: int = 0


def march(newton, steps=20, max_step=None, min_step=1e-5, on_accept=None, on_reject=None, start=None, milestones=()):
    """Bring the supports of `newton.scene` to load factor 1, from 0 or from the `Progress` `start`; an `Outcome`.

    steps: the first step is 1/steps; max_step: largest step, default 1/steps; a failed step is halved down to
    `min_step`, an easy one lets the next grow. on_accept(Accepted) is called at load 0 and at each accepted state,
    with the scene in that state. Work of the supports is summed by the trapezoidal rule.
    milestones: load factors to be hit exactly. Raises InputError for steps that are not above 0.
    """
    if not (np.isfinite(steps) and steps >= 1):
        raise InputError(f"steps is {steps}; allowed is 1 or more")
    max_step = 1.0 / steps if max_step is None else max_step
    if not 0 < max_step <= 1:
        raise InputError(f"max-step is {max_step}; allowed is a load factor above 0 and up to 1")
    scene, x = newton.scene, newton.x
    at, r = start, x.duplicate()
    if at is None:
        at = Progress(0.0, min(1.0 / steps, max_step), None, 0.0, scene.u.copy(), x.duplicate())
    at.step = min(at.step, max_step)
    outcome = Outcome(reached=at.load)
    scene.set(at.x)
    scene.at(at.load)
    scene.residual(r)
    forces, cuts, clock = scene.held_forces(), 0, time.perf_counter()
    if on_accept and start is None:
        on_accept(Accepted(0.0, scene.energies(), 0.0, Report(converged=True), 0, 0.0, at))
    while at.load < 1:
        load = round(at.load + at.step, 12)  # rounded, so that tenths are tenths
        load = min(load, *(stop for stop in (*milestones, 1.0, 1.0) if stop > at.load))
        taken = load - at.load
        values = scene.held_values(load)
        scene.at(load)
        at.x.copy(x)
        if at.last_step is None:
            newton.tangent_predictor(x, values - x.array[scene.held])
        else:
            x.axpby(-taken / at.last_step, 1 + taken / at.last_step, at.previous)
            x.array[scene.held] = values
        report = newton.solve_for(x)
        outcome.iterations += report.iterations
        if not report.converged:
            outcome.rejected += 1
            if on_reject:
                on_reject(load, report)
            cuts += 1
            scene.set(at.x)
            scene.at(at.load)
            at.step = CUT * taken
            if at.step < min_step:
                scene.residual(r)
                outcome.reason = (
                    f"gave up at load factor {at.load:.6g}: {report.reason}, even with a step of {taken:.3g}"
                )
                break
            continue
        at.previous, at.x = at.x, at.previous
        x.copy(at.x)
        new_forces = scene.held_forces()
        at.work += scene.comm.allreduce(
            float((0.5 * (forces + new_forces) * (values - at.previous.array[scene.held])).sum())
        )
        forces = new_forces
        at.load = outcome.reached = load
        at.last_step = taken
        if report.iterations <= EASY and at.step < max_step:
            at.step = min(GROWTH * at.step, max_step)
        outcome.accepted += 1
        now = time.perf_counter()
        if on_accept:
            on_accept(Accepted(load, scene.energies(), at.work, report, cuts, now - clock, at))
        clock, cuts = now, 0
    return outcome
