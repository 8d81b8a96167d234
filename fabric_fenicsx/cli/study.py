"""Parts that all study scripts share: options, a test of them, its run, and the exit status."""

import logging
import os
import signal
import sys
import traceback
from argparse import BooleanOptionalAction
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

from ..core.collective_errors import is_alone
from ..core.errors import InputError, Interrupted, SolverFailure
from ..core.fields import declared
from ..core.status import Console, log, shown, task
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
from . import options as command_line
from .options import Parser, program

Test = TypeVar("Test", bound=Coupon)


def parser(test: Any, description: str | None, name: str = "", **defaults: object) -> Parser:
    """The parser of study `name` (the test's own by default): the fields of the class `test`, and
    the options that all studies share; `defaults` override theirs. An option that a resumed run may
    change says `free=True` where it is declared; all others define the problem."""
    name = name or test.NAME
    p = Parser(prog=program(name), usage="%(prog)s [option ...]", description=description)
    p.group("usual")
    add_fields(p, test, test)
    add_shared(p, test, name, **{"material": "komeili"} | defaults)
    return p


def add_shared(p: Parser, test: Any, name: str, **defaults: Any) -> None:
    """Add what studies `name` of all tests have, material, solver and output, with the defaults of
    the class `test` or these."""
    p.group("material")
    own = "" if "material" in defaults else " (that of the press)"
    presets = f"material file, or one of {', '.join(PRESETS)}{own}"
    p.option("--material", metavar="FILE|PRESET", help=presets, free=True)
    text = "Python file with your own laws"
    p.option("--law-file", metavar="FILE.py", help=text, free=True)
    models = {"choices": ("hyperelastic", "fabric"), "default": "hyperelastic"}
    p.option("--model", **models, help="fabric: no couplings", free=True)
    several = {"metavar": "COUPLING", "action": "append", "default": []}
    p.option("--without", **several, help=f"turn off one of {', '.join(COUPLINGS)}", free=True)
    add_fields(p, Settings, test, free=True)
    p.group("solver")
    unasked = {0: "", 1: " (yes)"}.get(test.CHEAP_FROM, f" (yes from {test.CHEAP_FROM} cells on)")
    text = f"estimate all errors by repeating the run on a coarser mesh{unasked}"
    p.option("--error", action=BooleanOptionalAction, help=text, free=True)
    if test is not Coupon:
        text = "check the input, draw setup.png of a press, and estimate the cost from one step"
        p.switch("--dry-run", text)
    add_fields(p, Limits, test, prefix="max_", free=True)
    p.group("output")
    where = {"metavar": "DIR", "type": Path, "default": Path("results") / name}
    p.option("--out", **where, help="folder of the results", free=True)
    p.switch("--resume", "continue from the checkpoint in --out, on any number of ranks")
    p.switch("--overwrite", "delete the results in --out first")
    p.switch("--no-pictures", "draw nothing")
    p.switch("--quick", "coarse mesh and few steps")
    p.switch("--verbose", "print each Newton iteration, as in log.txt")
    p.set_defaults(_sizes={False: test.FULL, True: test.QUICK}, **dict(test.SOLVER) | defaults)


def add_fields(p: Parser, owner: type, test: Any, prefix: str = "", free: bool = False) -> None:
    """Add an option for each field of the dataclass `owner` that has a help text; test: class whose
    sizes and limits are defaults, prefix: of the options' names."""
    for each in declared(owner):
        if each.name == "fabric" or (owner is Coupon and each.metadata["group"] == "weave"):
            continue
        p.group(each.metadata["group"])
        settings = {"default": each.default} | kind_of_option(each.metadata)
        if each.name in test.FULL:
            sizes = [sizes[each.name] for sizes in (test.FULL, test.QUICK)]
            full, quick = ("any" if size is None else size for size in sizes)
            settings["help"] += f" ({full}, with --quick {quick})"
            settings["default"] = None
        p.option(command_line.spelled(prefix + each.name), free=free, **settings)


def kind_of_option(meta: Mapping) -> dict:
    """Argparse's settings for a declared field with this metadata, without its default."""
    settings: dict = {"help": meta["help"].replace("%", "%%")}
    if "rule" in meta:
        letter = "N" if meta["rule"].kind is int else "X"
        letter = {"[deg]": "DEG", "[mm]": "MM"}.get(meta["help"].split(" ")[-1], letter)
        return settings | {"type": command_line.option_type(meta["rule"]), "metavar": letter}
    if "switch" in meta:
        return settings | {"action": "store_true"}
    if "metavar" in meta:
        return settings | {"metavar": meta["metavar"]}
    return settings | {"choices": tuple(meta["choices"])}


class Study:
    """A study under way: parsed options `args`, `fabric`, `comm`, and the `output` of its runs.
    Construction checks options and material as a whole; it raises InputError on all ranks before
    anything is written."""

    def __init__(self, name: str, options: Parser, argv: list[str] | None = None) -> None:
        self.comm = comm = MPI.COMM_WORLD
        argv = sys.argv[1:] if argv is None else argv
        if comm.rank != 0 and command_line.asks_for_help(argv):
            sys.exit(0)
        self.args = args = options.parse_args(argv)
        for option, value in vars(args).pop("_sizes")[args.quick].items():
            idle = option == "nx" and "mesh" in args and (args.mesh or args.size)
            if getattr(args, option, value) is None and not idle:
                setattr(args, option, value)
        if args.resume and args.overwrite:
            raise InputError("--resume and --overwrite are both given; expected one of them")
        self.fabric = fabric = self.read_fabric()
        self._free = options.free
        self._setup: Any = Setup  # the last that was built, for the report
        log.handlers.clear()
        log.setLevel(logging.DEBUG)
        log.propagate = False
        if comm.rank == 0:
            log.addHandler(Console(logging.DEBUG if args.verbose else logging.INFO))
        settings = {"resume": args.resume, "overwrite": args.overwrite}
        settings |= {
            "command": command_line.restart_command(comm.size),
            "translated": options.translated,
        }
        self.output = output = Output(name, args.out, comm, **settings)
        texts = [each for each in vars(args).values() if isinstance(each, str)]
        output.owned.inputs = [Path(each).resolve() for each in texts if os.path.isfile(each)]
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
            flaw = f"--law-file: the material {args.material} has the law {fabric.law}"
            raise InputError(f"{flaw}; expected --material with a file of the law in it")
        return self.coupled(fabric if "temperature" in args else fabric.at(None))

    def coupled(self, fabric: Law) -> Law:
        """The fabric with the couplings that the options leave."""
        whole = fabric.decoupled() if self.args.model == "fabric" else fabric
        return whole.without(*self.args.without)

    def describe(self, kind: type[Test], fabric: Law | None = None) -> Test:
        """The test of this kind with the options' fields, of their fabric or another."""
        return kind(fabric or self.fabric, **self._fields(kind))

    def _fields(self, owner, prefix=""):
        """Values {name: value} of the declared fields of the class `owner` that have options."""
        given, names = vars(self.args), [each.name for each in declared(owner)]
        return {name: given[prefix + name] for name in names if prefix + name in given}

    def build(self, test: Any) -> Any:
        """The `Setup` of a test; its warnings are printed and its sizes become the options'."""
        with phase("setup"):
            self._setup = setup = test.build(self.comm)
        vars(self.args).update(setup.resolved)
        for doubt in setup.warnings:
            self.warn(doubt)
        return setup

    def run(self, setup: Any, part: str = "") -> Result:
        """The `Result` of a built test with the solver's options, into the subfolder `part`."""
        limits = Limits(**self._fields(Limits, "max_"))
        error = setup.has_cheap_error() if self.args.error is None else self.args.error
        job = setup.job(**self._fields(Settings), limits=limits, error=error)
        self._problem = self.problem(setup)
        return self.run_job(job, part)

    def run_job(self, job: Job, part: str) -> Result:
        """The `Result` of a job of the last test that ran, into the subfolder `part`."""
        self.output.facts = self._facts()
        pictures = not self.args.no_pictures
        if self.args.dry_run:
            for line in checked(job, self.output, part, pictures):
                self.say(line)
            self.output.close()
            sys.exit(0)
        return job.run(self.output, part, problem=self._problem, pictures=pictures)

    def summarise(self, folder: Path | None, **facts: object) -> dict:
        """Summarise the study as a whole, see `Output.summarise`."""
        self.output.facts = self._facts()
        return self.output.summarise(folder, **{"element": self.args.element} | facts)

    def _facts(self):
        given = vars(self.args).items()
        options = {k: str(v) if isinstance(v, Path) else v for k, v in given}
        known = {"options": options, "fabric": self.fabric.dumps()}
        return {"command": self.output.facts["command"], **known}

    def problem(self, setup: Setup) -> dict:
        """Facts in which a checkpoint must agree: the fabric, and all options but the free ones."""
        options = self._facts()["options"].items()
        defining = {k: v for k, v in options if k not in self._free}
        return {"study": self.output.name, **defining, "material": setup.data.fabric.dumps()}

    def write_report(self, description: str, ending: str) -> None:
        """Write report.html with the title and text of the test, else this description."""
        self.output.report(self._setup.text or description, ending, self._setup.title)


def run(name: str, options: Parser, main: Callable[[Any], None], kind: type[Study] = Study) -> None:
    """Run main(study of that kind) and leave with the contract's exit status: 0 done, 2 bad input,
    3 the solver gave up. All ranks leave together, rank 0 speaks; a rank that fails alone ends the
    others."""
    count_imports()
    comm, study = MPI.COMM_WORLD, None
    description = " ".join((sys.modules["__main__"].__doc__ or "").split())
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        speaks = comm.rank == 0 and not command_line.asks_for_help(sys.argv)
        with shown(first=speaks), task(program(name)):
            study = kind(name, options)
            main(study)
            study.write_report(description, "done")
        return
    except (InputError, SolverFailure, Interrupted, OSError) as error:
        code, text = command_line.exit_status(error)
        text = options.translated(text)
        if study and code == 3:
            study.write_report(description, text)
    except KeyboardInterrupt:
        code, text = 3, "stopped: interrupted; --resume continues from the last accepted state"
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
