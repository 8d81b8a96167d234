"""Parts that all study scripts share: options, a test of them, its run, and the exit status."""

import logging
import signal
import sys
import traceback
from argparse import BooleanOptionalAction, Namespace
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

from ..core import status
from ..core.collective_errors import is_alone
from ..core.errors import InputError, Interrupted, SolverFailure
from ..core.fields import declared
from ..core.logs import Console
from ..core.timing import count_imports, phase
from ..coupons.coupon import Coupon
from ..job.dry_run import checked
from ..job.job import Job, Result
from ..job.setup import Setup
from ..material.laws import COUPLINGS, Law
from ..material.presets import PRESETS, load, read_laws
from ..results.output import Output
from ..solve.limits import Limits
from ..solve.settings import Settings
from .options import (
    Parser,
    asks_for_help,
    exit_status,
    option_type,
    program,
    restart_command,
    spelled,
)

log = logging.getLogger("fabric_fenicsx")
Test = TypeVar("Test", bound=Coupon)


def parser(test: Any, description: str | None, name: str = "", **defaults: object) -> Parser:
    """The parser of study `name` (the test's own by default): the fields of the class `test`, and
    the options that all studies share; `defaults` override theirs. An option that a resumed run may
    change says `free=True` where it is declared; all others define the problem."""
    name = name or test.NAME
    p = Parser(prog=program(name), usage="%(prog)s [option ...]", description=description)
    p.group("usual")
    add_fields(p, test, test)
    add_material(p, "komeili")
    add_solver(p, test)
    add_output(p, name)
    p.set_defaults(_sizes={False: test.FULL, True: test.QUICK}, **dict(test.SOLVER) | defaults)
    return p


def add_material(p: Parser, default: str | None) -> None:
    """Add the options of the material; default: what it is."""
    p.group("material")
    presets = f"material file, or one of {', '.join(PRESETS)}"
    presets += "" if default else " (that of the press)"
    p.option("--material", metavar="FILE|PRESET", default=default, help=presets, free=True)
    words = "Python file with the classes of your own laws"
    p.option("--law-file", metavar="FILE.py", help=words, free=True)
    models = {"choices": ("hyperelastic", "fabric"), "default": "hyperelastic"}
    p.option("--model", **models, help="fabric: without all couplings", free=True)
    several = {"metavar": "COUPLING", "action": "append", "default": []}
    p.option("--without", **several, help=f"turn off one of {', '.join(COUPLINGS)}", free=True)


def add_solver(p: Parser, test: Any) -> None:
    """Add the options of solver, errors and limits, with the defaults of the class `test`."""
    add_fields(p, Settings, test, free=True)
    p.group("solver")
    unasked = {0: "", 1: " (yes)"}.get(test.CHEAP_FROM, f" (yes from {test.CHEAP_FROM} cells on)")
    words = f"estimate all errors, from the same run on a mesh twice as coarse{unasked}"
    p.option("--error", action=BooleanOptionalAction, help=words, free=True)
    if test is not Coupon:
        words = "check all, draw setup.png of a press, take the first step and tell the cost"
        p.switch("--dry-run", words)
    add_fields(p, Limits, test, prefix="max_", free=True)


def add_fields(p: Parser, owner: type, test: Any, prefix: str = "", free: bool = False) -> None:
    """Add an option for each field of the dataclass `owner` that has a help text; test: class whose
    sizes and limits are defaults, prefix: of the options' names."""
    for each in declared(owner):
        meta, name = each.metadata, each.name
        if owner is Coupon and meta["group"] == "weave":
            continue
        p.group(meta["group"])
        how = {"help": meta["help"].replace("%", "%%"), "default": each.default}
        how |= kind_of_option(meta)
        if name in test.FULL:
            sizes = [sizes[name] for sizes in (test.FULL, test.QUICK)]
            full, quick = ("any" if size is None else size for size in sizes)
            how |= {"help": f"{how['help']} ({full}, with --quick {quick})", "default": None}
        p.option(spelled(prefix + name), free=free, **how)


def kind_of_option(meta: Mapping) -> dict:
    """Argparse's settings for the values of a declared field with this metadata."""
    if "rule" in meta:
        letter = "N" if meta["rule"].kind is int else "X"
        letter = {"[deg]": "DEG", "[mm]": "MM"}.get(meta["help"].split(" ")[-1], letter)
        return {"type": option_type(meta["rule"]), "metavar": letter}
    if "switch" in meta:
        return {"action": "store_true"}
    if "metavar" in meta:
        return {"metavar": meta["metavar"]}
    return {"choices": tuple(meta["choices"])}


def options_of(owner: type, args: Namespace) -> dict:
    """Values {name: value} of the declared fields of the class `owner` that have options."""
    return {f.name: getattr(args, f.name) for f in declared(owner) if hasattr(args, f.name)}


def add_output(p: Parser, name: str) -> None:
    """Add the options of the results' folder; name: of the study."""
    p.group("output")
    where = {"metavar": "DIR", "type": Path, "default": Path("results") / name}
    p.option("--out", **where, help="folder of the results", free=True)
    p.switch("--resume", "go on from the checkpoint in --out, on any number of ranks")
    p.switch("--overwrite", "delete the results in --out first")
    p.switch("--no-pictures", "draw nothing")
    p.switch("--quick", "coarse mesh and few steps")
    p.switch("--verbose", "print each Newton iteration, as log.txt has them")


class Study:
    """A study under way: parsed options `args`, `fabric`, `comm`, and the `output` of its runs.
    Construction checks options and material as a whole; it raises InputError on all ranks before
    anything is written."""

    def __init__(self, name: str, options: Parser, argv: list[str] | None = None) -> None:
        self.comm = comm = MPI.COMM_WORLD
        argv = sys.argv[1:] if argv is None else argv
        if comm.rank != 0 and asks_for_help(argv):
            sys.exit(0)
        self.args = args = options.parse_args(argv)
        for option, value in vars(args).pop("_sizes")[args.quick].items():
            idle = option == "nx" and "mesh" in args and (args.mesh or args.size)
            if getattr(args, option, value) is None and not idle:
                setattr(args, option, value)
        if args.resume and args.overwrite:
            raise InputError("--resume and --overwrite are both given; allowed is one of them")
        self.fabric = fabric = self.read_fabric()
        self._free, self._title, self._text = options.free, "", ""
        log.handlers.clear()
        log.setLevel(logging.DEBUG)
        log.propagate = False
        if comm.rank == 0:
            log.addHandler(Console(logging.DEBUG if args.verbose else logging.INFO))
        how = {"resume": args.resume, "overwrite": args.overwrite, "translated": options.translated}
        self.output = output = Output(
            name, args.out, comm, command=restart_command(comm.size), **how
        )
        self.say, self.warn, self.folder = output.say, output.warn, output.folder
        self.write_table = output.write_table
        for doubt in fabric.plausibility_warnings() if fabric else ():
            self.warn(doubt)

    def read_fabric(self) -> Any:
        """The fabric of the options."""
        args = self.args
        if args.law_file:
            read_laws(args.law_file)
        fabric = load(args.material)
        if args.law_file and type(fabric).__module__.startswith("fabric_fenicsx."):
            flaw = f"--law-file: the material {args.material} is of the law {fabric.law}"
            raise InputError(f"{flaw}; allowed is --material with a file of the law in it")
        return self.coupled(fabric if "temperature" in args else fabric.at(None))

    def coupled(self, fabric: Law) -> Law:
        """The fabric with the couplings that the options leave."""
        whole = fabric.decoupled() if self.args.model == "fabric" else fabric
        return whole.without(*self.args.without)

    def describe(self, kind: type[Test], fabric: Law | None = None) -> Test:
        """The test of this kind with the options' fields, of their fabric or another."""
        return kind(fabric or self.fabric, **options_of(kind, self.args))

    def build(self, test: Any) -> Any:
        """The `Setup` of a test, whose warnings are told and whose sizes become the options'."""
        with phase("setup"):
            setup = test.build(self.comm)
        vars(self.args).update(setup.resolved)
        for doubt in setup.warnings:
            self.warn(doubt)
        self._title, self._text = setup.title, setup.text
        return setup

    def run(self, setup: Any, part: str = "") -> Result:
        """The `Result` of a built test with the solver's options, into the subfolder `part`."""
        given = vars(self.args)
        limits = Limits(**{each.name: given[f"max_{each.name}"] for each in declared(Limits)})
        error = setup.has_cheap_error() if self.args.error is None else self.args.error
        job = setup.job(**options_of(Settings, self.args), limits=limits, error=error)
        self._problem = self.problem(setup)
        return self.run_job(job, part)

    def run_job(self, job: Job, part: str) -> Result:
        """The `Result` of a job of the last test that ran, into the subfolder `part`."""
        self._note_facts()
        pictures = not self.args.no_pictures
        if self.args.dry_run:
            for line in checked(job, self.output, part, pictures, self.more_runs(job.setup)):
                self.say(line)
            sys.exit(0)
        return job.run(self.output, part, problem=self._problem, pictures=pictures)

    def more_runs(self, setup: Setup) -> dict[str, float]:
        """{what options ask for beside the run of a test: times as many cells}."""
        return {}

    def summarise(self, folder: Path | None, **facts: object) -> dict:
        """Summarise the study as a whole, see `Output.summarise`."""
        self._note_facts()
        return self.output.summarise(folder, **{"element": self.args.element} | facts)

    def _note_facts(self):
        facts = {"command": self.output.command, "options": self._options()}
        self.output.facts = facts | {"fabric": self.fabric.dumps()}

    def _options(self):
        return {k: str(v) if isinstance(v, Path) else v for k, v in vars(self.args).items()}

    def problem(self, setup: Setup) -> dict:
        """Facts in which a checkpoint must agree: the fabric, and all options but the free ones."""
        defining = {k: v for k, v in self._options().items() if k not in self._free}
        return {"study": self.output.name, **defining, "material": setup.data.fabric.dumps()}

    def write_report(self, description: str, ending: str) -> None:
        """Write report.html with the title and text of the test, else this description."""
        self.output.report(self._text or description, ending, self._title)


def run(name: str, options: Parser, main: Callable[[Any], None], kind: type[Study] = Study) -> None:
    """Run main(study of that kind) and leave with the contract's exit status: 0 done, 2 bad input,
    3 the solver gave up. All ranks leave together, rank 0 speaks; a rank that fails alone ends the
    others."""
    count_imports()
    comm, study = MPI.COMM_WORLD, None
    description = " ".join((sys.modules["__main__"].__doc__ or "").split())
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        speaks = comm.rank == 0 and not asks_for_help(sys.argv)
        with status.shown(first=speaks), status.task(program(name)):
            study = kind(name, options)
            main(study)
            study.write_report(description, "done")
        return
    except (InputError, SolverFailure, Interrupted, OSError) as error:
        code, text = exit_status(error)
        text = options.translated(text)
        if study and code == 3:
            study.write_report(description, text)
    except KeyboardInterrupt:
        code, text = 3, "stopped: interrupted; --resume goes on from the last accepted state"
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(1)
    alone = is_alone(comm)
    if comm.rank == 0 or alone:
        print(f"{program(name)}: {text}", file=sys.stderr, flush=True)
    if alone:
        comm.Abort(code)
    comm.Barrier()  # as mpirun ends all ranks when the first leaves
    sys.exit(code)
