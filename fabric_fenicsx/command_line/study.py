"""What every study script shares: its options, a scenario of them, its run, and how it ends."""

import dataclasses
import logging
import math
import signal
import sys
import traceback
from argparse import BooleanOptionalAction
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ..job.job import Result
from ..material.laws import COUPLINGS, Law
from ..material.presets import PRESETS, load, read_laws
from ..mechanics.shell.membrane import Membrane
from ..results.output import Output
from ..runtime.errors import InputError, Interrupted, SolverFailure
from ..runtime.fields import COUNT, POSITIVE, Rule
from ..runtime.together import is_alone
from ..scenarios.scenario import Scenario
from ..solve.limits import Limits
from ..solve.linear import LINEAR_SOLVERS
from .console import Console
from .options import (
    HelpFormatter,
    Parser,
    exit_status,
    option_type,
    program,
    restart_command,
    spelled,
)

log = logging.getLogger("fabric_fenicsx")
UP_TO_ONE = Rule("a load factor above 0 and up to 1", lambda v: 0 < v <= 1)
BELOW_ONE = Rule("a number above 0 and below 1", lambda v: 0 < v < 1)


def parser(
    scenario: type[Scenario], description: str | None, name: str = "", **defaults: Any
) -> Parser:
    """The parser of study `name` (the scenario's own by default): the scenario's fields and the
    options that all studies share; `defaults` override theirs.

    An option that a resumed run may change says `free=True` where it is declared; all others
    define the problem.
    """
    name = name or scenario.NAME
    p = Parser(
        prog=program(name),
        usage="%(prog)s [option ...]",
        description=description,
        formatter_class=HelpFormatter,
    )
    full, quick = scenario.FULL, scenario.QUICK
    add_scenario(p, scenario)
    p.group("material")
    p.option(
        "--material",
        metavar="FILE|PRESET",
        default="komeili",
        help=f"material file, or one of {', '.join(PRESETS)}",
        free=True,
    )
    p.option(
        "--law-file",
        metavar="FILE.py",
        help="Python file with the classes of your own laws",
        free=True,
    )
    p.option(
        "--model",
        choices=("hyperelastic", "fabric"),
        default="hyperelastic",
        help="fabric: without all couplings",
        free=True,
    )
    p.option(
        "--without",
        metavar="COUPLING",
        action="append",
        default=[],
        help=f"turn off one of {', '.join(COUPLINGS)}",
        free=True,
    )
    solver = {"tolerance": 1e-8, "path_tolerance": 1e-4, "every": 5} | dict(scenario.SOLVER)
    p.group("solver")
    steps = f"load steps ({full['steps']}, with --quick {quick['steps']})"
    p.option("--steps", type=option_type(COUNT), help=steps, free=True)
    p.option(
        "--max-step", type=option_type(UP_TO_ONE), help="largest load step (1/steps)", free=True
    )
    p.option(
        "--tolerance",
        type=option_type(BELOW_ONE),
        default=solver["tolerance"],
        help="residual of the last state, over the forces on the sheet",
        free=True,
    )
    p.option(
        "--path-tolerance",
        type=option_type(BELOW_ONE),
        default=solver["path_tolerance"],
        help="the same of states before full load: the curve is as good as this",
        free=True,
    )
    p.option(
        "--viscosity",
        choices=("auto", "off"),
        default="auto",
        help="auto: steps that fail get a drag on the nodes, which fades",
        free=True,
    )
    p.option(
        "--accuracy",
        type=option_type(POSITIVE),
        help="largest share of the displacement by which a step may leave the straight "
        "continuation of the path; a step beyond is cut",
        free=True,
    )
    p.option(
        "--balance",
        type=option_type(POSITIVE),
        help="largest share of a step's work that may be missing from the energies; a step beyond "
        f"is halved ({solver.get('balance') or 'any'}, with --quick any)",
        free=True,
    )
    p.option(
        "--error",
        action=BooleanOptionalAction,
        help="estimate errors of numbers, curve and fields, from the same run on a mesh twice as "
        "coarse" + (f" (yes from {scenario.CHEAP_FROM} cells on)" if scenario.CHEAP_FROM else ""),
        free=True,
    )
    solvers = tuple(LINEAR_SOLVERS)
    p.option(
        "--linear-solver",
        choices=solvers,
        default="mumps-cholesky",
        help="solver of the linear systems",
        free=True,
    )
    p.group("limits, beyond which a result is not believed (exit status 3)")
    for each in dataclasses.fields(Limits):
        p.option(
            f"--max-{each.name}",
            type=option_type(POSITIVE),
            default=each.default,
            help=each.metadata["help"],
            free=True,
        )
    p.group("output")
    p.option(
        "--out",
        metavar="DIR",
        type=Path,
        default=Path("results") / name,
        help="folder of the results",
        free=True,
    )
    p.option(
        "--every",
        type=option_type(COUNT),
        default=solver["every"],
        help="accepted steps between states written for ParaView",
        free=True,
    )
    p.option(
        "--resume",
        action="store_true",
        help="go on from the checkpoint in --out, on any number of ranks",
        free=True,
    )
    p.option(
        "--overwrite", action="store_true", help="delete the results in --out first", free=True
    )
    p.option("--no-pictures", action="store_true", help="draw nothing", free=True)
    p.option("--quick", action="store_true", help="coarse mesh and few steps", free=True)
    p.option(
        "--verbose",
        action="store_true",
        help="print each Newton iteration, as log.txt has them",
        free=True,
    )
    weave = {"yarn_angle": 90.0, "weave_angle": None}
    balance = {"balance": solver.get("balance")}  # few steps are not to become many
    p.set_defaults(_sizes={False: {**full, **balance}, True: quick}, **weave | defaults)
    return p


def add_scenario(p: Parser, scenario: type[Scenario]) -> None:
    """Add an option for each field of `scenario` that has a help text."""
    for each in dataclasses.fields(scenario):
        meta = each.metadata
        if "help" not in meta or (scenario is Scenario and meta["group"] == "weave"):
            continue
        p.group(meta["group"])
        how: dict[str, Any] = {"help": meta["help"].replace("%", "%%"), "default": each.default}
        if each.name in scenario.FULL:
            full, quick = scenario.FULL[each.name], scenario.QUICK[each.name]
            how["help"] += f" ({full}, with --quick {quick})"
        if "rule" in meta:
            how["type"] = option_type(meta["rule"])
        elif "choices" in meta:
            how["choices"] = meta["choices"]
        elif "switch" in meta:
            how["action"] = "store_true"
        elif "repeated" in meta:
            how |= {"action": "append", "metavar": meta["repeated"], "default": []}
        else:
            how["metavar"] = meta["metavar"]
        if meta["help"].endswith("[deg]"):
            how["metavar"] = "DEG"
        p.option(spelled(each.name), **how)


class Study(Output):
    """A study under way: parsed options `args`, `fabric`, `comm`, and its output.

    Construction checks options and material as a whole; it raises InputError on all ranks before
    anything is written.
    """

    def __init__(self, name: str, options: Parser, argv: list[str] | None = None) -> None:
        comm = MPI.COMM_WORLD
        argv = sys.argv[1:] if argv is None else argv
        if comm.rank != 0 and {"-h", "--help"} & set(argv):
            sys.exit(0)
        self.args = args = options.parse_args(argv)
        for option, value in vars(args).pop("_sizes")[args.quick].items():
            if getattr(args, option, value) is None and not (option == "nx" and args.mesh):
                setattr(args, option, value)
        if args.mesh and not Path(args.mesh).is_file():
            raise InputError(
                f"--mesh {args.mesh} is not there or not a file; allowed is any mesh that gmsh or "
                "meshio writes"
            )
        if args.resume and args.overwrite:
            raise InputError("--resume and --overwrite are both given; allowed is one of them")
        if args.law_file:
            read_laws(args.law_file)
        fabric = load(args.material)
        if args.law_file and type(fabric).__module__.startswith("fabric_fenicsx."):
            raise InputError(
                f"--law-file {args.law_file} is given, but the material {args.material} is of the "
                f"law {fabric.law}; allowed is --material with a file of the law in it"
            )
        self.fabric = (fabric.decoupled() if args.model == "fabric" else fabric).without(
            *args.without
        )
        self._options = options
        log.handlers.clear()
        log.setLevel(logging.DEBUG)
        log.propagate = False
        if comm.rank == 0:
            log.addHandler(Console(logging.DEBUG if args.verbose else logging.INFO))
        super().__init__(
            name,
            args.out,
            comm,
            resume=args.resume,
            overwrite=args.overwrite,
            command=restart_command(comm.size),
        )
        for doubt in fabric.plausibility_warnings():
            self.warn(doubt)

    def warn(self, text: str) -> None:
        """As `Output.warn`, with parameters as options."""
        super().warn(self._options.translated(text))

    def scenario(self, kind: type[Scenario], fabric: Any = None) -> Any:
        """The scenario of this kind of the options, of their fabric or another."""
        args, fields = self.args, [f.name for f in dataclasses.fields(kind) if "help" in f.metadata]
        given = {name: getattr(args, name) for name in fields if hasattr(args, name)}
        made = kind(fabric or self.fabric, **given, comm=self.comm)
        for name in ("nx", "ny", "pattern", "element", "integration", *kind.SIZES):
            setattr(args, name, getattr(made, name))  # as an own mesh's length
        for doubt in made.warnings:
            self.warn(doubt)
        return made

    def run(self, scenario: Scenario, part: str = "") -> Result:
        """The `Result` of a scenario with the solver's options, into the subfolder `part`."""
        args = self.args
        limits = [getattr(args, f"max_{each.name}") for each in dataclasses.fields(Limits)]
        job = scenario.job(
            steps=args.steps,
            max_step=args.max_step,
            tolerance=args.tolerance,
            path_tolerance=args.path_tolerance,
            linear_solver=args.linear_solver,
            viscosity=args.viscosity == "auto",
            accuracy=args.accuracy,
            balance=args.balance,
            every=args.every,
            error=scenario.has_cheap_error() if args.error is None else args.error,
            limits=Limits(*limits),
        )
        problem = {**self.problem(scenario.fabric), **scenario.problem()}
        return job.run(self, part, problem=problem, pictures=not args.no_pictures)

    def once(self, key: str, make: Callable[[], Any], problem: Any = None) -> Any:
        """As `Output.once`, for the problem of the options."""
        return super().once(key, make, problem or self.problem(self.fabric))

    def summarise(self, folder: Path | None, **facts: Any) -> dict[str, Any]:
        """As `Output.summarise`, with command, options and fabric, parameters as options."""
        if "reason" in facts:
            facts["reason"] = self._options.translated(facts["reason"])
        self.facts = {
            "command": self.command,
            "options": _in_words(vars(self.args)),
            "fabric": self.fabric.dumps(),
        }
        return super().summarise(folder, **{"element": self.args.element} | facts)

    def problem(self, fabric: Any) -> Mapping[str, Any]:
        """What a checkpoint must have been made with to be gone on from: all options but the free
        ones, and the fabric."""
        defining = {k: v for k, v in vars(self.args).items() if k not in self._options.free}
        return {"study": self.name} | _in_words(defining) | {"material": fabric.dumps()}

    def membrane(self, fabric: Law | None = None) -> Membrane:
        """Membrane of `fabric`, by default the options', with their integration."""
        args = self.args
        weave = None if args.weave_angle is None else math.radians(args.weave_angle)
        options = {"integration": args.integration, "weave_angle": weave}
        return Membrane(fabric or self.fabric, **options)


def _in_words(options):
    return {k: str(v) if isinstance(v, Path) else v for k, v in options.items()}


def _end(number, frame):
    raise KeyboardInterrupt


def run(name: str, options: Parser, main: Callable[[Study], Any]) -> None:
    """Run main(Study) and leave with the contract's exit status: 0 done, 2 bad input, 3 the solver
    gave up.

    All ranks leave together, rank 0 speaks; a rank that fails alone ends the others.
    """
    comm, study = MPI.COMM_WORLD, None
    description = " ".join((sys.modules["__main__"].__doc__ or "").split())
    signal.signal(signal.SIGTERM, _end)
    try:
        study = Study(name, options)
        main(study)
        study.report(description, "done")
        return
    except (InputError, SolverFailure, Interrupted) as error:
        status, text = exit_status(error)
        text = options.translated(text)
        if study and status == 3:
            study.report(description, text)
    except OSError as error:
        file = error.filename or (study.args.out if study else "a file")
        status, text = (
            2,
            (
                f"error: {file} can't be read or written ({error.strerror}); allowed is a file in "
                "a folder of this user, with space left"
            ),
        )
        if error.errno is None:  # as of gmsh, whose wheel needs some of the machine's libraries
            text = f"error: {error}; `fabric info` says what works here"
    except KeyboardInterrupt:
        status, text = 3, "stopped: interrupted; --resume goes on from the last accepted state"
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(1)
    alone = is_alone(comm)
    if comm.rank == 0 or alone:
        print(f"{program(name)}: {text}", file=sys.stderr, flush=True)
    if alone:
        comm.Abort(status)
    comm.Barrier()  # as mpirun ends all ranks when the first leaves
    sys.exit(status)
