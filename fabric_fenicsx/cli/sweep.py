"""`fabric sweep`: many runs of a press file side by side."""

import itertools
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from ..core.errors import InputError, Interrupted, SolverFailure
from ..core.files import replace_file
from ..core.rules import COUNT, Rule
from ..sweep import folder, results
from ..sweep.runner import Runner, SweepRun
from .options import STUDIES, Parser, exit_status, option_type

JOB_ARRAY = """\
#!/bin/bash
#SBATCH --job-name=sweep
#SBATCH --array=1-{count}
#SBATCH --nodes=1
#SBATCH --ntasks={ranks}
#SBATCH --signal=B:TERM@120
cd {folder}
exec {start} --only "$SLURM_ARRAY_TASK_ID" {passed}
"""  # exec: so that the signal reaches the sweep, which ends its run after its step


def parser() -> Parser:
    """Runs `fabric form` with all combinations of values of a press file, side by side, or lets
    numbers scatter. Called again, it goes on. DIR gets table.csv, pictures, report.html, and a
    folder a run. Options behind -- go to `fabric form`."""
    usage = "%(prog)s press.toml --vary KEY=VALUES [option ...] [-- option of form ...]"
    p = Parser(prog="fabric sweep", usage=usage, description=parser.__doc__)
    power = Rule("a power of 2 from 8 on", lambda v: v >= 8 and v.bit_count() == 1, int)
    count: dict = {"type": option_type(COUNT)}
    several: dict = {"action": "append", "default": []}
    words = "press file, or the name of one in studies/presses"
    p.option("press", metavar="press.toml", type=_press_file, help=words)
    words = 'e.g. "holder.pressure=0.01,0.05,0.2", with --scatter "holder.pressure=0.01..0.2"; '
    p.option("--vary", metavar="KEY=VALUES", **several, help=f"{words}several are combined")
    p.option("--out", metavar="DIR", type=Path, help="default results/sweep_PRESS")
    words = "runs at a time (by default as many as cores and free memory allow)"
    p.option("--jobs", metavar="N", **count, help=words)
    p.option("--ranks", metavar="N", **count, default=1, help="of each run, one core each")
    words = "do not run, but write a Slurm script: a job array with one task per run"
    p.option("--slurm", metavar="FILE", type=Path, help=words)
    either = p.add_mutually_exclusive_group()
    words = "do only run K, counted from 1, as a task of the array does"
    either.add_argument("--only", metavar="K", **count, help=words)
    words = "delete the sweep in --out first"
    either.add_argument("--overwrite", action="store_true", help=words)
    words = "report for which values of the varied number a quantity is below X; with --scatter "
    p.option("--below", metavar="QUANTITY=X", **several, help=f"{words}count the runs")
    words = "N runs, 16, 32 or 64, over intervals of [scatter] of the material files and of --vary"
    p.option("--scatter", metavar="N", type=option_type(power), help=words)
    p.switch("--no-pictures", "draw nothing")
    return p


def _press_file(word):
    """The press file of this path, or the example of this name."""
    example = STUDIES / "presses" / f"{word}.toml"
    return example if example.is_file() and not Path(word).is_file() else Path(word)


def main(argv: Sequence[str], program: type[SweepRun] = SweepRun) -> int:
    """Run the sweep of these words; returns its exit status: 0 if all runs are valid, 2 for bad
    input, 3 if one is not valid or the sweep was stopped. program: of the runs."""
    try:
        cut = argv.index("--") if "--" in argv else len(argv)
        args, passed = parser().parse_args(argv[:cut]), list(argv[cut + 1 :])
        if invalid := _sweep(args, passed, program(args.press, passed, args.ranks), argv):
            raise SolverFailure(invalid)
    except (InputError, SolverFailure, Interrupted, OSError) as error:
        status, text = exit_status(error)
        print(f"fabric sweep: {text.removeprefix('stopped: ')}", file=sys.stderr, flush=True)
        return status
    return 0


def _sweep(args, passed, form, argv):
    """Run it and write what it found; why not all runs are valid, or ""."""
    ranges, values = _planned(args, passed, form)
    below = [results.limit_of(word) for word in args.below]
    asked = [name for name, _ in below]
    out = args.out or Path("results") / f"sweep_{args.press.stem}"
    sweep = folder.SweepFolder(out, args.press, list(values[0]), args.overwrite, bool(args.only))
    if args.slurm and not args.only:
        sweep.close()
        _write_job_array(args.slurm, argv, len(values), args.ranks)
        return ""
    runner, answers = Runner(sweep, form, args.jobs, asked), list[str]()
    if args.only:
        return runner.all([values[args.only - 1]])[0].reason
    if "--dry-run" in passed:
        return "".join(run.reason for run in runner.all(values))
    sweep.state["asked"] = asked
    try:
        _announce(values, runner)
        runs = runner.all(values)
        if args.scatter:
            labels = results.headlines(runs, asked)
            answers, sweep.state["scatter"] = results.statistics(runs, ranges, labels, below)
        else:
            answers = [results.below(runs, *limit) for limit in below]
        sweep.save()
        print("".join(f"{sentence}\n" for sentence in answers), end="")
    finally:
        if any(run.summary() for run in sweep.runs.values()):
            results.write(sweep, answers, not args.no_pictures)
            print(f"table, pictures and report are in {out}")
        sweep.close()
    doubted = sum(not run.is_valid() for run in runs)
    some = f"{doubted} of {len(runs)} runs are not valid"
    return f"{some}; table.csv in {out} has the reasons" if doubted else ""


def _planned(args, passed, form):
    """Ranges that scatter, and the values of each run; InputError for what cannot be run."""
    lists = {} if args.scatter else folder.lists(args.vary)
    ranges = [*form.scatter(), *folder.ranges(args.vary)] if args.scatter else []
    values: Sequence[folder.Values]
    values = checked = [dict(zip(lists, each)) for each in itertools.product(*lists.values())]
    if ranges:
        values = results.design(ranges, args.scatter)
        checked = [{r.key: folder.spelled(r[k]) for r in ranges} for k in (1, 2)]
    for fault in _faults(args, passed, lists, ranges, len(values)):
        raise InputError(fault)
    for each in checked:
        form.read(each)
    return ranges, values


def _faults(args, passed, lists, ranges, count):
    """Sentences on options that do not go together; count: of runs."""
    given = "--set", "--out", "--resume", "--overwrite"  # to each run, by the sweep
    for word in passed:
        if word.split("=")[0] in given:
            yield f"option {word} is after --; expected options of form except {', '.join(given)}"
    if not (lists or ranges):
        yield "nothing is varied; expected --vary, or --scatter and [scatter] in a material file"
    least = 1 << (2 * len(ranges) + 1).bit_length()
    if ranges and args.scatter < least:
        yield f"--scatter is {args.scatter}; expected {least} or more for {len(ranges)} numbers"
    if lists and args.below and [None in map(folder.number, v) for v in lists.values()] != [False]:
        yield f"--below is given for {', '.join(args.vary)}; expected one key with numbers"
    if args.only and args.only > count:
        yield f"--only is {args.only}; expected 1 to {count}"


def _announce(values, runner):
    runs, passed = [runner.folder.run(each) for each in values], runner.program.options
    done = [run for run in runs if run.is_done(passed)]
    where = f"{min(runner.jobs, len(runs))} at a time; folder {runner.folder.path}"
    print(f"{len(runs)} runs, {len(done)} done before, {where}", flush=True)
    for each in sorted({shlex.join(run.options) for run in done} - {shlex.join(passed)}):
        print(f"warning: some were made with other options: {each or 'none'}", file=sys.stderr)


def _write_job_array(file, words, count, ranks):
    """Write a script for Slurm, a task a run of the `count` that `fabric sweep` with these words
    does, to start in the present folder. InputError for a file that is there."""
    if file.exists():
        raise InputError(f"--slurm {file} exists already; use another file")
    cut = words.index("--") if "--" in words else len(words)
    own = [word for word in words[:cut] if word != "--overwrite"]
    start = shlex.join([sys.executable, "-m", "fabric_fenicsx", "sweep", *own])
    here, passed = shlex.quote(str(Path.cwd())), shlex.join(words[cut:])
    of_array = {"count": count, "ranks": ranks, "folder": here, "start": start}
    replace_file(file, JOB_ARRAY.format(passed=passed, **of_array))
    print(f"{file}: a job array of {count} runs, for sbatch; afterwards the same sweep without")
    print("--slurm does missing runs and writes the table")
