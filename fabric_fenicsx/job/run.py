"""A job under way, and the files that it writes with each state."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from petsc4py import PETSc
from tqdm import tqdm

from ..results.history import ENERGIES, History, energy_balance, viscous_warning
from ..results.output import Output
from ..results.result import Result
from ..results.verdict import INVALID, Reason
from ..runtime import status
from ..runtime.errors import NOT_BELIEVED
from ..runtime.formatting import rounded
from ..runtime.signals import StopSignals
from ..runtime.timing import phase
from ..scene import output as scene_output
from ..solve.checkpoint import Checkpoint
from ..solve.newton import Newton
from ..solve.progress import Accepted, Outcome, Progress
from ..solve.report import Report
from ..solve.stepping import LoadStepping
from . import validity

if TYPE_CHECKING:
    from .job import Job

log = logging.getLogger("fabric_fenicsx")
ENOUGH_REJECTED = 2  # steps in a row, after which the reason may be that the ply can't be formed
LATER_STEPS = 1.5  # time of later steps over that of earlier ones, at most, if all goes well


def time_left(to_do: float, mean: float, last: float) -> str:
    """The time that a load factor `to_do` takes, in words: as the steps in the mean did, and as the
    `last` one [s per load factor]."""
    low, high = to_do * min(mean, last), LATER_STEPS * to_do * max(mean, last)
    return f", {tqdm.format_interval(low)} to {tqdm.format_interval(high)} left"


class Run:
    """The run of a `job` in a `folder`, from rest or from a `Progress`: it writes history, fields
    and checkpoint at each accepted state, and the summary at the end.

    start, notes: as `Checkpoint.load` gives them, None and empty for a run from rest. stopped: the
    signal that ended the run, in words, or ""; wrong: why the result is not to be believed, or "".
    """

    def __init__(
        self,
        job: Job,
        output: Output,
        folder: Path,
        newton: Newton,
        checkpoint: Checkpoint,
        start: Progress | None,
        notes: Mapping[str, Any],
    ) -> None:
        with phase("imports"):
            from ..results.fields import FieldSeries

        self.job, self.output, self.folder, self.scene = job, output, folder, job.scene
        self._newton, self._checkpoint, self._start = newton, checkpoint, start
        comm = self.scene.comm
        for warning in job.setup.warnings:
            output.warn(warning)
        for doubt in validity.warnings_at_start(self.scene):
            output.tell(doubt)
        if comm.rank == 0:
            for old in [folder / "summary.json", *folder.glob("*.png")]:
                old.unlink(missing_ok=True)  # of an earlier run, not of this one
        self.history = History(folder / "history.csv", comm, notes.get("rows", ()))
        with phase("output"):
            self.series = FieldSeries(folder, self.scene, notes.get("states", ()))
        self._from = start.load if start else 0.0
        self._reached = f"{self._stage(self._from)}: first step"
        self._load, self._size, self._last_seconds = self._from, 0.0, 0.0  # of the last step
        self._wrong_now: list[str] = []  # what is wrong with the last accepted state
        self._rejected = 0  # steps since then
        self.stopped, self.wrong = "", ""

    def to_full_load(self) -> Result:
        """Step to full load; the `Result`, whose summary is written."""
        signals = StopSignals(self.scene.comm)
        stepping = LoadStepping(
            self._newton,
            self.job,
            self._start,
            on_accept=self._accept,
            on_reject=self._reject,
            stop=lambda: signals() or self._reason_to_stop(),
        )
        self._began = self._step_began = time.monotonic()
        first = self.scene.comm.rank == 0
        try:
            with phase("steps"), status.shown(False, first), status.task(self._doing):
                outcome = stepping.run()
        finally:
            signals.forget()
            self.history.close()
        self.stopped = signals()
        return self._result(outcome)

    def _accept(self, accepted: Accepted) -> None:
        scene, output, rows = self.scene, self.output, self.history.rows
        if not accepted.load and any(term.prestressed for term in scene.terms):
            moved = scene.u.norm(PETSc.NormType.NORM_INFINITY)
            output.say(
                f"at rest in its supports, before load, the sheet has moved by up to {moved:.3g} mm"
            )
        self._rejected = 0
        self._wrong_now = validity.beyond_limits_now(scene, self.job.limits)
        if self.job.stop_when_invalid:
            self._wrong_now += self._not_formed()
        measured: tuple[float, float] = self.job.setup.measure(scene, accepted.load)
        with phase("output"):
            self.history.add(accepted, *measured, partial(self._further, measured[1]))
            if len(rows) == 1:
                scene_output.summary(scene)  # which refuses names given twice
        output.doubt(Reason(viscous_warning(rows, accepted.load)))
        self._tell(accepted, *measured)
        with phase("output"):
            if self._is_written():
                self.series.write(accepted.load)
            notes = {"rows": rows, "states": self.series.states}
            self._checkpoint.save(accepted.progress, notes)

    def _tell(self, accepted, displacement, force):
        """Note how far the run is, and log it: on a terminal the status line says so."""
        load, now = accepted.load, time.monotonic()
        self._reached = (
            f"{self._stage(load)}: step {accepted.progress.accepted}, {100 * load:.3g} %, "
            f"{rounded(displacement)} mm, {rounded(force)} N, {accepted.report.iterations} "
            "iterations"
        )
        self._last_seconds, self._step_began = now - self._step_began, now
        self._size, self._load = load - self._load, load
        if self.scene.comm.rank == 0:
            is_seen = status.on_terminal() or self.output.is_quiet
            log.log(logging.DEBUG if is_seen else logging.INFO, self._reached + self._left(0.0))

    def _left(self, seconds):
        """As of `time_left`, with the last step or the one under way, since `seconds`."""
        done, to_do = self._load - self._from, 1 - self._load
        if not (done > 0 and to_do > 0):
            return ""
        last = max(self._last_seconds, seconds) / self._size
        return time_left(to_do, (self._step_began - self._began) / done, last)

    def _doing(self):
        """How far the run is, for the status line."""
        report, seconds = self._newton.report, time.monotonic() - self._step_began
        left = self._left(seconds)
        return f"{self._reached}{left}; next: {report.iterations} iterations, {seconds:.0f} s"

    def _stage(self, load):
        """What the run is called at a load factor."""
        folder, stage = self.folder, self.job.setup.stage(load)
        part = folder.name if folder != self.output.path else "" if stage else self.output.name
        return ", ".join(filter(None, [part, stage]))

    def _further(self, force, taken):
        """Columns of the history beside those `taken`, with the whole sheet's force."""
        share = self.job.setup.modelled_share()
        whole = {} if share == 1 else {"reaction_of_whole_N": force / share}
        own = self.job.setup.columns(self.scene)
        return whole | scene_output.history(self.scene, taken) | own

    def _not_formed(self):
        """`validity.not_formed` of the last accepted state."""
        fields = scene_output.cell_fields(self.scene)
        now = Result({}, self.history.rows, fields, None, self.scene)
        return validity.not_formed(now, self.job.limits)

    def _reason_to_stop(self):
        """Why the last accepted state is not to be believed: where even shorter steps fail, also
        fabric that can't be formed; ""."""
        if self._rejected == ENOUGH_REJECTED and not self._wrong_now:
            self._wrong_now = self._not_formed()
        return validity.not_believed(self._wrong_now)

    def _reject(self, load: float, report: Report) -> None:
        self._rejected += 1
        if self.scene.comm.rank == 0:
            words = "step to load %.6g rejected after %d iterations: %s"
            log.warning(words, load, report.iterations, report.reason)

    def _is_written(self):
        """True if the last state is written for ParaView: at full load, as stages may follow."""
        rows = self.history.rows
        kept = *self.job.milestones, 1.0
        return (len(rows) - 1) % self.job.every == 0 or rows[-1]["load"] in kept

    @phase("output")
    def _result(self, outcome: Outcome) -> Result:
        scene, output, rows = self.scene, self.output, self.history.rows
        fields = scene_output.cell_fields(scene)
        if not self._is_written():
            self.series.write(outcome.reached, fields)
        result = Result({}, rows, fields, self.folder, scene)
        # of the last row, as terms have since taken anew what they held in its solve
        kinds = {**dict.fromkeys(ENERGIES), **scene.energies()}
        energy = {kind: rows[-1][f"{kind}_energy_Nmm"] for kind in kinds}
        energy["external_work"] = rows[-1]["external_work_Nmm"]
        quantities = self.job.setup.quantities(result)
        wrong = validity.not_formed(result, self.job.limits)
        wrong += [each for each in self._wrong_now if each not in wrong]
        wrong += validity.beyond_limits_at_end(scene, self.job.limits, rows, energy)
        self.wrong = outcome.reason or validity.not_believed(wrong)
        if outcome.reason and not outcome.reason.startswith(NOT_BELIEVED):
            wrong.append(outcome.reason)
            self.wrong = outcome.reason if self.stopped else "; ".join(wrong[::-1])
        invalid = [Reason(each, verdict=INVALID) for each in wrong]
        for reason in (*invalid, *validity.doubts(result, energy, quantities)):
            output.doubt(reason)
        result.summary = output.summarise(
            self.folder,
            converged=not self.wrong,
            stroke_reached=outcome.reached,
            reason=self.wrong or "full load reached",
            **scene_output.sizes(scene),
            **scene_output.summary(scene),
            steps_accepted=outcome.accepted,
            steps_rejected=outcome.rejected,
            newton_iterations=outcome.iterations,
            energy=energy,
            reaction_N=rows[-1]["reaction_N"],
            reaction_is=self.job.setup.force_name(),
            **energy_balance(rows, energy),
            quantities=quantities,
        )
        return result
