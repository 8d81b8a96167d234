"""`fabric sweep`: many runs of a press file side by side."""

import itertools
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..runtime.errors import InputError, Interrupted, SolverFailure
from ..runtime.files import unwritable
from ..runtime.rules import COUNT, Rule
from ..sweep import varied
from ..sweep.folder import SweepFolder, check_quantity
from ..sweep.form import Form
from .options import STUDIES, Parser, exit_status, option_type

NAME = "fabric sweep"
OWN_OPTIONS = ("--set", "--out", "--resume", "--overwrite")  # that it gives each of its runs


def parser() -> Parser:
    """Runs `fabric form` with all combinations of values of a press file, side by side, or lets
    numbers scatter. Called again, it goes on. DIR gets table.csv, pictures, report.html, and a
    folder a run. Options behind -- go to `fabric form`."""
    usage = "%(prog)s press.toml --vary KEY=VALUES [option ...] [-- option of form ...]"
    p = Parser(prog=NAME, usage=usage, description=" ".join((parser.__doc__ or "").split()))
    words = "the press file, or the name of one in studies/presses"
    p.add_argument("press", metavar="press.toml", type=_press_file, help=words)
    power = Rule("a power of 2 from 8 on", lambda v: v >= 8 and v.bit_count() == 1, int)
    more: dict[str, Any] = {"action": "append", "default": []}
    words = 'as "holder.pressure=0.01,0.05,0.2"; with --scatter as "holder.pressure=0.01..0.2"; '
    p.add_argument("--vary", metavar="KEY=VALUES", help=words + "several are combined", **more)
    p.add_argument("--out", metavar="DIR", type=Path, help="default results/sweep_PRESS")
    words = "runs at a time (by default as many as cores and free memory allow)"
    p.add_argument("--jobs", metavar="N", type=option_type(COUNT), help=words)
    words = "ranks of each run, one core each (1)"
    p.add_argument("--ranks", metavar="N", type=option_type(COUNT), default=1, help=words)
    words = "run nothing here, but write a script for Slurm: a job array with a task for each run"
    p.add_argument("--slurm", metavar="FILE", type=Path, help=words)
    words = "do run K alone, counted from 1, as a task of the array does"
    p.add_argument("--only", metavar="K", type=option_type(COUNT), help=words)
    words = "say where a quantity is below X over the one number that is varied; with --scatter "
    p.add_argument("--below", metavar="QUANTITY=X", help=words + "count the runs", **more)
    words = "N runs, 16, 32 or 64, over intervals of [scatter] of the material files and of --vary"
    p.add_argument("--scatter", metavar="N", type=option_type(power), help=words)
    words = "do not find the answer again on finer cells"
    p.add_argument("--no-finer", action="store_true", help=words)
    words = "delete the sweep in --out first"
    p.add_argument("--overwrite", action="store_true", help=words)
    p.add_argument("--no-pictures", action="store_true", help="draw nothing")
    return p


def _press_file(word):
    """The press file of this path, or the example of this name."""
    example = STUDIES / "presses" / f"{word}.toml"
    return example if example.is_file() and not Path(word).is_file() else Path(word)


def main(argv: Sequence[str], program: type[Form] = Form) -> int:
    """Run the sweep of these words; returns its exit status: 0 if all runs are believed, 2 for bad
    input, 3 if one is not believed or the sweep was stopped. program: of the runs."""
    try:
        words, passed = _parted(argv)
        unbelieved = _sweep(parser().parse_args(words), passed, program, argv)
        if unbelieved:
            raise SolverFailure(unbelieved)
    except (InputError, SolverFailure, Interrupted) as error:
        status, text = exit_status(error)
        print(f"{NAME}: {text.removeprefix('stopped: ')}", file=sys.stderr, flush=True)
        return status
    except OSError as error:
        print(f"{NAME}: {exit_status(unwritable(error))[1]}", file=sys.stderr)
        return 2
    return 0


def _parted(argv):
    """The sweep's own words, and those behind `--`."""
    cut = argv.index("--") if "--" in argv else len(argv)
    words, passed = list(argv[:cut]), list(argv[cut + 1 :])
    if own := [word for word in passed if word.split("=")[0] in OWN_OPTIONS]:
        allowed = f"options of fabric form but {', '.join(OWN_OPTIONS)}"
        raise InputError(f"option {own[0]} is behind --; allowed are {allowed}")
    return words, passed


def _sweep(args, passed, program, argv):
    """Run it and write what it found; why not all runs are believed, or ""."""
    from ..sweep import job_array, limits, results, scatter
    from ..sweep.runner import Runner

    variables = "OMPI_COMM_WORLD_SIZE", "PMI_SIZE"  # of mpirun
    if (ranks := max(int(os.environ.get(name, 1)) for name in variables)) > 1:
        raise InputError(f"sweep runs on {ranks} ranks; allowed is one: it starts its runs itself")
    if not (args.vary or args.scatter):
        raise InputError("nothing is varied; allowed is one --vary or more")
    form, ranges, values = _planned(args, passed, program)
    below = [limits.limit_of(word) for word in args.below]
    asked = [name for name, _ in below]
    names = form.quantities(values[0]) if asked else ()
    for name in asked:
        check_quantity(name, names, f"none of {args.press}")
    out = args.out or Path("results") / f"sweep_{args.press.stem}"
    sweep = SweepFolder(out, args.press, list(values[0]), args.overwrite, bool(args.only))
    if args.slurm:
        sweep.close()
        job_array.write(args.slurm, argv, len(values), args.ranks)
        return ""
    if args.only:
        (run,) = Runner(sweep, form).all([values[args.only - 1]])
        return run.reason
    sweep.facts["asked"] = asked
    runner, answers = Runner(sweep, form, args.jobs), list[str]()
    try:
        _announce(values, runner)
        runs = runner.all(values)
        if args.scatter:
            labels = results.headlines(runs, asked)
            answers, sweep.facts["scatter"] = scatter.told(runs, ranges, labels, below)
        elif below:
            refined = args.no_finer or "--refine" in passed  # cells as fine as each run needs
            finer = None
            if not refined and (changes := form.finer(values[0])):
                again = lambda each: runner.all([{**own, **changes} for own in each])  # noqa: E731
                finer = limits.Finer(varied.label(changes), again)
            answers = [limits.below(runs, *limit, finer) for limit in below]
        sweep.save()
        print(*answers, sep="\n", end="\n" * bool(answers))
    finally:
        if any(run.summary() for run in sweep.runs.values()):
            results.write(sweep, f"Sweep: {sweep.title}", answers, not args.no_pictures)
            print(f"table, pictures and report are in {out}")
        sweep.close()
    if not (doubted := sum(not run.is_believed() for run in runs)):
        return ""
    return f"{doubted} of {len(runs)} runs are not believed; table.csv in {out} says why"


def _planned(args, passed, program):
    """The program of the runs, the ranges of --scatter, and the values of all runs, checked."""
    from ..sweep import scatter

    form = program(args.press, passed, args.ranks)
    ranges = [*form.scatter(), *varied.ranges(args.vary)] if args.scatter else []
    _check_together(args, ranges)
    if args.scatter:
        values = scatter.design(ranges, args.scatter)
        form.check([{r.key: varied.spelled(r[k]) for r in ranges} for k in (1, 2)])
    else:
        lists = varied.lists(args.vary)
        values = [dict(zip(lists, each)) for each in itertools.product(*lists.values())]
        if args.below and len(lists) != 1:
            raise InputError(f"--below needs one --vary, and {len(lists)} are given")
        for key, texts in lists.items() if args.below else ():
            if any(varied.number(text) is None for text in texts):
                found = f"--below is given, but {key} is {texts[0]}"
                raise InputError(f"{found}; allowed are numbers")
        form.check(values)
    if args.only and args.only > len(values):
        raise InputError(f"--only is {args.only}; allowed is 1 to {len(values)}")
    return form, ranges, values


def _check_together(args, ranges):
    """InputError for options that do not go together."""
    for other in ("slurm", "overwrite"):
        if args.only and getattr(args, other):
            raise InputError(f"--only and --{other} are both given; allowed is one of them")
    if not args.scatter:
        return
    if not ranges:
        allowed = "a table [scatter] in a material file, or --vary KEY=LOW..HIGH"
        raise InputError(f"nothing scatters; allowed is {allowed}")
    least = 2 * len(ranges) + 2
    if args.scatter < least:
        allowed = f"allowed for {len(ranges)} numbers is {1 << (least - 1).bit_length()} or more"
        raise InputError(f"--scatter is {args.scatter}; {allowed}")


def _announce(values, runner):
    """Say what is to be done, and what is there already."""
    runs = [runner.folder.run(each) for each in values]
    passed = runner.program.options
    done = [run for run in runs if run.is_done(passed)]
    count, jobs = len(runs), min(runner.room(runs), len(runs))
    where = f"{jobs} at a time; folder {runner.folder.path}"
    print(f"{count} runs, {len(done)} done before, {where}", flush=True)
    others = {shlex.join(run.options) for run in done} - {shlex.join(passed)}
    for each in sorted(others):
        print(f"warning: some were made with other options: {each or 'none'}", file=sys.stderr)
