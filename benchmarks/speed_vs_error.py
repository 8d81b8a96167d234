"""What accuracy costs: wall time, iterations and memory against the error to studies/reference,
over elements, meshes, load steps, tolerances, linear solvers and ranks, one factor at a time from a
baseline. Forming is compared with its own finest run. Options of the material and the output count,
others that studies share do not."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from bench import fronts
from bench.cost import cost
from bench.cost_plan import Configuration, plan, plan_forming, plan_sizes
from bench.once import once
from bench.own_process import run_apart
from bench.reference import read_references
from bench.strips import STRIPS
from tqdm import tqdm

from fabric_fenicsx.command_line.options import option_type
from fabric_fenicsx.command_line.study import parser, run
from fabric_fenicsx.coupons.coupon import Coupon
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.runtime.rules import FINITE, POSITIVE

REFERENCE = Path(__file__).resolve().parents[1] / "studies" / "reference"
SCENES = "of benchmarks/reference.py (all, with --quick the first two)"
ERRORS = "what errors are to"
LIMIT = "of one configuration, starting included [s]"
FORMING = "instead: the double dome, yarns at these angles, beside a finer run"
SIZES = "instead: one tangent and its solution, over mesh sizes"


def options():
    p = parser(Coupon, __doc__, "speed_vs_error")
    p.group("test")
    p.option("--scenes", nargs="+", choices=tuple(STRIPS), help=SCENES)
    p.option("--reference", metavar="DIR", type=Path, default=REFERENCE, help=ERRORS)
    p.option("--limit", type=option_type(POSITIVE), default=60.0, help=LIMIT)
    how = {"nargs": "+", "type": option_type(FINITE), "metavar": "DEG"}
    p.option("--forming", **how, help=FORMING, free=True)
    p.option("--sizes", action="store_true", help=SIZES)
    p.add_argument("--configuration", help=argparse.SUPPRESS)  # one run, in a process of its own
    return p


def rows_of(study, runs):
    """Rows of the table for the configurations `runs`, each in a process of its own."""
    args = study.args
    command = [sys.executable, __file__, "--reference", str(args.reference)]
    command += ["--material", args.material, "--model", args.model]
    command += [word for coupling in args.without for word in ("--without", coupling)]
    for c in tqdm(runs, disable=None, leave=False):
        yield (row := once(study, str(asdict(c)), lambda c=c: run_apart(c, command, args.limit)))
        if row["reason"]:
            tqdm.write(f"{c}: {row['reason']}", file=sys.stderr)


def sizes(study):
    """Cost of assembly and solution over mesh size; table, exponents and the gain by ranks."""
    folder, rows = study.folder(), [*rows_of(study, plan_sizes(study.args.quick))]
    study.write_table(folder / "table.csv", rows)
    found = fronts.size_exponents(rows)
    study.summarise(folder, converged=True, stroke_reached=1.0, quantities=found)
    for line in (fronts.table(rows, fronts.PRINTED_SIZES), *fronts.size_lines(found)):
        study.say(line)


def forming(study):
    """Forming over meshes and steps, judged by the finest run of each angle; table and picture."""
    rows = [*rows_of(study, plan_forming(study.args.forming, study.args.quick))]
    by_angle = {r["scene"]: [each for each in rows if each["scene"] == r["scene"]] for r in rows}
    finest = {name: fronts.judge_forming(mine) for name, mine in by_angle.items()}
    folder, kept = study.folder(), [{k: v for k, v in r.items() if k != "curve"} for r in rows]
    study.write_table(folder / "table.csv", kept)
    if not study.args.no_pictures:
        from bench.cost_picture import draw_fronts

        others = {n: [r for r in by_angle[n] if r is not finest[n]] for n in finest}
        draw_fronts(folder / "forming_front.png", others, "CPU time / s")
    found = {
        name: {
            "finest": str(fronts.configuration(r)),
            "front": [str(fronts.configuration(f)) for f in by_angle[name] if f.get("on_front")],
        }
        for name, r in finest.items()
    }
    study.summarise(folder, converged=True, stroke_reached=1.0, quantities=found)
    study.say(fronts.table(rows, fronts.PRINTED_FORMING))


def main(study):
    args, comm, fabric = study.args, study.comm, study.fabric
    if args.configuration:
        c = Configuration(**json.loads(args.configuration))
        return study.say(json.dumps(cost(comm, fabric, c, args.reference)))
    if comm.size > 1:
        raise InputError(f"{comm.size} ranks are given; allowed is 1, which starts all runs itself")
    if args.sizes:
        return sizes(study)
    if args.forming:
        return forming(study)
    names = args.scenes or list(STRIPS)[: 2 if args.quick else None]
    reference = read_references(args.reference, names, fabric, args.material)
    folder, rows = study.folder(), [*rows_of(study, plan(names, args.quick))]
    strips = {name: [r for r in rows if r["scene"] == name] for name in names}
    for name in names:
        fronts.judge(strips[name], reference[name])
    advice = {name: fronts.recommended(rows) for name, rows in strips.items()}
    common = fronts.recommended_for_all(strips)
    study.write_table(folder / "table.csv", rows)
    if not args.no_pictures:
        from bench.cost_picture import draw_fronts

        draw_fronts(folder / "front.png", strips)
    study.summarise(
        folder,
        converged=True,
        stroke_reached=1.0,
        material=fabric.name,
        quantities={name: fronts.facts(rows, advice[name]) for name, rows in strips.items()},
        recommended={f"{goal:g}": choice for goal, choice in common.items()},
    )
    for line in (fronts.table(rows), *fronts.advice_lines(advice, common)):
        study.say(line)


if __name__ == "__main__":
    run("speed_vs_error", options(), main)
