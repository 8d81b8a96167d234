"""`fabric sweep`: many runs of a press file side by side, and the least value of a quantity."""

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

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
    p.add_argument(
        "--vary",
        metavar="KEY=VALUES",
        action="append",
        default=[],
        help='as "holder.pressure=0.01,0.05,0.2"; with --minimise as "holder.pressure=0.01..0.2"; '
        "several are combined",
    )
    p.add_argument("--out", metavar="DIR", type=Path, help="default results/sweep_PRESS")
    cores = len(os.sched_getaffinity(0))
    how = option_type(COUNT)
    p.add_argument(
        "--jobs", metavar="N", type=how, default=cores, help="runs at a time, of one core each"
    )
    p.add_argument(
        "--below",
        metavar="QUANTITY=X",
        action="append",
        default=[],
        help="say where a quantity is below x over the one number that is varied",
    )
    p.add_argument("--minimise", metavar="QUANTITY", help="look for its least value")
    several = Rule("a whole number of 3 or more", lambda v: v >= 3, int)
    p.add_argument(
        "--evaluations",
        metavar="N",
        type=option_type(several),
        help="most runs of --minimise (12 for each number)",
    )
    p.add_argument("--overwrite", action="store_true", help="delete the sweep in --out first")
    p.add_argument("--no-pictures", action="store_true", help="draw nothing")
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

    ranks = max(int(os.environ.get(name, 1)) for name in RANKS)
    if ranks > 1:
        raise InputError(f"sweep runs on {ranks} ranks; allowed is one: it starts its runs itself")
    if not args.vary:
        raise InputError("nothing is varied; allowed is one --vary or more")
    limits = [optimum.limit_of(word) for word in args.below]
    ranges = varied.ranges(args.vary) if args.minimise else []
    lists = {} if args.minimise else varied.lists(args.vary)
    keys = [each.key for each in ranges] or list(lists)
    _check_limits(args, lists)
    title = read_press(args.press).get("title", args.press.name)
    out = args.out or Path("results") / f"sweep_{args.press.stem}"
    form = program(args.press, passed)
    values = varied.combinations(lists or {each.key: each.ends for each in ranges})
    form.check(values)
    sweep = SweepFolder(out, args.press, keys, args.overwrite)
    sweep.facts["asked"] = [*filter(None, [args.minimise]), *(name for name, _ in limits)]
    runner = Runner(sweep, form, args.jobs)
    answers: list[str] = []
    try:
        if args.minimise:
            runs, found = _minimise(args, ranges, runner)
            answers.append(found)
        else:
            _announce(values, runner)
            runs = runner.all(values)
            answers += [optimum.below(runs, *limit) for limit in limits]
        for answer in answers:
            print(answer)
    finally:
        if any(run.summary() for run in sweep.runs.values()):
            results.write(sweep, f"Sweep: {title}", answers, not args.no_pictures)
            print(f"table, pictures and report are in {out}")
        sweep.close()
    doubted = [run for run in runs if not run.is_believed()]
    if not doubted:
        return ""
    return f"{len(doubted)} of {len(runs)} runs are not believed; table.csv in {out} says why"


def _check_limits(args, lists):
    """InputError for options that do not go together."""
    if args.evaluations and not args.minimise:
        raise InputError("--evaluations is given; allowed is it with --minimise")
    if not args.below:
        return
    if args.minimise or len(lists) != 1:
        raise InputError("--below is given; allowed is it with one --vary, and without --minimise")
    ((key, values),) = lists.items()
    if any(varied.number(value) is None for value in values):
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
    """Runs of the search, and what is told of the best."""
    from ..sweep import optimum

    found: dict[str, object] = {}

    def evaluate(values):
        runs = runner.all(values, bar=False)
        for run in runs:
            found[run.folder.name] = run
            known = run.numbers().get(args.minimise)
            if known is not None:
                doubt = "" if run.is_believed() else " (not believed)"
                print(f"{len(found)}: {run.label}: {args.minimise} {known:.5g}{doubt}", flush=True)
        return runs

    best = optimum.minimise(ranges, args.minimise, evaluate, args.evaluations)
    runner.folder.facts["best"] = best.facts()
    runner.folder.save()
    return [best.run], best.words()
