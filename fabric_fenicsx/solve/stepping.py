"""Load stepping: from the unloaded scene to the full load, in steps that adapt to how hard they are."""

import time
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .newton import Report

EASY = 5  # iterations up to which the next step may grow
GROWTH, CUT = 1.5, 0.5


@dataclass(frozen=True)
class Accepted:
    """An accepted state: load factor, energies by kind and external work [N mm], its solve's report and cost."""

    load: float
    energies: dict
    external_work: float
    report: Report
    cuts: int  # of the load step, before it was accepted
    wall: float  # seconds since the last accepted state


@dataclass
class Outcome:
    """How a march ended: `reached` in [0, 1] and, if below 1, why."""

    reached: float = 0.0
    reason: str = ""
    accepted: int = 0
    rejected: int = 0
    iterations: int = 0


def march(newton, steps=20, max_step=None, min_step=1e-5, on_accept=None):
    """Bring the supports of `newton.scene` from load factor 0 to 1; returns an `Outcome`.

    steps: the first step is 1/steps; max_step: largest step, default 1/steps; a failed step is halved down to
    `min_step`, an easy one lets the next grow. on_accept(Accepted) is called at 0 and at each accepted state, with
    the scene in that state. Work of the supports is summed by the trapezoidal rule.
    Raises InputError for steps that are not above 0.
    """
    if not (np.isfinite(steps) and steps >= 1):
        raise InputError(f"steps is {steps}; allowed is 1 or more")
    max_step = 1.0 / steps if max_step is None else max_step
    if not 0 < max_step <= 1:
        raise InputError(f"max-step is {max_step}; allowed is a load factor above 0 and up to 1")
    scene, x, outcome = newton.scene, newton.x, Outcome()
    previous, last, r = x.duplicate(), x.duplicate(), x.duplicate()
    scene.u.copy(x)
    scene.residual(r)
    forces, work = scene.held_forces(), 0.0
    step, last_step, cuts = min(1.0 / steps, max_step), None, 0
    clock = time.perf_counter()
    if on_accept:
        on_accept(Accepted(0.0, scene.energies(), 0.0, Report(converged=True), 0, 0.0))
    while outcome.reached < 1:
        load = outcome.reached + step
        if load > 1 - 1e-9:
            load = 1.0
        taken = load - outcome.reached
        x.copy(last)
        if last_step is None:
            newton.tangent_predictor(x, taken * scene.at_full_load)
        else:
            x.axpby(-taken / last_step, 1 + taken / last_step, previous)
            x.array[scene.held] = load * scene.at_full_load
        report = newton.solve_for(x)
        outcome.iterations += report.iterations
        if not report.converged:
            outcome.rejected += 1
            cuts += 1
            last.copy(x)
            scene.set(x)
            step = CUT * taken
            if step < min_step:
                scene.residual(r)
                outcome.reason = f"gave up at load factor {outcome.reached:.6g}: {report.reason}, even with a step of {taken:.3g}"
                return outcome
            continue
        last.copy(previous)
        last_step = taken
        new_forces = scene.held_forces()
        work += scene.comm.allreduce(float((0.5 * (forces + new_forces) * taken * scene.at_full_load).sum()))
        forces = new_forces
        outcome.reached = load
        outcome.accepted += 1
        now = time.perf_counter()
        if on_accept:
            on_accept(Accepted(load, scene.energies(), work, report, cuts, now - clock))
        clock, cuts = now, 0
        if report.iterations <= EASY:
            step = min(GROWTH * taken, max_step) if taken < step * (1 - 1e-9) or step < max_step else step
    return outcome
