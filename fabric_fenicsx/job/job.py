"""A job: brings a scene to full load, and keeps what happened on the way."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..mechanics.fingerprint import entries
from ..mechanics.materials import materials_of
from ..mechanics.output import Fields
from ..results.output import Output
from ..results.quantities import waves_that_do_not_form
from ..results.result import Result
from ..runtime.collective_errors import all_or_none
from ..runtime.errors import InputError, Interrupted, SolverFailure
from ..runtime.files import read_summary
from ..runtime.formatting import rounded
from ..runtime.status import task
from ..runtime.timing import phase
from ..scene import output as scene_output
from ..scene.scene import Scene
from ..solve.checkpoint import Checkpoint
from ..solve.newton import Newton
from ..solve.settings import Settings
from .error_run import estimated
from .run import Run
from .setup import Setup

log = logging.getLogger("fabric_fenicsx")


@dataclass(frozen=True, kw_only=True)
class Job(Settings):
    """Load stepping of a scene from rest to full load, with history, fields and checkpoint.

    Parameters
    ----------
    setup : Scene or Setup
        A scene at rest, with new terms; or one with what is measured, written and drawn of it.
    steps, max_step, tolerance, path_tolerance, viscosity, ...
        Keywords of the solver, the fields of `Settings`.
    error : bool
        Estimate errors from the same run on a coarser mesh.
    coarser : callable, optional
        Function that makes this job on a mesh twice as coarse, by default as the `Setup` says.

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

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.setup, Scene):
            object.__setattr__(self, "setup", Setup(self.setup))

    @property
    def scene(self) -> Scene:
        """The scene that it runs."""
        return self.setup.scene

    @property
    def name(self) -> str:
        """Of the study in the summary."""
        return self.setup.name

    def on_coarser_mesh(self) -> Job | None:
        """The same job on a coarser mesh, None if none is known."""
        if self.coarser:
            return self.coarser()
        data = self.setup.coarser()
        return data and data.build(self.scene.comm).job()

    @phase("setup")
    def run(
        self,
        out: Output | Path | str | None = None,
        part: str = "",
        *,
        resume: bool = False,
        overwrite: bool = False,
        pictures: bool = True,
        problem: Mapping[str, Any] | None = None,
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
        if self.error and not (self.coarser or self.setup.coarser()):
            raise InputError(
                "`error=True` needs a mesh twice as coarse, and none is known; allowed is a "
                "rectangle of 2 x 2 or more that the program meshes, an outline with 4 cells "
                "across, or `coarser` of a `Job`"
            )
        resume = out.resume if isinstance(out, Output) else resume
        if self.scene.was_loaded and not resume:
            raise InputError(
                f"the scene of {self.scene.blank.name} was run before and is not at rest; allowed "
                "is a new scene, with new terms"
            )
        if not resume:  # before anything is written
            # as terms are asked, own ones too
            with all_or_none(self.scene.comm), task("checking the scene"):
                self.scene.check_start()
        problem = dict(problem or {"study": self.name, "material": _material(self.scene)})
        if isinstance(out, Output):
            return self._run(out, out.folder(part), problem, pictures)
        comm, is_kept = self.scene.comm, out is not None
        temporary = nullcontext(out) if is_kept or comm.rank else tempfile.TemporaryDirectory()
        with all_or_none(comm), temporary as path:  # studies see to that themselves
            output = Output(
                self.name, Path(comm.bcast(path)), comm, resume=resume, overwrite=overwrite
            )
            output.is_kept = is_kept
            output.facts["fabric"] = _material(self.scene)
            try:
                return self._run(output, output.folder(part), problem, pictures and is_kept)
            finally:
                output.close()

    def _run(self, output, folder, problem, pictures):
        scene, comm = self.scene, self.scene.comm
        parts = [entries(value, name) for name, value in problem.items()]  # first in messages
        known_by = {k: v for part in parts for k, v in part.items()} | problem | scene.fingerprint()
        checkpoint = Checkpoint(folder / "checkpoint.npz", scene.blank, known_by)
        newton = Newton(scene, self.tolerance, linear_solver=self.linear_solver)
        for material in materials_of(scene, scene.blank.whole):
            output.say_assumed(material.label, material.assumed_values())
        if not output.is_quiet:
            for words in waves_that_do_not_form(scene):
                output.say(words)
        start, notes = None, dict[str, Any]()
        # a part of several that was not begun yet has no checkpoint
        if output.resume and (folder == output.path or comm.bcast(checkpoint.path.exists())):
            start, notes = checkpoint.load(scene.memory())
            if start.load == 1 and not start.viscosity.drag:
                summary = read_summary(folder / "summary.json") if comm.rank == 0 else {}
                if (summary := comm.bcast(summary)).get("converged"):
                    before = Result(summary, notes["rows"], Fields({}), folder, scene)
                    return self._finished_before(output, before, start, notes, problem, pictures)
        run = Run(self, output, folder, newton, checkpoint, start, notes)
        if pictures:
            self.setup.first_picture(folder)
        result = run.to_full_load()
        if run.stopped:
            reached = result.summary["stroke_reached"]
            raise Interrupted(
                f"{run.stopped} at load factor {rounded(reached, 6)}; `resume=True` goes on from "
                "there"
            )
        if self.error and not run.wrong:
            self._estimate(output, result, problem, run.series)
        self._show(output, result, pictures)
        if not output.is_kept:
            result.forget_folder()
        if run.wrong:
            where = output.where(folder, result.summary["stroke_reached"])
            raise SolverFailure(run.wrong + where, result)
        return result

    def _finished_before(self, output, result, start, notes, problem, pictures):
        """The `Result` of a run whose checkpoint is at full load."""
        from ..plot.pictures import LAST_PICTURE
        from ..results.fields import FieldSeries

        scene, folder = self.scene, result.folder
        if scene.comm.rank == 0:
            log.warning("%s: full load was reached before, nothing is left to do", folder)
        scene.set(start.x)
        scene.set_load(1.0)
        scene.recall(start.memory)
        scene.accept()
        result.fields = scene_output.cell_fields(scene)
        drawn = scene.comm.bcast((folder / LAST_PICTURE).exists())
        if self.error and "error" not in result.summary:
            drawn = False
            self._estimate(output, result, problem, FieldSeries(folder, scene, notes["states"]))
        self._show(output, result, pictures and not drawn)
        return result

    @task("estimating errors")
    def _estimate(self, output, result, problem, series):
        """Add errors to result, history.csv, fields and summary.json."""
        facts = estimated(self, result, output, problem)
        result.summary = output.amend(result.folder, result.summary, **facts)
        if facts:
            series.write(1.0, result.fields)
            result.forget_grid()

    @phase("output")
    @task("writing tables and pictures")
    def _show(self, output, result, pictures):
        """Draw the last state; of a run that reached its end write the tables and pictures, too."""
        reached = result.summary["stroke_reached"] == 1
        if reached:
            self.setup.tables(result, result.folder)
        if self.scene.comm.rank == 0 and pictures:
            from ..plot.pictures import draw_state

            if reached:
                self.setup.pictures(result, result.folder)
            beside, force_name = self.setup.reference_curves(), self.setup.force_name()
            draw_state(output.name, result, result.folder, beside, force_name)
        self.scene.comm.barrier()


def _material(scene):
    """Materials of a scene's terms as texts of files, "" of none."""
    materials = materials_of(scene, scene.blank.whole)
    return "\n".join(dict.fromkeys(material.dumps() for material in materials))
