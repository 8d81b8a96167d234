"""Hard cases of the solver: each must end in a true local minimum of the energy, or in a plain
reason."""

import bench
from bench.hard_cases import CASES, Setting, run_case

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import run


def options():
    p = bench.options("hard_cases", __doc__, element="P1")
    p.option("--only", metavar="LETTERS", default="".join(CASES), help="cases to run")
    return p


def main(study):
    args = study.args
    if unknown := set(args.only) - set(CASES):
        wrong = f"--only {args.only} names case {min(unknown)}"
        raise ff.InputError(f"{wrong}; allowed are letters of {''.join(CASES)}")
    folder, rows = study.folder(), []
    setting = Setting(study.comm, study.fabric, args.integration or "full", args.quick)
    for letter in args.only:
        rows.append(row := run_case(letter, setting))
        holds = "holds" if row["holds"] else "FAILS"
        cost = f"{row['wall_s']} s, {row['steps']} steps, {row['iterations']} iterations"
        faults = "; not sound: " + "; ".join(row["faults"][:3]) if row["faults"] else ""
        study.say(f"{letter}  {holds}  {cost}  {row['must_hold']}\n     {row['found']}{faults}")
    failed = [row["case"] for row in rows if not row["holds"]]
    bench.finish(study, {"cases": rows}, not failed, quantities={r["case"]: r for r in rows})
    if failed:
        raise ff.SolverFailure(f"cases {', '.join(failed)} do not hold; see {folder}/cases.csv")


if __name__ == "__main__":
    run("hard_cases", options(), main)
