"""A job: brings a scene to full load, and keeps what happened on the way."""

import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

from ..core.collective_errors import all_or_none
from ..core.errors import NOT_VALID, InputError, Interrupted, SolverFailure
from ..core.fields import declared
from ..core.files import read_json
from ..core.formatting import rounded
from ..core.processes import StopSignals
from ..core.status import log, shown, task
from ..core.timing import phase
from ..energy.fingerprint import entries
from ..energy.materials import materials_of
from ..energy.output import Fields
from ..results import error
from ..results.fields import FieldSeries
from ..results.history import ENERGIES, energy_balance
from ..results.output import Output
from ..results.quantities import waves_that_do_not_form
from ..results.result import Result
from ..results.verdict import INVALID, OK, Numbers, Reason
from ..scene import output as scene_output
from ..scene.scene import Scene
from ..solve.checkpoint import Checkpoint
from ..solve.newton import Newton
from ..solve.settings import Settings
from ..solve.stepping import LoadStepping
from . import validity
from .observers import LimitWatch, ProgressLog, StateWriter
from .setup import Observer, Setup


@dataclass(frozen=True, kw_only=True)
class Job(Settings):
    """Load stepping of a scene from rest to full load, with history, fields and checkpoint.

    Parameters
    ----------
    setup : Scene or Setup
        A scene at rest, with new terms; or a `Setup` that also defines quantities and pictures.
    steps, max_step, tolerance, path_tolerance, viscosity, ...
        Keywords of the solver, the fields of `Settings`.
    error : bool
        Estimate errors from the same run on a coarser mesh.
    coarser : callable, optional
        Function that returns this job on a coarser mesh, by default that of the `Setup`.
    observers : sequence
        Objects with the methods of an `Observer`, called at each state, e.g. to write files.

    Examples
    --------
    >>> sheet = ff.Blank.rectangle(40, 20, nx=2, element="P1")
    >>> scene = ff.Scene(sheet, [ff.Membrane(ff.load("komeili"))], ff.clamped_ends(0.4))
    >>> result = ff.Job(scene, steps=2).run()
    >>> [row["load"] for row in result.rows]
    [0.0, 0.5, 1.0]
    """

    setup: Any = field(kw_only=False)
    error: bool = False
    coarser: Callable[[], Any] | None = None
    observers: Sequence[Observer] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.setup, Scene):
            object.__setattr__(self, "setup", Setup(self.setup))

    @classmethod
    def of(cls, setup: Setup, **changes: Any) -> Self:
        """The job of a described test, with the steps and the solver that its data have."""
        names = [each.name for each in declared(Settings)]
        usual = {name: value for name, value in setup.data.FULL.items() if name in names}
        return cls(setup, **usual | dict(setup.data.SOLVER) | changes)

    @property
    def scene(self) -> Scene:
        """The scene that it runs."""
        return self.setup.scene

    @property
    def name(self) -> str:
        """Of the study in the summary."""
        return self.setup.name

    @phase("setup")
    def run(
        self,
        out: Output | Path | str | None = None,
        part: str = "",
        *,
        resume: bool = False,
        overwrite: bool = False,
        pictures: bool = True,
        problem: Numbers | None = None,
    ) -> Result:
        """Run to full load, on all ranks.

        Parameters
        ----------
        out : Output, path or None
            The folder, None to keep no files; an `Output` says by itself how it is used.
        part : str
            Subfolder.
        resume, overwrite : bool
            Go on from the checkpoint there, on any number of ranks; lose the results there.
        pictures : bool
            Draw, too.
        problem : mapping, optional
            Entries in which a checkpoint must agree to be gone on from, besides the numbers of
            terms and supports. Functions and large arrays that terms hold, and the code of own
            ones, are not compared.

        Returns
        -------
        Result

        Raises
        ------
        InputError
            For a scene that was run before, and for input that can't be run or written.
        SolverFailure
            After all is written, if the full load was not reached or a limit is exceeded.
        Interrupted
            After SIGINT or SIGTERM.
        """
        self.check(out.resume if isinstance(out, Output) else resume)
        problem = dict(problem or {"study": self.name, "material": _material(self.scene)})
        if isinstance(out, Output):
            return self._run(out, out.folder(part), problem, pictures)
        comm, is_kept = self.scene.comm, out is not None
        pictures = pictures and is_kept
        temporary = nullcontext(out) if is_kept or comm.rank else tempfile.TemporaryDirectory()
        with all_or_none(comm), temporary as path:  # studies see to that themselves
            how: Any = {"resume": resume, "overwrite": overwrite}
            output = Output(self.name, Path(comm.bcast(path)), comm, **how)
            output.facts["fabric"] = _material(self.scene)
            try:
                return self._run(output, output.folder(part), problem, pictures, is_kept)
            finally:
                output.close()

    def check(self, resume: bool = False) -> None:
        """Raise InputError for a job that can't be run, before anything is written; resume: it goes
        on from a checkpoint."""
        scene = self.scene
        if self.error and not (self.coarser or self.setup.coarser()):
            raise InputError(
                "`error=True` needs a coarser mesh, and none is available; expected a "
                "rectangle of 2 x 2 or more that the program meshes, an outline with 4 cells "
                "across, or `coarser` of a `Job`"
            )
        if resume:
            return
        if scene.was_loaded:
            raise InputError(
                f"the scene of {scene.blank.name} was run before and is not at rest; use a "
                "new scene, with new terms"
            )
        with all_or_none(scene.comm), task("checking the scene"):  # own terms are asked, too
            scene.check_start()

    def _run(self, output, folder, problem, pictures, is_kept=True):
        scene, comm = self.scene, self.scene.comm
        parts = [entries(value, name) for name, value in problem.items()]  # first in messages
        known_by = {k: v for part in parts for k, v in part.items()} | problem | scene.fingerprint()
        checkpoint = Checkpoint(folder / "checkpoint.npz", scene.blank, known_by)
        newton = Newton(scene, self.tolerance, linear_solver=self.linear_solver)
        for each in materials_of(scene, scene.blank.whole):
            if values := ", ".join(map(" = ".join, each.assumed_values().items())):
                output.remark(f"no test has determined these parameters of {each.label}: {values}")
        for words in waves_that_do_not_form(scene):
            output.remark(words)
        start, notes = None, Numbers()
        # a part of several that was not begun yet has no checkpoint
        if output.resume and (folder == output.path or comm.bcast(checkpoint.path.exists())):
            start, notes = checkpoint.load(scene.memory())
            if start.load == 1 and not start.viscosity.drag:
                summary = comm.bcast(read_json(folder / "summary.json"))
                if summary.get("converged"):
                    before = Result(summary, notes["rows"], Fields({}), folder, scene)
                    return self._finished_before(output, before, start, notes, problem, pictures)
        for warning in self.setup.warnings:
            output.warn(warning)
        for doubt in validity.warnings_at_start(scene):
            output.tell(doubt)
        if comm.rank == 0:  # of an earlier run, not of this one
            for name in output.owned.names("summary.json", ".png"):
                if (file := output.path / name).parent == folder:
                    file.unlink()
        states = StateWriter(self, output, checkpoint, notes)
        progress = ProgressLog(states, newton, start.load if start else 0.0)
        watch = LimitWatch(scene, self)
        observers = watch, states, progress, self.setup, *self.observers
        for each in observers:
            each.begin(folder, pictures)
        outcome, stopped = self._step_to_full_load(newton, start, observers)
        result, wrong = self._result(output, outcome, stopped, states, watch.wrong)
        reached = rounded(result.summary["stroke_reached"], 6)
        if stopped:
            hint = "`resume=True` continues from there"
            raise Interrupted(f"{stopped} at load factor {reached}; {hint}")
        if self.error and not wrong:
            self._estimate(output, result, problem, states.series)
        self._show(output, result, pictures)
        if not is_kept:
            if comm.rank == 0:
                assert result.grid  # is read while there is a folder
            result.folder = None
        if wrong:
            where = f"; the run ends at load factor {reached}" if outcome.reached < 1 else ""
            where += f"; the results are in {folder}" if is_kept else ""
            raise SolverFailure(wrong + where, result)
        return result

    def _step_to_full_load(self, newton, start, observers):
        """The `Outcome` of load stepping, and the signal that stopped it, as text, or ""."""
        watch, _, progress, *_ = observers
        signals = StopSignals(self.scene.comm)
        calls: Any = {
            "on_accept": lambda accepted: [each.accept(accepted) for each in observers],
            "on_reject": lambda load, report: [each.reject(load, report) for each in observers],
            "stop": lambda: signals() or watch.reason_to_stop(),
        }
        in_line = shown(False, self.scene.comm.rank == 0)
        try:
            with phase("steps"), in_line, task(progress.doing):
                return LoadStepping(newton, self, start, **calls).run(), signals()
        finally:
            signals.forget()

    @phase("output")
    def _result(self, output, outcome, stopped, states, wrong_now):
        """The `Result` of the last state, whose summary is written, and why it is not valid, ""."""
        scene, rows, folder = self.scene, states.history.rows, states.series.directory
        fields = scene_output.cell_fields(scene)
        if not states.is_written():
            states.series.write(outcome.reached, fields)
        result = Result({}, rows, fields, folder, scene)
        # of the last row, as terms have since updated what they held in its solve
        kinds = {**dict.fromkeys(ENERGIES), **scene.energies()}
        energy = {kind: rows[-1][f"{kind}_energy_Nmm"] for kind in kinds}
        energy["external_work"] = rows[-1]["external_work_Nmm"]
        quantities = self.setup.quantities(result)
        wrong = [*dict.fromkeys([*validity.not_formed(result, self.limits), *wrong_now])]
        wrong += validity.beyond_limits_at_end(scene, self.limits, rows, energy)
        reason = outcome.reason or validity.not_valid(wrong)
        if outcome.reason and not outcome.reason.startswith(NOT_VALID):
            wrong.append(outcome.reason)
            reason = outcome.reason if stopped else "; ".join(wrong[::-1])
        invalid = [Reason(each, verdict=INVALID) for each in wrong]
        found = *validity.doubts(result, energy, quantities), *self.setup.doubts(result)
        for each in (*invalid, *found, *([] if self.error else [validity.NO_ESTIMATE])):
            output.doubt(each)
        result.summary = output.summarise(
            folder,
            converged=not reason,
            stroke_reached=outcome.reached,
            reason=reason or "full load reached",
            **scene_output.sizes(scene),
            **scene_output.summary(scene),
            steps_accepted=outcome.accepted,
            steps_rejected=outcome.rejected,
            newton_iterations=outcome.iterations,
            energy=energy,
            reaction_N=rows[-1]["reaction_N"],
            reaction_is=self.setup.force_name,
            **energy_balance(rows, energy),
            quantities=quantities,
        )
        return result, reason

    def _finished_before(self, output, result, start, notes, problem, pictures):
        """The `Result` of a run whose checkpoint is at full load."""
        scene, folder = self.scene, result.folder
        if scene.comm.rank == 0:
            log.warning("%s: full load was already reached, nothing to do", folder)
        scene.set(start.x)
        scene.set_load(1.0)
        scene.recall(start.memory)
        scene.accept()
        result.fields = scene_output.cell_fields(scene)
        drawn = scene.comm.bcast((folder / "curve.png").exists())  # which is drawn last
        if self.error and "error" not in result.summary:
            drawn = False
            self._estimate(output, result, problem, FieldSeries(folder, scene, notes["states"]))
        self._show(output, result, pictures and not drawn)
        return result

    @task("estimating errors")
    def _estimate(self, output, result, problem, series):
        """Add errors, as a run on a coarser mesh tells them, to result, history.csv, fields and
        summary.json, and doubts if they are large or that run fails."""
        began, folder = time.perf_counter(), result.folder
        reasons = result.summary["reasons"]
        result.summary["reasons"] = [each for each in reasons if each["verdict"] != OK]
        try:
            other = self._run_coarser(output, result, problem)
        except (InputError, SolverFailure) as failure:
            other = getattr(failure, "result", None)  # coarse plies may pass through themselves
            if not other or other.number("stroke_reached") < 1:
                words = f"errors are unknown, because the run on the coarser mesh failed: {failure}"
                output.doubt(Reason(words))
                result.summary = output.amend(folder, result.summary)
                return
        if reason := error.mesh_decides(result):
            output.warn(f"strains have no error estimate, because {reason}")
        how = {"of_other_kind": not self.coarser and self.setup.coarser_is_other_kind}
        how["forces_only"] = bool(reason)
        errors = error.estimate(result, other, self.setup.headlines, **how)
        output.write_table(folder / "history.csv", result.rows)
        facts = {"cells": other.summary["cells"], "steps": other.summary["steps_accepted"]}
        facts |= {"wall_s": round(time.perf_counter() - began, 4)}
        result.summary["error"] = errors
        for doubt in validity.error_doubts(result, self.setup.force_name):
            output.doubt(doubt)
        result.summary = output.amend(folder, result.summary, error=errors, error_run=facts)
        series.write(1.0, result.fields)
        vars(result).pop("grid", None)  # of the file before

    def _run_coarser(self, output, result, problem, name="coarse"):
        """The `Result` of the same run on a coarser mesh, in a subfolder of that `name`."""
        comm = self.scene.comm
        made = self.coarser() if self.coarser else self.setup.coarser().build(comm).job()
        settings = vars(self.coarser_settings(self.setup.fewer_steps))
        job = replace(made, **settings | {"every": 10**9, "error": False})
        cells = scene_output.sizes(job.scene)["cells"]
        output.say(
            f"the error: the same run on {cells} cells instead of {result.summary['cells']}, in "
            f"{job.steps:g} steps"
        )
        folder = output.folder(str((result.folder / name).relative_to(output.path)), is_shown=False)
        known = output.resume and comm.bcast((folder / "checkpoint.npz").exists())
        apart = Output(f"{job.name}, coarser", folder, comm, resume=known, overwrite=not known)
        apart.is_quiet = True
        try:
            return job.run(apart, problem=dict(problem) | {"mesh": name}, pictures=False)
        finally:
            apart.close()

    @phase("output")
    @task("writing tables and pictures")
    def _show(self, output, result, pictures):
        """Draw the last state; at full load observers write their files, too."""
        is_formed = result.summary["stroke_reached"] == 1
        for each in (self.setup, *self.observers) if is_formed else ():
            each.end(result, result.folder)
        if self.scene.comm.rank == 0 and pictures:
            from ..results.pictures import draw_state

            if is_formed:
                self.setup.pictures(result, result.folder)
            draw_state(output.name, result, self.setup.force_name)
        self.scene.comm.barrier()


def _material(scene):
    materials = materials_of(scene, scene.blank.whole)
    return "\n".join(dict.fromkeys(material.dumps() for material in materials))
