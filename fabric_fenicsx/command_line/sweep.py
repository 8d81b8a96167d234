"""`fabric sweep`: many runs of a press file side by side, and the least value of a quantity."""

import itertools
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..runtime.errors import InputError, Interrupted, SolverFailure
from ..runtime.rules import COUNT, Rule
from ..sweep import varied
from ..sweep.folder import SweepFolder, read_press
from ..sweep.processes import Form, Runner
from .options import HelpFormatter, Parser, exit_status, option_type

NAME = "fabric sweep"
DESCRIPTION = (
    "Runs `fabric form` with all combinations of values of a press file, side by side on the cores "
    "there are, or looks for the least value of a quantity. Called again, it goes on. DIR gets "
    "table.csv, curves.png, trends.png, maps.png and report.html, and a folder a run. Options "
    "behind -- go to `fabric form`."
)
# what a sweep gives each of its runs, or tells it by itself
TAKEN = ("--set", "--out", "--resume", "--overwrite")
RANKS = "OMPI_COMM_WORLD_SIZE", "PMI_SIZE"


def parser() -> Parser:
    """The parser of the command."""
    p = Parser(
        prog=NAME,
        usage="%(prog)s press.toml --vary KEY=VALUES [option ...] [-- option of form ...]",
        description=DESCRIPTION,
        formatter_class=HelpFormatter,
    )
    p.add_argument("press", metavar="press.toml", type=Path, help="the press file")
    several = Rule("a whole number of 3 or more", lambda v: v >= 3, int)
    options: dict[str, tuple[str, dict[str, Any]]] = {
        "--vary": (
            'as "holder.pressure=0.01,0.05,0.2"; with --minimise as "holder.pressure=0.01..0.2"; '
            "several are combined",
            {"metavar": "KEY=VALUES", "action": "append", "default": []},
        ),
        "--out": ("default results/sweep_PRESS", {"metavar": "DIR", "type": Path}),
        "--jobs": (
            "runs at a time, of one core each",
            {"metavar": "N", "type": option_type(COUNT), "default": len(os.sched_getaffinity(0))},
        ),
        "--below": (
            "say where a quantity is below x over the one number that is varied",
            {"metavar": "QUANTITY=X", "action": "append", "default": []},
        ),
        "--minimise": ("look for its least value", {"metavar": "QUANTITY"}),
        "--evaluations": (
            "most runs of --minimise (12 for each number)",
            {"metavar": "N", "type": option_type(several)},
        ),
        "--overwrite": ("delete the sweep in --out first", {"action": "store_true"}),
        "--no-pictures": ("draw nothing", {"action": "store_true"}),
    }
    for name, (text, how) in options.items():
        p.add_argument(name, help=text, **how)
    return p


def main(argv: Sequence[str], program: type[Form] = Form) -> int:
    """Run the sweep of these words; returns its exit status: 0 if all runs are believed, 2 for bad
    input, 3 if one is not believed or the sweep was stopped. program: of the runs."""
    try:
        words, passed = _parted(argv)
        unbelieved = _sweep(parser().parse_args(words), passed, program)
        if unbelieved:
            raise SolverFailure(unbelieved)
    except (InputError, SolverFailure, Interrupted) as error:
        status, text = exit_status(error)
        print(f"{NAME}: {text.removeprefix('stopped: ')}", file=sys.stderr, flush=True)
        return status
    except OSError as error:
        print(
            f"{NAME}: error: {error.filename} can't be read or written ({error.strerror}); allowed "
            "is a file in a folder of this user, with space left",
            file=sys.stderr,
        )
        return 2
    return 0


def _parted(argv):
    """The sweep's own words, and those behind `--`."""
    words = list(argv)
    cut = words.index("--") if "--" in words else len(words)
    passed = words[cut + 1 :]
    for word in passed:
        if word.split("=")[0] in TAKEN:
            raise InputError(
                f"option {word} is behind --; allowed are options of fabric form but "
                f"{', '.join(TAKEN)}"
            )
    return words[:cut], passed


def _sweep(args, passed, program):
    """Run it and write what it found; why not all runs are believed, or ""."""
    from ..sweep import optimum, results

    if (ranks := max(int(os.environ.get(name, 1)) for name in RANKS)) > 1:
        raise InputError(f"sweep runs on {ranks} ranks; allowed is one: it starts its runs itself")
    if not args.vary:
        raise InputError("nothing is varied; allowed is one --vary or more")
    limits = [optimum.limit_of(word) for word in args.below]
    ranges = varied.ranges(args.vary) if args.minimise else []
    lists = {each.key: each.ends for each in ranges} or varied.lists(args.vary)
    _check_limits(args, lists)
    _, document = read_press(args.press)
    values = [dict(zip(lists, each)) for each in itertools.product(*lists.values())]
    form = program(args.press, passed)
    form.check(values)
    out = args.out or Path("results") / f"sweep_{args.press.stem}"
    sweep = SweepFolder(out, args.press, list(lists), args.overwrite)
    sweep.facts["asked"] = [*filter(None, [args.minimise]), *(name for name, _ in limits)]
    runner, answers = Runner(sweep, form, args.jobs), list[str]()
    try:
        if args.minimise:
            best = _minimise(args, ranges, runner)
            runs, answers = [best.run], [best.text]
        else:
            _announce(values, runner)
            runs = runner.all(values)
            answers = [optimum.below(runs, *limit) for limit in limits]
        print(*answers, sep="\n", end="\n" * bool(answers))
    finally:
        if any(run.summary() for run in sweep.runs.values()):
            title = f"Sweep: {document.get('title', args.press.name)}"
            results.write(sweep, title, answers, not args.no_pictures)
            print(f"table, pictures and report are in {out}")
        sweep.close()
    doubted = [run for run in runs if not run.is_believed()]
    if not doubted:
        return ""
    return f"{len(doubted)} of {len(runs)} runs are not believed; table.csv in {out} says why"


def _check_limits(args, lists):
    """InputError for options that do not go together."""
    if args.evaluations and not args.minimise:
        raise InputError("--evaluations needs --minimise")
    if args.below and args.minimise:
        raise InputError("--below and --minimise are both given; allowed is one of them")
    if args.below and len(lists) != 1:
        raise InputError(f"--below needs one --vary, and {len(lists)} are given")
    for key, values in lists.items():
        if args.below and any(varied.number(value) is None for value in values):
            raise InputError(f"--below is given, but {key} is {values[0]}; allowed are numbers")


def _announce(values, runner):
    """Say what is to be done, and what is there already."""
    runs = [runner.folder.run(each) for each in values]
    passed = runner.program.options
    done = [run for run in runs if run.is_done(passed)]
    print(
        f"{len(runs)} runs, {len(done)} done before, {min(runner.jobs, len(runs))} at a time; "
        f"folder {runner.folder.path}",
        flush=True,
    )
    others = {shlex.join(run.options) for run in done} - {shlex.join(passed)}
    for each in sorted(others):
        print(f"warning: some were made with other options: {each or 'none'}", file=sys.stderr)


def _minimise(args, ranges, runner):
    """The `Optimum`, with a line for each run on the way."""
    from ..sweep import optimum

    seen: set[str] = set()

    def evaluate(values):
        runs = runner.all(values, bar=False)
        for run in runs:
            seen.add(run.folder.name)
            if (known := run.numbers().get(args.minimise)) is not None:
                doubt = "" if run.is_believed() else " (not believed)"
                print(f"{len(seen)}: {run.label}: {args.minimise} {known:.5g}{doubt}", flush=True)
        return runs

    best = optimum.minimise(ranges, args.minimise, evaluate, args.evaluations)
    runner.folder.facts["best"] = best.facts
    runner.folder.save()
    return best
