"""A job: brings a scene to full load, and keeps what happened on the way."""

import logging
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from petsc4py import PETSc
from tqdm import tqdm

from .. import dolfinx_compat as compat
from ..mechanics.contact.self_crossing import crossing_warning, self_crossings
from ..mechanics.given import entries, of_scene
from ..results.curve import Curves, Measure, default_measure
from ..results.history import ENERGIES, History, check_notes, energy_balance, viscous_words
from ..results.output import Output, read_converged
from ..results.result import LAST_PICTURE, Result, draw_state
from ..runtime import timing
from ..runtime.errors import InputError, Interrupted, SolverFailure
from ..runtime.signals import StopSignals
from ..runtime.together import all_or_none
from ..scene.scene import Scene
from ..solve.checkpoint import Checkpoint
from ..solve.limits import EDGES, Limits
from ..solve.newton import Newton
from ..solve.stepping import Accepted, march

log = logging.getLogger("fabric_fenicsx")
UNBALANCED = 0.02  # of the energies, above which a run warns that its work does not match
NOT_BELIEVED = "the result is not to be believed: "


@dataclass
class Job:
    """Load stepping of `scene` from rest to full load, with history, fields, checkpoint, summary.

    steps: the first load step is 1/steps; max_step: the largest, by default as large. A step that
    fails is halved. balance: share of a step's work that may be missing from the energies, and
    accuracy: of the displacement by which it may leave a straight path, before the step is halved;
    None: any. milestones: load factors to be hit. viscosity: whether steps that halving does not
    mend get a drag, which fades. More is in `solve.stepping.march`.
    tolerance: residual over the forces on the sheet; path_tolerance: a looser one before the full
    load. linear_solver: one of `solve.linear.LINEAR_SOLVERS`. every: accepted steps between states
    written for ParaView. limits: beyond which the result is not believed.
    error: whether errors are estimated from the same run on a mesh twice as coarse; coarser:
    function that makes this job on that mesh; order: that of forces and energies in the size of
    cells, as observed in problems of this kind; headlines: which quantities get errors, those of
    nested ones as "draw_in.largest_mm".
    measure: function of scene and load factor to displacement [mm] and force [N] for the history;
    by default those of the first tool or moving support. quantities: function of a `Result` to
    what the summary says beside the rest; tables, pictures: what to write and draw of it besides.
    warnings: sentences that the run begins with. beside: curves drawn into curve.png besides the
    run's, {label: (displacements [mm], forces [N])}.
    """

    scene: Scene
    steps: float = 20
    max_step: float | None = None
    tolerance: float = 1e-8
    path_tolerance: float | None = 1e-4
    linear_solver: str = "mumps-cholesky"
    viscosity: bool = True
    accuracy: float | None = None
    balance: float | None = None
    every: int = 5
    limits: Limits = field(default_factory=Limits)
    milestones: Sequence[float] = ()
    error: bool = False
    coarser: "Callable[[], Job] | None" = None
    order: float = 1.0
    headlines: Sequence[str] = ()
    measure: Measure | None = None
    quantities: Callable[[Result], dict[str, Any]] | None = None
    tables: Callable[[Result, Path], None] | None = None
    pictures: Callable[[Result, Path], None] | None = None
    warnings: Iterable[str] = ()
    beside: Curves = field(default_factory=dict)
    name: str = "job"

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
        """Run on all ranks; a `Result`.

        out: the folder, None to keep no files; part: subfolder. resume: go on from the checkpoint
        there, on any number of ranks; overwrite: lose the results there. problem: what a
        checkpoint must agree in to be gone on from, besides the numbers of terms and supports.
        Functions and large arrays that terms hold, and the code of own ones, are not compared.

        Raises InputError for input that can't be run or written, SolverFailure, after all is
        written, if the full load was not reached or the result is beyond the limits, and
        Interrupted after SIGINT or SIGTERM.
        """
        if self.error and not self.coarser:
            raise InputError(
                "`error=True` needs a mesh twice as coarse, and none is known; allowed is a "
                "rectangle of 2 x 2 or more that the program meshes, or `coarser` of a `Job`"
            )
        resume = out.resume if isinstance(out, Output) else resume
        if not resume:  # before anything is written
            self.scene.check_start()
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
        from ..results.fields import FieldSeries  # pyvista takes longer to import than a coarse run

        scene, comm = self.scene, self.scene.comm
        problem = dict(problem or {"study": self.name, "material": _material(scene)})
        parts = [entries(value, name) for name, value in problem.items()]  # which are told first
        known_by = {k: v for part in parts for k, v in part.items()} | problem | of_scene(scene)
        checkpoint = Checkpoint(folder / "checkpoint.npz", scene.blank, known_by)
        newton = Newton(scene, self.tolerance, linear_solver=self.linear_solver)
        start, notes = None, dict[str, Any](rows=[], states=[])
        # a part of several that was not begun yet has no checkpoint
        if output.resume and (folder == output.path or comm.bcast(checkpoint.path.exists())):
            start, notes = checkpoint.load(scene.memory(), newton.memory())
            check_notes(notes, checkpoint.path)
        if start and start.load == 1 and not start.viscosity.drag:
            known = read_converged(folder / "summary.json") if comm.rank == 0 else None
            if known := comm.bcast(known):
                return self._finished_before(output, folder, start, notes, known, problem, pictures)
        for warning in self.warnings:
            output.warn(warning)
        output.warn(scene.check_held())
        if scene.blank.mesh.geometry.dim == 3:  # strips do without the tools' modules
            from ..mechanics.contact.tool_warnings import tool_warnings

            for warning in tool_warnings(scene):
                output.warn(warning)
        if comm.rank == 0:
            for old in [folder / "summary.json", *folder.glob("*.png")]:
                old.unlink(missing_ok=True)  # of an earlier run, not of this one
        history = History(folder / "history.csv", comm, notes["rows"])
        with timing.phase("output"):
            series = FieldSeries(folder, scene, notes["states"])
        measure = self.measure or default_measure(scene)
        bar = tqdm(
            total=1.0,
            initial=start.load if start else 0.0,
            desc=folder.name if folder != output.path else output.name,
            disable=None if comm.rank == 0 else True,
            bar_format="{l_bar}{bar}| load {n:.3f} [{elapsed}<{remaining}{postfix}]",
        )
        wrong_now: list[str] = []  # what is wrong with the last accepted state

        def accept(accepted: Accepted) -> None:
            if not accepted.load and any(term.prestressed for term in scene.terms):
                moved = scene.u.norm(PETSc.NormType.NORM_INFINITY)
                output.say(
                    "at rest in its supports, before load, the sheet has moved by up to "
                    f"{moved:.3g} mm"
                )
            wrong_now[:] = self._beyond_limits()
            measured = measure(scene, accepted.load)
            with timing.phase("output"):
                history.add(accepted, *measured, scene.history)
                if len(history.rows) == 1:
                    scene.summary()  # so that names given twice are refused now, not at the end
            output.warn(viscous_words(history.rows, accepted.load))
            bar.update(accepted.load - bar.n)
            step, energy = accepted.progress.step, sum(accepted.energies.values())
            iterations = accepted.report.iterations
            words = f"step {step:.3g}, iterations {iterations}, energy {energy:.4g} N mm"
            bar.set_postfix_str(words, refresh=False)
            if comm.rank == 0:
                log.debug("load %.6g accepted: %s", accepted.load, words)
            with timing.phase("output"):
                if (len(history.rows) - 1) % self.every == 0:
                    series.write(accepted.load)
                kept = {"rows": history.rows, "states": series.states}
                checkpoint.save(accepted.progress, kept)

        def reject(load, report):
            if comm.rank == 0:
                log.warning(
                    "step to load %.6g rejected after %d iterations: %s",
                    load,
                    report.iterations,
                    report.reason,
                )

        signals = StopSignals(comm)
        try:
            outcome = march(
                newton,
                self.steps,
                self.max_step,
                on_accept=accept,
                on_reject=reject,
                start=start,
                milestones=self.milestones,
                viscosity=self.viscosity,
                accuracy=self.accuracy,
                balance=self.balance,
                path_tolerance=self.path_tolerance,
                stop=lambda: signals() or _not_believed(wrong_now),
            )
        finally:
            signals.forget()
            bar.close()
            history.close()
        with timing.phase("output"):
            fields = scene.cell_fields()
            if (len(history.rows) - 1) % self.every:
                series.write(outcome.reached, fields)
        result = Result({}, history.rows, fields, folder, scene)
        energy = self._energy(history.rows)
        wrong = outcome.reason or _not_believed(
            wrong_now + self._unbelievable(output, result, energy)
        )
        for warning in scene.warnings():
            output.warn(warning)
        result.summary = output.summarise(
            folder,
            converged=not wrong,
            stroke_reached=outcome.reached,
            reason=wrong or "full load reached",
            **self._facts(),
            steps_accepted=outcome.accepted,
            steps_rejected=outcome.rejected,
            newton_iterations=outcome.iterations,
            energy=energy,
            reaction_N=history.rows[-1]["reaction_N"],
            **energy_balance(history.rows, energy),
            quantities=self.quantities(result) if self.quantities else {},
        )
        if words := signals():
            raise Interrupted(
                f"{words} at load factor {outcome.reached:.6g}; `resume=True` goes on from there"
            )
        if self.error and not wrong:
            self._estimate(output, result, problem, series)
        self._show(output, result, pictures)
        if not output.is_kept:
            result.forget_folder()
        if wrong:
            raise SolverFailure(wrong + output.where(folder), result)
        return result

    def _estimate(self, output, result, problem, series):
        """Add to result, history.csv, fields and summary.json how far they are off."""
        from .error_run import estimated

        facts = estimated(self, result, output, problem)
        result.summary = output.amend(result.folder, result.summary, **facts)
        if facts:
            series.write(1.0, result.fields)
            result.forget_grid()

    def _show(self, output, result, pictures):
        """Draw the last state; of a run that reached its end write the tables and pictures, too."""
        reached = result.summary["converged"]
        if self.tables and reached:
            self.tables(result, result.folder)
        if self.scene.comm.rank == 0 and pictures:
            if self.pictures and reached:
                self.pictures(result, result.folder)
            draw_state(output.name, result, result.folder, self.beside)
        self.scene.comm.barrier()

    def _finished_before(self, output, folder, start, notes, summary, problem, pictures):
        """The `Result` of a run whose checkpoint is at full load."""
        from ..results.fields import FieldSeries

        scene = self.scene
        if scene.comm.rank == 0:
            log.warning("%s: full load was reached before, nothing is left to do", folder)
        scene.set(start.x)
        scene.at(1.0)
        fields = scene.cell_fields()
        result = Result(summary, notes["rows"], fields, folder, scene)
        drawn = scene.comm.bcast((folder / LAST_PICTURE).exists())
        if self.error and "error" not in summary:
            drawn = False
            self._estimate(output, result, problem, FieldSeries(folder, scene, notes["states"]))
        self._show(output, result, pictures and not drawn)
        return result

    def _facts(self):
        """What the scene is, for the summary."""
        blank = self.scene.blank
        kind = "P" if compat.cell_name(blank.mesh) == "triangle" else "Q"
        return {
            "element": f"{kind}{blank.degree}",
            "dofs": blank.V.dofmap.index_map.size_global * blank.mesh.geometry.dim,
            "cells": blank.mesh.topology.index_map(2).size_global,
            **self.scene.summary(),
        }

    def _energy(self, rows):
        """Energies of the last state by kind, and the work done [N mm]: those of its row, as terms
        have since taken anew what they held in its solve."""
        kinds = {**dict.fromkeys(ENERGIES), **self.scene.energies()}
        work = {"external_work": rows[-1]["external_work_Nmm"]}
        return {kind: rows[-1][f"{kind}_energy_Nmm"] for kind in kinds} | work

    def _unbelievable(self, output, result, energy):
        """What is wrong with the run as a whole, a sentence each; warns of what may be."""
        untouched = ""
        if self.scene.tools():
            from ..mechanics.contact.tool_warnings import untouched_warning

            untouched = untouched_warning(self.scene)
        output.warn(untouched)
        output.warn(crossing_warning(self.scene.blank))
        if not (untouched or any(energy.values()) or self.scene.u.norm()):
            output.warn(
                "nothing moves or loads the sheet: it stays as it was; a tool, a load or a support "
                "that moves would, as `clamped_ends(stroke)`"
            )
        balance = energy_balance(result.rows, energy)
        if branches := ", ".join(f"{load:.6g}" for load in balance["branches"]):
            output.warn(
                f"the path branches at load {branches}: the equilibrium there was a saddle, and "
                "one of the ways down was taken; others may lead to other results"
            )
        below = [kind for kind in energy if kind != "external_work" and energy[kind] < 0]
        if balance["energy_imbalance"] > UNBALANCED:
            cause = "take smaller steps (`max_step`), unless the sheet snapped"
            if below:
                told = " and ".join(f"{kind} {energy[kind]:.3g} N mm" for kind in below)
                cause = f"what should resist drives the sheet, as energies are below 0: {told}"
            output.warn(
                "work of supports and tools and stored energy differ by "
                f"{100 * balance['energy_imbalance']:.3g} %; {cause}"
            )
        # of stretching; kinds that only some terms have are its too, as of metal
        kept = energy["strain"] + sum(
            value for kind, value in energy.items() if kind not in (*ENERGIES, "external_work")
        )
        viscous = energy["viscous"] / max(abs(kept), 1e-300)
        found = {"imbalance": balance["energy_imbalance"], "viscous": viscous}
        return self.limits.exceeded(found) + self._passed_through()

    def _passed_through(self):
        """A sentence for each sheet that has passed through itself, which nothing resists."""
        blank = self.scene.blank
        found = {part: self_crossings(part) for part in blank.parts.values() or [blank.whole]}
        return [
            f"sheet {part.name or blank.name} passes through itself at {len(places)} places, as at "
            f"({', '.join(f'{x:.4g}' for x in places[0])}) mm; allowed is none, as contact of a "
            "sheet with itself is not modelled"
            for part, places in found.items()
            if len(places)
        ]

    def _beyond_limits(self):
        """What no later state mends, a sentence each: tools too deep in the sheet, and yarns
        stretched too far."""
        limit, scene = self.limits.strain, self.scene
        found = {"penetration": scene.penetration_of_thickness()}
        if wrong := self.limits.exceeded(found):
            wrong = [f"{wrong[0]}; deepest is {scene.where_deepest()}"]
        over = scene.overstretched(limit)
        if over > EDGES:
            wrong.append(
                f"yarns are stretched by more than {100 * limit:.3g} % in {100 * over:.3g} % of "
                f"the sheet; allowed is {100 * EDGES:.3g} % of it (`Limits.strain`)"
            )
        return wrong


def _material(scene):
    """What a scene's terms are made of as material files' texts, "" of nothing."""
    return "\n".join(dict.fromkeys(text for term in scene.terms if (text := term.material())))


def _not_believed(wrong):
    return NOT_BELIEVED + "; ".join(wrong) if wrong else ""
