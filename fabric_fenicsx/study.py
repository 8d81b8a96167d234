"""What every study script shares: its options, its run from a scene to results, and how it ends."""

import csv
import dataclasses
import json
import logging
import math
import platform
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import dolfinx
import numpy as np
import petsc4py
from mpi4py import MPI
from petsc4py import PETSc
from tqdm import tqdm

from . import __version__, doubts, timing
from . import dolfinx_compat as compat
from .blank import Blank
from .cli import ANY, BETWEEN_YARNS, COUNT, POSITIVE, Help, Parser, command, exit_status, number
from .errors import InputError, Interrupted, SolverFailure
from .material.baseline import Fabric
from .material.parameters import COUPLINGS, WovenFabric
from .material.presets import load
from .mechanics.membrane import INTEGRATION, Membrane
from .meshes.specimen import PATTERNS, specimen
from .results.history import COLUMNS, ENERGIES, History
from .results.measures import areas
from .running import LOCK, Asked, Console, LogFile, hold, replace
from .scene import Scene, Support
from .solve.checkpoint import Checkpoint
from .solve.limits import EDGES, Limits
from .solve.newton import LINEAR_SOLVERS, Newton
from .solve.stepping import march

log = logging.getLogger(__package__)
RESULTS = "summary.json", "history.csv", "checkpoint.npz", "done.json"  # by which a folder is known to hold a run's
VISCOUS = 0.01  # of the strain energy, above which a run warns of what the regularisation took
NOT_BELIEVED = "the result is not to be believed: "
UNBALANCED = 0.02  # of the energies, above which a run warns that its work does not match
FITS = 1e-3  # of a length, by which an own mesh may differ from the options
PHASES = ("setup", "compile", "assemble", "linear_solve", "output")
QUICK = {"nx": 20, "steps": 5}
# with P2 and --path-tolerance 1e-4 the cheapest of studies/speed_vs_error.py with curves right to 0.1 %, in tension and bias
FULL = {"nx": 32, "steps": 20}


def parser(
    name: str, description: str | None, full: dict[str, int] = FULL, quick: dict[str, int] = QUICK, **defaults: Any
) -> Parser:
    """The parser of study `name` with the options that all studies share; `defaults` override theirs, `full` and `quick`
    those of mesh and steps without and with --quick."""
    p = Parser(prog=f"studies/{name}.py", description=description, formatter_class=Help, allow_abbrev=False)
    mesh = p.add_argument_group("mesh")
    mesh.add_argument(
        "--mesh", metavar="FILE", help="own blank, any gmsh or meshio file [mm]; otherwise a rectangle is meshed"
    )
    mesh.add_argument(
        "--nx", type=COUNT, help=f"rectangles along the length ({full['nx']}, with --quick {quick['nx']})"
    )
    mesh.add_argument("--ny", type=COUNT, help="rectangles across the width (as makes them square)")
    mesh.add_argument(
        "--pattern",
        choices=PATTERNS,
        default="crossed",
        help="how rectangles become cells (crossed, in bias tests up to 20 %% graded)",
    )
    mesh.add_argument(
        "--element", choices=("P1", "P2", "P3", "Q1", "Q2"), default="P2", help="P: triangles, Q: quadrilaterals"
    )
    mesh.add_argument(
        "--integration",
        choices=INTEGRATION,
        default="full",
        help="reduced: on P2 triangles the law at their centres, for cells that don't follow the yarns (full; in bias tests as the cells do)",
    )
    mesh.add_argument("--fibre-angle", type=ANY, metavar="DEG", default=0.0, help="of yarns a from the length")
    material = p.add_argument_group("material")
    material.add_argument("--material", metavar="FILE|PRESET", default="komeili")
    material.add_argument(
        "--model", choices=("hyperelastic", "fabric"), default="hyperelastic", help="fabric: the decoupled baseline"
    )
    material.add_argument(
        "--without", metavar="COUPLING", action="append", default=[], help=f"turn off one of {', '.join(COUPLINGS)}"
    )
    solver = p.add_argument_group("solver")
    solver.add_argument("--steps", type=COUNT, help=f"load steps ({full['steps']}, with --quick {quick['steps']})")
    solver.add_argument(
        "--max-step",
        type=number("a load factor above 0 and up to 1", lambda v: 0 < v <= 1),
        help="largest load step (1/steps)",
    )
    solver.add_argument(
        "--tolerance",
        type=number("a number above 0 and below 1", lambda v: 0 < v < 1),
        default=1e-8,
        help="residual over reaction",
    )
    solver.add_argument(
        "--path-tolerance",
        type=number("a number above 0 and below 1", lambda v: 0 < v < 1),
        default=1e-4,
        help="a looser one before the full load; the curve is as good as this",
    )
    solver.add_argument(
        "--viscosity", choices=("auto", "off"), default="auto", help="auto: a drag on the nodes in steps that fail"
    )
    solver.add_argument(
        "--accuracy",
        type=POSITIVE,
        help="largest distance of a state from its extrapolation, of the displacement; limits steps where the path matters",
    )
    believed = p.add_argument_group("limits, beyond which a result is not believed (exit status 3)")
    for each in dataclasses.fields(Limits):
        believed.add_argument(f"--max-{each.name}", type=POSITIVE, default=each.default, help=each.metadata["help"])
    solver.add_argument("--linear-solver", choices=tuple(LINEAR_SOLVERS), default="mumps-cholesky")
    output = p.add_argument_group("output")
    output.add_argument("--out", metavar="DIR", type=Path, default=Path("results") / name)
    output.add_argument("--every", type=COUNT, default=5, help="accepted steps between states written for ParaView")
    output.add_argument(
        "--resume", action="store_true", help="go on from the checkpoint in --out, on any number of ranks"
    )
    output.add_argument("--overwrite", action="store_true", help="lose the results that --out holds")
    output.add_argument("--no-pictures", action="store_true")
    output.add_argument("--quick", action="store_true", help="coarse mesh and few steps")
    output.add_argument("--verbose", action="store_true", help="print each Newton iteration, as log.txt has them")
    p.set_defaults(_sizes={False: full, True: quick}, **{"yarn_angle": 90.0, "weave_angle": None} | defaults)
    return p


def add_weave_options(p: Parser) -> None:
    """Add the options for yarns that are not orthogonal and for shear that counts from the weave's own angle."""
    weave = p.add_argument_group("weave")
    weave.add_argument(
        "--yarn-angle",
        type=BETWEEN_YARNS,
        metavar="DEG",
        default=90.0,
        help="from yarns a to yarns b as the ply lies",
    )
    weave.add_argument(
        "--weave-angle",
        type=BETWEEN_YARNS,
        metavar="DEG",
        help="between the yarns of the weave without shear (that in which the ply lies)",
    )


@dataclass
class Result:
    """A finished run: its `summary` (as in summary.json), `rows` of the history, `fields` (this rank's cells) and
    the `folder` they were written to."""

    summary: dict[str, Any]
    rows: list[dict[str, Any]]
    fields: dict[str, np.ndarray]
    folder: Path


class Study:
    """A study under way: parsed options `args`, `fabric`, `comm`.

    Construction checks options and material as a whole; it raises InputError on all ranks before anything is written.
    """

    def __init__(self, name: str, options: Parser, argv: list[str] | None = None) -> None:
        self.name, self.comm = name, MPI.COMM_WORLD
        argv = sys.argv[1:] if argv is None else argv
        if self.comm.rank != 0 and {"-h", "--help"} & set(argv):
            sys.exit(0)
        self.args = args = options.parse_args(argv)
        for option, value in vars(args).pop("_sizes")[args.quick].items():
            if getattr(args, option) is None:
                setattr(args, option, value)
        if args.mesh and not Path(args.mesh).is_file():
            raise InputError(
                f"--mesh {args.mesh} is not there or not a file; allowed is any mesh that gmsh or meshio writes"
            )
        if args.resume and args.overwrite:
            raise InputError("--resume and --overwrite are both given; allowed is one of them")
        fabric = load(args.material)
        self.fabric = (fabric.decoupled() if args.model == "fabric" else fabric).without(*args.without)
        self._started, self._begun = time.perf_counter(), False
        self._given = {word.partition("=")[0] for word in argv}  # options, and what follows them
        self._warnings: list[str] = []
        self._said: set[str] = set()  # warnings, of all parts
        self._held: IO | None = None  # what keeps other runs out of --out
        self._parts: list[str] = []  # subfolders of the output
        self._done: dict[str, dict[str, Any]] = {}
        log.handlers.clear()
        log.setLevel(logging.DEBUG)
        log.propagate = False
        if self.comm.rank == 0:
            log.addHandler(Console(logging.DEBUG if args.verbose else logging.INFO))

        for doubt in fabric.doubts() if isinstance(fabric, WovenFabric) else ():
            self.warn(doubt)

    def say(self, text: str) -> None:
        """Print on rank 0, and to log.txt."""
        if self.comm.rank == 0:
            log.info(text)

    def warn(self, text: str) -> None:
        """Say once, on rank 0, what should be looked at though it ends no run; summary and report repeat it. "" is nothing."""
        if text and text not in self._warnings:
            self._warnings.append(text)
        if text and self.comm.rank == 0 and text not in self._said:
            log.warning("warning: %s", text)
        self._said.add(text)

    def once(self, key: str, make: Callable[[], Any]) -> Any:
        """What make() gives, which JSON must hold; of a run that is resumed, what it gave there."""
        if not self._done:
            self._done = self._read_done()
        if key not in self._done["done"]:
            self._done["done"][key] = make()
            if self.comm.rank == 0:
                replace(self.args.out / "done.json", json.dumps(self._done))
        return self._done["done"][key]

    def _read_done(self):
        """What the run that is resumed had done; raises InputError if it was another problem's."""
        path, now, found = self.folder() / "done.json", json.loads(json.dumps(self._problem(self.fabric))), None
        if self.comm.rank == 0 and self.args.resume and path.is_file():
            try:
                found = json.loads(path.read_text())
                found = {name: dict(found[name]) for name in ("problem", "done")}
            except (ValueError, TypeError, KeyError) as e:
                found = f"{path} cannot be read ({type(e).__name__}: {e}); allowed is one that a study wrote"
        found = self.comm.bcast(found) or {"problem": now, "done": {}}
        if isinstance(found, str):
            raise InputError(found)
        for name, value in now.items():
            if found["problem"].get(name) != value:
                raise InputError(
                    f"{path} was made with {name} = {found['problem'].get(name)}, now it is {value}; allowed is the same problem"
                )
        return found

    def write_table(self, path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write rows, dicts, to a CSV file with a column for each of their keys, on rank 0."""
        if self.comm.rank == 0:
            with open(path, "w", newline="") as file:
                writer = csv.DictWriter(file, dict.fromkeys(key for row in rows for key in row))
                writer.writeheader()
                writer.writerows(rows)

    def folder(self, part: str = "") -> Path:
        """Make the output folder, or its subfolder `part`; raises InputError if it can't be written to, if another run uses
        it, or if it holds results that are neither to be gone on with nor to be lost."""
        path = self.args.out / part
        error = self.comm.bcast(self._make(path) if self.comm.rank == 0 else None)
        if error:
            raise InputError(error)
        self._begun = True
        if part and part not in self._parts:
            self._parts.append(part)
        return path

    def _make(self, path):
        """Make the folder, and what is written all through a run in --out, which it then holds; what is wrong with it."""
        args, out = self.args, self.args.out
        used = f"--out {out} is in use by another run; allowed is another folder, or this one when that run has ended"
        old = [] if self._held else self._results()
        if not self._held and args.resume and not {"checkpoint.npz", "done.json"} & {file.name for file in old}:
            return f"--resume finds no checkpoint in {path}; allowed is the --out of a run that was begun"
        try:
            if old and not (args.resume or args.overwrite):
                if (out / LOCK).exists() and not hold(out):
                    return used
                return f"--out {out} holds results ({old[0].relative_to(out)}); allowed is another folder, --resume to go on with them, --overwrite to lose them"
            path.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=path):
                pass
            if not self._held:
                self._held = hold(out)
                if not self._held or self._results() != old:  # begun, or even ended, since they were looked for
                    return used
                if args.overwrite:
                    for file in (*old, *out.glob("*.png"), out / "report.html"):
                        file.unlink(missing_ok=True)
                log.addHandler(LogFile(out / "log.txt", "a" if args.resume else "w", command(self.comm.size)))
        except OSError as e:
            return f"--out {path} can't be written to ({e.strerror}); allowed is a folder that is there or can be made"
        return None

    def _results(self):
        """Files in --out by which it is known to hold results."""
        out = self.args.out
        return [file for name in RESULTS for file in (*out.glob(name), *out.glob(f"*/{name}"))]

    def specimen(
        self, length: float, width: float, turned: float = 0.0, spatial: bool = False, centred: bool = False
    ) -> Blank:
        """Rectangular blank of the options' mesh (or --mesh), with yarns a at --fibre-angle to its length.

        turned: angle from x to the length [rad]; the blank's frame is then its length and width. spatial: free to leave
        its plane; centred: about the origin, which otherwise is a corner.
        """
        args = self.args
        cell = "triangle" if args.element[0] == "P" else "quadrilateral"
        options: dict[str, Any] = {"a": math.radians(args.fibre_angle) + turned, "degree": int(args.element[1])}
        axes = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
        if turned:
            options["frame"] = axes
        if args.yarn_angle != 90:
            options["b"] = options["a"] + math.radians(args.yarn_angle)
        source = f"--mesh {args.mesh}" if args.mesh else "the specimen"
        with timing.phase("setup"):
            points = cells = kind = None
            if args.mesh:
                blank = Blank.read(self.comm, args.mesh, spatial=spatial, **options)
            else:
                if self.comm.rank == 0:
                    ny = args.ny or max(1, round(args.nx * width / length))
                    yarns = math.radians(args.fibre_angle)
                    points, cells, kind = specimen(length, width, args.nx, ny, args.pattern, cell, yarns)
                    points[:, :2] = (points[:, :2] - (np.array([length, width]) / 2 if centred else 0.0)) @ axes
                blank = Blank.from_arrays(self.comm, points, cells, kind, source=source, spatial=spatial, **options)
        if blank.mesh.geometry.dim == 3 and not spatial:
            raise InputError(f"{source} is not plane in z; allowed in this study is a sheet in a plane z = const")
        if compat.cell_name(blank.mesh) != cell:
            raise InputError(
                f"--element {args.element} does not fit the cells of {source}; allowed is P on triangles, Q on quadrilaterals"
            )
        for doubt in (*blank.doubts, doubts.of_size(blank, self.fabric.thickness, source)):
            self.warn(doubt)
        if args.mesh:
            self._take_sizes(blank, length, width)
        return blank

    def _take_sizes(self, blank, length, width):
        """Make the own mesh's length and width the options', of which `length` and `width` are what a part of the sheet has."""
        args, (low, high) = self.args, blank.extent()
        names = ("length", "width") if "length" in vars(args) else ("side", "side")
        asked = [getattr(args, name) for name in names]
        # rounded, to be the same on any number of ranks
        own = [float(f"{size * a / b:.9g}") for size, a, b in zip(high - low, asked, (length, width))]
        if names[0] == names[1] and abs(own[0] - own[1]) > FITS * own[0]:
            raise InputError(f"--mesh {args.mesh} is {own[0]:g} x {own[1]:g} mm; allowed in this study is a square")
        for name, before, now in zip(names, asked, own):
            if f"--{name}" in self._given and abs(now - before) > FITS * now:
                raise InputError(
                    f"--{name} {before:g} does not fit --mesh {args.mesh}, of {now:g} mm; allowed is its own, or none"
                )
            setattr(args, name, now)
        ignored = [name for name in ("nx", "ny", "pattern") if f"--{name}" in self._given]
        if ignored:
            self.warn(f"--{', --'.join(ignored)} changes nothing, as --mesh {args.mesh} has its own cells")
        args.nx = args.ny = args.pattern = None

    def membrane(self, blank: Blank, fabric: Fabric | None = None) -> Membrane:
        """Membrane of `blank` and `fabric`, by default the options', with their integration."""
        args = self.args
        weave = None if args.weave_angle is None else math.radians(args.weave_angle)
        return Membrane(blank, fabric or self.fabric, integration=args.integration, weave_angle=weave)

    def march(
        self,
        membrane: Membrane,
        supports: list[Support],
        measure: Callable[[Scene, float], tuple[float, float]],
        quantities: Callable[[dict[str, np.ndarray], list[dict[str, Any]]], dict[str, Any]],
        part: str = "",
        terms: Iterable[Any] = (),
        milestones: Iterable[float] = (),
    ) -> Result:
        """Bring the scene of `membrane`, other `terms` and `supports` to full load and write its results; a `Result`.

        measure: function of the scene and its load factor to the displacement [mm] and reaction [N] to record;
        quantities: function of the cell fields and the history's rows to the study's own numbers; part: subfolder;
        milestones: loads to be hit. Raises SolverFailure, after all is written, if the full load was not reached.
        """
        from .results.fields import (  # pyvista takes longer to import than to run a coarse study
            FieldSeries,
            cell_fields,
            nodal_fields,
            watched,
        )

        args, folder = self.args, self.folder(part)
        with timing.phase("setup"):
            scene = Scene(membrane.blank, [membrane, *terms], supports)
        checkpoint = Checkpoint(folder / "checkpoint.npz", membrane.blank, self._problem(membrane.fabric))
        # a part of several that was not begun yet has none
        resumed = args.resume and not (part and not self.comm.bcast(checkpoint.path.exists()))
        newton = Newton(scene, args.tolerance, linear_solver=args.linear_solver)
        start, notes = (
            checkpoint.load(scene.memory(), newton.memory()) if resumed else (None, {"rows": [], "states": []})
        )
        _check_notes(notes, checkpoint.path)
        if start and start.load == 1 and not start.viscosity.drag:
            known = self.comm.bcast(_converged(folder / "summary.json") if self.comm.rank == 0 else None)
            if known:
                if self.comm.rank == 0:
                    log.warning("%s: full load was reached before, nothing is left to do", folder)
                scene.set(start.x)
                scene.at(1.0)
                if self.comm.rank == 0 and not args.no_pictures and not (folder / "maps.png").exists():
                    self._pictures(folder, notes["rows"])  # it ended before they were drawn
                return Result(known, notes["rows"], cell_fields(membrane)[0], folder)
        tools = [term.tool for term in scene.terms if hasattr(term, "tool")]
        self.warn(doubts.of_cells_too_large(membrane.blank, tools))
        if self.comm.rank == 0:
            for old in [folder / "summary.json", *folder.glob("*.png")]:
                old.unlink(missing_ok=True)  # of an earlier run, not of this one
        history = History(folder / "history.csv", self.comm, notes["rows"])
        with timing.phase("output"):
            series = FieldSeries(folder, membrane, notes["states"], scene.terms)
        bar = tqdm(
            total=1.0,
            initial=start.load if start else 0.0,
            desc=part or self.name,
            disable=None if self.comm.rank == 0 else True,
            bar_format="{l_bar}{bar}| load {n:.3f} [{elapsed}<{remaining}{postfix}]",
        )

        beyond: list[str] = []  # what is wrong with the last accepted state
        cell_areas = areas(membrane.blank)

        def accept(accepted):
            with timing.phase("output"):
                least, stretched = watched(membrane)
                least = self.comm.allreduce(least, MPI.MIN)
            if not accepted.load and membrane.weave_angle is not None:
                moved = scene.u.norm(PETSc.NormType.NORM_INFINITY)
                self.say(f"at rest in its supports, before load, the sheet has moved by up to {moved:.3g} mm")
            beyond[:] = self._beyond(scene, stretched, cell_areas)
            history.add(accepted, *measure(scene, accepted.load), least)
            viscous, strain = accepted.energies["viscous"], accepted.energies["strain"]
            if viscous > VISCOUS * abs(strain) and history.rows[-2]["viscous_energy_Nmm"] <= VISCOUS * abs(
                history.rows[-2]["strain_energy_Nmm"]
            ):
                self.warn(
                    f"at load {accepted.load:.6g} (step {len(history.rows) - 1}) the regularisation has taken {100 * viscous / abs(strain):.2g} % of the strain energy; take smaller steps (--max-step) or look for a snap there"
                )
            step, energy = accepted.progress.step, sum(accepted.energies.values())
            bar.update(accepted.load - bar.n)
            words = f"step {step:.3g}, iterations {accepted.report.iterations}, energy {energy:.4g} N mm"
            bar.set_postfix_str(words, refresh=False)
            if self.comm.rank == 0:
                log.debug("load %.6g accepted: %s", accepted.load, words)
            with timing.phase("output"):
                if (len(history.rows) - 1) % args.every == 0:
                    series.write(accepted.load, cell_fields(membrane)[0], nodal_fields(scene))
                checkpoint.save(accepted.progress, {"rows": history.rows, "states": series.states})

        def reject(load, report):
            if self.comm.rank == 0:
                log.warning(
                    "step to load %.6g rejected after %d iterations: %s", load, report.iterations, report.reason
                )

        asked = Asked(self.comm)
        try:
            outcome = march(
                newton,
                args.steps,
                args.max_step,
                on_accept=accept,
                on_reject=reject,
                start=start,
                milestones=milestones,
                viscosity=args.viscosity == "auto",
                accuracy=args.accuracy,
                path_tolerance=args.path_tolerance,
                stop=lambda: asked() or NOT_BELIEVED * bool(beyond) + "; ".join(beyond),
            )
        finally:
            asked.forget()
            bar.close()
            history.close()
        with timing.phase("output"):
            fields, mismatch = cell_fields(membrane)
            if (len(history.rows) - 1) % args.every:
                series.write(outcome.reached, fields, nodal_fields(scene))
        mesh = membrane.blank.mesh
        energies = scene.energies() | {"viscous": history.rows[-1]["viscous_energy_Nmm"]}
        work = history.rows[-1]["external_work_Nmm"]
        stored = sum(energies.values())
        imbalance = abs(work - stored) / max(abs(stored), 1e-300)
        worst = max(history.rows[1:] or history.rows, key=lambda row: row["energy_imbalance"])
        branches = [row["load"] for row in history.rows if row["saddles"]]
        if branches:
            self.warn(
                f"the path branches at load {', '.join(f'{load:.6g}' for load in branches)}: the equilibrium there was a saddle, and one of the ways down was taken; others may lead to other results"
            )
        if imbalance > UNBALANCED:
            self.warn(
                f"work of supports and tools and stored energy differ by {100 * imbalance:.3g} %; take smaller steps (--max-step), unless the sheet snapped"
            )
        found = {"imbalance": imbalance, "viscous": energies["viscous"] / max(abs(energies["strain"]), 1e-300)}
        beyond += self._limits.exceeded(found)
        wrong = outcome.reason or NOT_BELIEVED * bool(beyond) + "; ".join(beyond)
        self.warn(doubts.of_cells_off_the_yarns(membrane))
        summary = self.summarise(
            folder,
            converged=not wrong,
            stroke_reached=outcome.reached,
            reason=wrong or "full load reached",
            dofs=membrane.blank.V.dofmap.index_map.size_global * mesh.geometry.dim,
            cells=mesh.topology.index_map(mesh.topology.dim).size_global,
            integration=membrane.integration,
            terms=[term.name for term in scene.terms],
            couplings=sorted(membrane.fabric.couplings),
            material=membrane.fabric.name,
            steps_accepted=outcome.accepted,
            steps_rejected=outcome.rejected,
            newton_iterations=outcome.iterations,
            energy=dict.fromkeys(ENERGIES, 0.0) | energies | {"external_work": work},
            reaction_N=history.rows[-1]["reaction_N"],
            kernel_mismatch=self.comm.allreduce(mismatch, MPI.MAX),
            energy_imbalance=imbalance,
            energy_imbalance_largest={"value": worst["energy_imbalance"], "load": worst["load"]},
            branches=branches,
            quantities=quantities(fields, history.rows),
        )
        if words := asked():
            raise Interrupted(f"{words} at load factor {outcome.reached:.6g}; --resume goes on from there")
        if self.comm.rank == 0 and not args.no_pictures:
            self._pictures(folder, history.rows)
        self.comm.barrier()
        if not summary["converged"]:
            raise SolverFailure(f"{wrong}; the results up to there are in {folder}")
        return Result(summary, history.rows, fields, folder)

    def _beyond(self, scene, stretched, cell_areas):
        """What no later state mends, a sentence each: tools too deep in the sheet, and yarns stretched too far in cells with
        these strains and areas (cells,)."""
        limit = self._limits.strain
        over, whole = self.comm.allreduce(np.array([cell_areas[stretched > limit].sum(), cell_areas.sum()]))
        deepest = max((term.deepest() / term.thickness for term in scene.contacts()), default=0.0)
        wrong = self._limits.exceeded({"penetration": deepest})
        if over > EDGES * whole:
            wrong.append(
                f"yarns are stretched by more than {100 * limit:.3g} % in {100 * over / whole:.3g} % of the sheet; allowed is {100 * EDGES:.3g} % of it (--max-strain)"
            )
        return wrong

    @property
    def _limits(self):
        return Limits(*(getattr(self.args, f"max_{each.name}") for each in dataclasses.fields(Limits)))

    def summarise(self, folder: Path, **facts: Any) -> dict[str, Any]:
        """Write `facts` with the costs so far and the versions to summary.json, and return it all."""
        total = time.perf_counter() - self._started
        wall = {name: round(timing.seconds.pop(name, 0.0), 4) for name in PHASES}
        self._started = time.perf_counter()
        summary = {"study": self.name, "ranks": self.comm.size, "element": self.args.element} | facts
        asked = {k: str(v) if isinstance(v, Path) else v for k, v in vars(self.args).items()}
        summary |= {
            "command": command(self.comm.size),
            "options": asked,
            "fabric": self.fabric.dumps(),
            "warnings": self._warnings,  # since the last summary
            "wall_s": wall | {"total": round(total, 4)},
            "peak_memory_mib": round(self.comm.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024), 1),
            "versions": {
                "fabric_fenicsx": __version__,
                "dolfinx": dolfinx.__version__,
                "petsc": ".".join(map(str, PETSc.Sys.getVersion())),
                "petsc4py": petsc4py.__version__,
                "numpy": np.__version__,
                "python": platform.python_version(),
            },
        }
        self._warnings = []
        if self.comm.rank == 0:
            replace(folder / "summary.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")
        return summary

    def report(self, ending: str) -> None:
        """Write report.html of all that this run wrote, on rank 0; `ending`: how it ended."""
        if self.comm.rank == 0 and self._begun:
            from .results import report

            out = self.args.out
            runs = {part: (out / part / "summary.json", (out / part).glob("*.png")) for part in ("", *self._parts)}
            description = " ".join((sys.modules["__main__"].__doc__ or "").split())
            replace(out / "report.html", report.page(self.name, runs, description, ending, out / "log.txt"))

    def _problem(self, fabric):
        """What a checkpoint must have been made with to be gone on from: all but solver and output options."""
        free = {
            "steps",
            "max_step",
            "tolerance",
            "linear_solver",
            "path_tolerance",
            "viscosity",
            "accuracy",
            "out",
            "every",
            "resume",
            "overwrite",
            "no_pictures",
            "quick",
            "verbose",
            "material",
            "model",
            "without",
            "compare",
            *(f"max_{each.name}" for each in dataclasses.fields(Limits)),
        }
        options = {k: str(v) if isinstance(v, Path) else v for k, v in vars(self.args).items() if k not in free}
        return {"study": self.name} | options | {"material": fabric.dumps()}

    def _pictures(self, folder, rows):
        from .results import pictures
        from .results.fields import read_last

        pictures.maps(
            folder / "maps.png",
            {self.name.replace("_", " "): read_last(folder)},
            ("log_eps_11", "log_eps_22", "shear_angle"),
            outliers=0.005,  # cells at corners
        )
        curve = [r["displacement_mm"] for r in rows], [r["reaction_N"] for r in rows]
        pictures.curves(folder / "curve.png", {"": curve}, "displacement / mm", "reaction / N")

    def extremes(self, values: np.ndarray) -> tuple[float, float]:
        """Smallest and largest of the arrays of all ranks."""
        low = self.comm.allreduce(values.min(initial=np.inf), MPI.MIN)
        return float(low), float(self.comm.allreduce(values.max(initial=-np.inf), MPI.MAX))

    def mean(self, values: np.ndarray, where: np.ndarray) -> float:
        """Mean of the values of all ranks at the True of `where`."""
        total, count = self.comm.allreduce(np.array([values[where].sum(), where.sum()], dtype=float), MPI.SUM)
        return float(total / count)


def _converged(path: Path) -> dict[str, Any] | None:
    """The summary in `path`, if it is one of a run that reached its end."""
    try:
        summary = json.loads(path.read_text())
    except (OSError, ValueError):
        return None
    return summary if isinstance(summary, dict) and summary.get("converged") else None


def _check_notes(notes: dict[str, Any], path: Path) -> None:
    """Raise InputError unless `notes`, of the checkpoint `path`, hold rows of a history and states that were written."""

    def numbers(values):
        return all(isinstance(value, (int, float)) and math.isfinite(value) for value in values)

    unknown = "negative_pivots", None  # where nothing was factorised
    rows, states = notes.get("rows"), notes.get("states")
    if not isinstance(rows, list) or not isinstance(states, list):
        wrong = "its notes lack rows or states"
    elif any(not isinstance(row, dict) or set(row) != set(COLUMNS) for row in rows):
        wrong = "its rows are none of a history"
    elif any(not numbers(v for k, v in row.items() if (k, v) != unknown) for row in rows):
        wrong = "its rows are none of a history"
    elif any(not isinstance(state, list) or len(state) != 2 or not isinstance(state[1], list) for state in states):
        wrong = "its states are none of a time series"
    elif any(not numbers([state[0], *state[1]]) for state in states):
        wrong = "its states are none of a time series"
    else:
        return
    raise InputError(f"checkpoint {path} is damaged: {wrong}; allowed is one that a study wrote")


def _end(number, frame):
    raise KeyboardInterrupt


def run(name: str, options: Parser, main: Callable[[Study], Any]) -> None:
    """Run main(Study) and leave with the contract's exit status: 0 done, 2 bad input, 3 the solver gave up.

    All ranks leave together, rank 0 speaks; a rank that fails alone ends the others.
    """
    comm, study = MPI.COMM_WORLD, None
    signal.signal(signal.SIGTERM, _end)
    try:
        study = Study(name, options)
        main(study)
        study.report("done")
        return
    except (InputError, SolverFailure, Interrupted) as error:
        status, text = exit_status(error)
        if study and status == 3:
            study.report(text)
    except OSError as error:
        status, text = (
            2,
            f"error: {error.filename or (study.args.out if study else 'a file')} can't be read or written ({error.strerror}); allowed is a file in a folder of this user, with space left",
        )
    except KeyboardInterrupt:
        status, text = 3, "stopped: interrupted; --resume goes on from the last accepted state"
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(1)
    everyone = comm.Ibarrier()
    patience = time.monotonic() + 10
    while not everyone.Test() and time.monotonic() < patience:
        time.sleep(0.01)
    alone = time.monotonic() >= patience
    if comm.rank == 0 or alone:
        print(f"studies/{name}.py: {text}", file=sys.stderr, flush=True)
    if alone:
        comm.Abort(status)
    comm.Barrier()  # mpirun ends all ranks when the first leaves, and rank 0 must have spoken by then
    sys.exit(status)
