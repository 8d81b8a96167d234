"""What accuracy costs: wall time, iterations and memory against the error to studies/reference,
over elements, meshes, load steps, tolerances, linear solvers and ranks, one factor at a time from a
baseline. Forming is compared with its own finest run. Options of the material and the output count,
others that studies share do not."""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from bench import cost, fronts
from bench.cost_plan import Configuration, plan, plan_forming, plan_sizes
from bench.once import once
from bench.reference import read_references
from bench.strips import STRIPS
from tqdm import tqdm

import fabric_fenicsx as ff
from fabric_fenicsx.command_line.options import option_type
from fabric_fenicsx.command_line.study import parser, run
from fabric_fenicsx.coupons.coupon import Coupon
from fabric_fenicsx.runtime.rules import FINITE, POSITIVE

REFERENCE = Path(__file__).resolve().parents[1] / "studies" / "reference"
GOALS = 0.1, 0.01, 0.001  # errors of a curve
SOLVES = "wall time / linear-elastic solves of the baseline mesh"
PRINTED = "cost", "error_curve", "error_reaction", "error_strain", "tangent_s", "solve_s", "reason"


def options():
    p = parser(Coupon, __doc__, "speed_vs_error")
    p.group("test")
    scenes = "of benchmarks/reference.py (all, with --quick the first two)"
    p.option("--scenes", nargs="+", choices=tuple(STRIPS), help=scenes)
    what = {"metavar": "DIR", "type": Path, "help": "what errors are to"}
    p.option("--reference", default=REFERENCE, **what)
    limit = "of one configuration, starting included [s]"
    p.option("--limit", type=option_type(POSITIVE), default=60.0, help=limit)
    forming = "instead: the double dome, yarns at these angles, beside a finer run"
    angles = {"nargs": "+", "type": option_type(FINITE), "metavar": "DEG"}
    p.option("--forming", **angles, help=forming, free=True)
    sizes = "instead: one tangent and its solution, over mesh sizes"
    p.option("--sizes", action="store_true", help=sizes, free=True)
    p.add_argument("--configuration", help=argparse.SUPPRESS)  # one run, in a process of its own
    return p


def rows_of(study, runs):
    """Rows of the table for the configurations, each run in a process of its own, by scene."""
    args, groups = study.args, {}
    command = [sys.executable, __file__, "--reference", str(args.reference)]
    command += ["--material", args.material, "--model", args.model]
    command += [word for coupling in args.without for word in ("--without", coupling)]
    for c in tqdm(runs, disable=None, leave=False):
        row = once(study, str(asdict(c)), cost.apart, c, command, args.limit)
        groups.setdefault(c.scene, []).append(row)
    return groups


def written(study, groups, **facts):
    """Table and summary of the rows of each scene; a line for each."""
    folder, rows = study.folder(), sum(groups.values(), [])
    kept = [{k: v for k, v in row.items() if k != "curve"} for row in rows]
    study.write_table(folder / "table.csv", kept)
    study.summarise(folder, converged=True, stroke_reached=1.0, **facts)
    for row in rows:
        numbers = (f"{k} {row[k]:.3g}" if k != "reason" else row[k] for k in PRINTED if row.get(k))
        study.say(f"{fronts.configuration(row)}: {', '.join(numbers)}")


def front(rows):
    return [str(fronts.configuration(row)) for row in rows if row.get("on_front")]


def sizes(study):
    """Cost of assembly and solution over mesh size: exponents and the gain by ranks."""
    groups = rows_of(study, plan_sizes(study.args.quick))
    found = fronts.size_exponents(groups["tensile"])
    written(study, groups, quantities=found)
    for name, values in found.items():
        study.say(f"{name}: " + ", ".join(f"{k} {v:.3g}" for k, v in values.items()))


def forming(study):
    """Forming over meshes and steps, judged by the finest run of each angle."""
    groups, found = rows_of(study, plan_forming(study.args.forming, study.args.quick)), {}
    others = {}
    for name, rows in groups.items():
        finest = fronts.judge_forming(rows)
        found[name] = {"finest": str(fronts.configuration(finest)), "front": front(rows)}
        others[name] = [row for row in rows if row is not finest]
    written(study, groups, quantities=found)
    if not study.args.no_pictures:
        fronts.draw_fronts(study.folder() / "forming_front.png", others, "CPU time / s")


def strips(study):
    """Runs of strips, judged by the references; the cheapest that are right enough."""
    args, fabric, found = study.args, study.fabric, {}
    names = args.scenes or list(STRIPS)[: 2 if args.quick else None]
    reference = read_references(args.reference, names, fabric, args.material)
    groups = rows_of(study, plan(names, args.quick))
    for name, rows in groups.items():
        fronts.judge(rows, reference[name])
        found[name] = {"runs": len(rows), "failed": len(rows) - len(fronts.succeeded(rows))}
        found[name] |= {"error_bar": rows[0]["error_bar"], "front": front(rows)}
    asked = {name: [rows] for name, rows in groups.items()} | {"all": [*groups.values()]}
    best = {n: {f"{g:g}": fronts.cheapest(of, g) for g in GOALS} for n, of in asked.items()}
    written(study, groups, quantities=found, recommended=best, material=fabric.name)
    for name, goals in best.items():
        for goal, rows in goals.items():
            costs = [f"{fronts.configuration(r)}: {r['cost']:.3g} baseline solves" for r in rows]
            words = "; ".join(costs) or "none of these"
            study.say(f"{name}, curve within {float(goal):.1%}: {words}")
    if not args.no_pictures:
        fronts.draw_fronts(study.folder() / "front.png", groups, SOLVES)


def main(study):
    args, comm = study.args, study.comm
    if args.configuration:
        c = Configuration(**json.loads(args.configuration))
        return study.say(json.dumps(cost.cost(comm, study.fabric, c, args.reference)))
    if comm.size > 1:
        raise ff.InputError(f"{comm.size} ranks are given; allowed is 1, which starts all runs")
    (sizes if args.sizes else forming if args.forming else strips)(study)


if __name__ == "__main__":
    run("speed_vs_error", options(), main)
