"""A job: brings a scene to full load, and keeps what happened on the way."""

import logging
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..mechanics.fingerprint import entries
from ..mechanics.materials import materials_of
from ..mechanics.output import Fields
from ..results.curve import Curves, Measure
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

log = logging.getLogger("fabric_fenicsx")


@dataclass(frozen=True, kw_only=True)
class Job(Settings):
    """Load stepping of a scene from rest to full load, with history, fields and checkpoint.

    Parameters
    ----------
    scene : Scene
        At rest, with new terms.
    steps, max_step, tolerance, path_tolerance, viscosity, ...
        Keywords of the solver, the fields of `Settings`.
    error : bool
        Estimate errors from the same run on two meshes, each twice as coarse.
    coarser : callable, optional
        Function that makes this job on a mesh twice as coarse.
    headlines : sequence of str
        Quantities that get errors, nested ones as "draw_in.largest_mm".
    measure : callable, optional
        Function of scene and load factor to displacement [mm] and force [N] of the history, by
        default of the first tool or support that moves.
    stage : callable, optional
        Function of the load factor to the name of the stage under way there.
    columns : callable, optional
        Function of the scene to more columns of the history {name: value}, on all ranks.
    force_name : str
        What the force is called.
    modelled : float
        Share of the sheet that symmetry leaves; the history has the force on the whole one, too.
    quantities : callable, optional
        Function of a `Result` to further entries of the summary.
    tables, pictures : callable, optional
        Functions of a `Result` and its folder that write and draw besides.
    first_picture : callable, optional
        Function that draws into the folder before the run, on all ranks.
    warnings : iterable of str
        Sentences with which the run begins.
    beside : mapping
        Curves drawn into curve.png as well {label: (displacements [mm], forces [N])}.
    name : str
        Of the study in the summary.

    Examples
    --------
    >>> sheet = ff.Blank.rectangle(40, 20, nx=2, element="P1")
    >>> scene = ff.Scene(sheet, [ff.Membrane(ff.load("komeili"))], ff.clamped_ends(0.4))
    >>> result = ff.Job(scene, steps=2).run()
    >>> [row["load"] for row in result.rows]
    [0.0, 0.5, 1.0]
    """

    scene: Scene = field(kw_only=False)
    error: bool = False
    coarser: Callable[[], Any] | None = None
    headlines: Sequence[str] = ()
    measure: Measure | None = None
    stage: Callable[[float], str] | None = None
    columns: Callable[[Scene], dict[str, float]] | None = None
    force_name: str = "reaction"
    modelled: float = 1.0
    quantities: Callable[[Result], dict[str, Any]] | None = None
    tables: Callable[[Result, Path], None] | None = None
    pictures: Callable[[Result, Path], None] | None = None
    first_picture: Callable[[Path], None] | None = None
    warnings: Iterable[str] = ()
    beside: Curves = field(default_factory=dict)
    name: str = "job"

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
        if self.error and not self.coarser:
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
                known = read_summary(folder / "summary.json") if comm.rank == 0 else {}
                if (known := comm.bcast(known)).get("converged"):
                    before = Result(known, notes["rows"], Fields({}), folder, scene)
                    return self._finished_before(output, before, start, notes, problem, pictures)
        run = Run(self, output, folder, newton, checkpoint, start, notes)
        if self.first_picture and pictures:
            self.first_picture(folder)
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
            whole = result.summary["stroke_reached"] == 1
            raise SolverFailure(run.wrong + output.where(folder, whole), result)
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
        if self.tables and reached:
            self.tables(result, result.folder)
        if self.scene.comm.rank == 0 and pictures:
            from ..plot.pictures import draw_state

            if self.pictures and reached:
                self.pictures(result, result.folder)
            draw_state(output.name, result, result.folder, self.beside, self.force_name)
        self.scene.comm.barrier()


def _material(scene):
    """Materials of a scene's terms as texts of files, "" of none."""
    known = materials_of(scene, scene.blank.whole)
    return "\n".join(dict.fromkeys(material.dumps() for material in known))
