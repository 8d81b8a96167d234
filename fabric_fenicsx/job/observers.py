"""What goes on beside the steps of a run: limits, history, log, fields and checkpoint."""

import logging
import time
from pathlib import Path
from typing import Any

from petsc4py import PETSc
from tqdm import tqdm

from ..core.formatting import rounded
from ..core.status import log, on_terminal
from ..core.timing import phase
from ..results.fields import FieldSeries
from ..results.history import History, viscous_warning
from ..results.output import Output
from ..results.result import Result
from ..results.verdict import Numbers, Reason
from ..scene import output as scene_output
from ..scene.scene import Scene
from ..solve.checkpoint import Checkpoint
from ..solve.newton import Newton
from ..solve.progress import Accepted, Report
from ..solve.settings import Settings
from . import validity
from .setup import Observer


class LimitWatch(Observer):
    """Sentences on what is `wrong` with the last accepted state, a reason to end the run."""

    MAX_REJECTED = 2  # steps in a row, after which the reason may be that the ply can't be formed

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self.scene, self.settings = scene, settings
        self.wrong: list[str] = []
        self.rejected = 0  # steps since the last accepted state

    def accept(self, accepted: Accepted) -> None:
        self.rejected = 0
        self.wrong = validity.beyond_limits_now(self.scene, self.settings.limits)
        if self.settings.stop_when_invalid:
            self.wrong += self._not_formed()

    def reject(self, load: float, report: Report) -> None:
        self.rejected += 1

    def reason_to_stop(self) -> str:
        """Why the last state is not valid, where steps fail also by fabric that can't be formed;
        ""."""
        if self.rejected == self.MAX_REJECTED and not self.wrong:
            self.wrong = self._not_formed()
        return validity.not_valid(self.wrong)

    def _not_formed(self):
        now = Result({}, [], scene_output.cell_fields(self.scene), None, self.scene)
        return validity.not_formed(now, self.settings.limits)


class StateWriter(Observer):
    """Writes of each state of a `job` a row of the `history`, the fields to the `series` if it asks
    for them, and the checkpoint; notes: those of a run that is resumed."""

    @phase("output")
    def __init__(self, job: Any, output: Output, checkpoint: Checkpoint, notes: Numbers) -> None:
        self.job, self.setup, self.output, self.checkpoint = job, job.setup, output, checkpoint
        folder, rows = checkpoint.path.parent, notes.get("rows", ())
        self.series = FieldSeries(folder, job.scene, notes.get("states", ()))
        self.history = History(folder / "history.csv", job.scene.comm, rows)

    def accept(self, accepted: Accepted) -> None:
        scene, rows = self.setup.scene, self.history.rows
        if not accepted.load and any(term.prestressed for term in scene.terms):
            moved = scene.u.norm(PETSc.NormType.NORM_INFINITY)
            self.output.say(
                f"before loading, the sheet moved to its equilibrium by up to {moved:.3g} mm"
            )
        displacement, force, *further = self.setup.measure(scene, accepted.load)
        with phase("output"):
            share = self.setup.modelled_share
            whole = {} if share == 1 else {"reaction_of_whole_N": force / share}
            own = lambda taken: whole | scene_output.history(scene, taken) | dict(*further)  # noqa: E731
            self.history.add(accepted, displacement, force, own)
            if len(rows) == 1:
                scene_output.summary(scene)  # which refuses names given twice
            self.output.doubt(Reason(viscous_warning(rows, accepted.load)))
            if self.is_written():
                self.series.write(accepted.load)
            notes = {"rows": rows, "states": self.series.states}
            self.checkpoint.save(accepted.progress, notes)

    def is_written(self) -> bool:
        """True if the last state is written for ParaView: at full load, as stages may follow."""
        rows, kept = self.history.rows, (*self.job.milestones, 1.0)
        return (len(rows) - 1) % self.job.every == 0 or rows[-1]["load"] in kept


class ProgressLog(Observer):
    """Tells how far the run of the `states` is from the load factor `start` on, and how long it
    still takes, in the log and the status line."""

    MAX_SLOWDOWN = 1.5  # time of later steps over that of earlier ones, if all goes well

    def __init__(self, states: StateWriter, newton: Newton, start: float) -> None:
        self.states, self.rows, self.newton = states, states.history.rows, newton
        self.start = self.load = start
        self.size = self.seconds = 0.0  # of the last step
        self.reached = f"{self._name()}: first step"

    def begin(self, folder: Path, pictures: bool) -> None:
        self.began = self.step_began = time.monotonic()

    def accept(self, accepted: Accepted) -> None:
        load, row, now = accepted.load, self.rows[-1], time.monotonic()
        self.seconds, self.step_began = now - self.step_began, now
        self.size, self.load = load - self.load, load
        self.reached = (
            f"{self._name()}: step {accepted.progress.accepted}, {100 * load:.3g} %, "
            f"{rounded(row['displacement_mm'])} mm, {rounded(row['reaction_N'])} N, "
            f"{accepted.report.iterations} iterations"
        )
        if self.newton.scene.comm.rank == 0:
            is_seen = on_terminal() or self.states.output.is_quiet
            log.log(logging.DEBUG if is_seen else logging.INFO, self.reached + self.left(0.0))

    def reject(self, load: float, report: Report) -> None:
        if self.newton.scene.comm.rank == 0:
            words = "step to load %.6g rejected after %d iterations: %s"
            log.warning(words, load, report.iterations, report.reason)

    def doing(self) -> str:
        """How far the run is, for the status line."""
        seconds = time.monotonic() - self.step_began
        next_step = f"next: {self.newton.report.iterations} iterations, {seconds:.0f} s"
        return f"{self.reached}{self.left(seconds)}; {next_step}"

    def left(self, seconds: float) -> str:
        """The time that is left, in words: as steps took in the mean, and as the last one did or
        the one under way, since `seconds`."""
        done, to_do = self.load - self.start, 1 - self.load
        if not (done > 0 and to_do > 0):
            return ""
        mean, last = (self.step_began - self.began) / done, max(self.seconds, seconds) / self.size
        low, high = to_do * min(mean, last), self.MAX_SLOWDOWN * to_do * max(mean, last)
        return f", {tqdm.format_interval(low)} to {tqdm.format_interval(high)} left"

    def _name(self):
        folder, output = self.states.series.directory, self.states.output
        stages = [name for end, name in self.states.setup.stages if self.load <= end]
        part = [folder.name] if folder != output.path else []
        return ", ".join([*part, *stages[:1]]) or output.name
