"""Hard cases of the solver: each must reach its load, with a number that has a reference, in not
many more iterations than were measured."""

import bench
from bench.hard import HEAD, Setting, line
from bench.hard_table import CASES

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import run


def options():
    p = bench.options("hard_cases", __doc__)
    p.option("--only", nargs="+", metavar="CASE", help="cases to run, with --quick only quick ones")
    return p


def main(study):
    args = study.args
    if unknown := {*(args.only or ())} - {*CASES}:
        raise ff.InputError(f"no case is called {min(unknown)}; expected {', '.join(CASES)}")
    folder, setting, rows = study.folder(), Setting(study.comm, study.fabric), []
    study.say(HEAD)
    for name in args.only or CASES:
        if CASES[name].quick or not args.quick:
            rows.append(CASES[name].judge(setting))
            study.say(line(rows[-1]))
    failed = [row["case"] for row in rows if not row["holds"]]
    bench.finish(study, {"cases": rows}, not failed, quantities={r["case"]: r for r in rows})
    if failed:
        raise ff.SolverFailure(f"cases {', '.join(failed)} do not hold; see {folder}/cases.csv")


if __name__ == "__main__":
    run("hard_cases", options(), main)
