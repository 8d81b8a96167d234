"""What accuracy costs: wall time and iterations against the error to studies/reference, over
elements, meshes, load steps, tolerances and linear solvers, one factor at a time from a baseline.
Forming is compared with its own finest run. Mesh and solver are the runs' own."""

from pathlib import Path

import bench
from bench import cost, fronts
from bench.cost_plan import plan, plan_forming
from bench.reference import read_references
from bench.strips import STRIPS
from tqdm import tqdm

from fabric_fenicsx.cli.options import option_type
from fabric_fenicsx.cli.study import run
from fabric_fenicsx.core.rules import FINITE

REFERENCE = Path(__file__).resolve().parents[1] / "studies" / "reference"
PRINTED = "cost", "error_curve", "error_reaction", "error_strain", "reason"


def options():
    p = bench.options("speed_vs_error", __doc__)
    scenes = "of benchmarks/reference.py (all, with --quick the first two)"
    p.option("--scenes", nargs="+", choices=tuple(STRIPS), help=scenes)
    where = {"metavar": "DIR", "type": Path, "default": REFERENCE}
    p.option("--reference", **where, help="what errors are to")
    forming = "instead: the double dome, yarns at these angles, beside a finer run"
    angles = {"nargs": "+", "type": option_type(FINITE), "metavar": "DEG"}
    p.option("--forming", **angles, help=forming)
    return p


def rows_of(study, runs):
    """Rows of the table for the configurations, by scene."""
    groups = {}
    for c in tqdm(runs, disable=None, leave=False):
        row = cost.cost(study.comm, study.fabric, c, study.args.reference)
        groups.setdefault(c.scene, []).append(row)
    return groups


def forming(study):
    """Rows of forming over meshes and steps, judged by the finest run of each angle; those to draw;
    facts."""
    groups = rows_of(study, plan_forming(study.args.forming, study.args.quick))
    finest = {name: fronts.judge_forming(rows) for name, rows in groups.items()}
    others = {name: [r for r in rows if r is not finest[name]] for name, rows in groups.items()}
    return groups, others, {name: {"finest": row["run"]} for name, row in finest.items()}


def strips(study):
    """Rows of strips, judged by the references; those to draw; facts."""
    args, found = study.args, {}
    names = args.scenes or list(STRIPS)[: 2 if args.quick else None]
    reference = read_references(args.reference, names, study.fabric, args.material)
    groups = rows_of(study, plan(names, args.quick))
    for name, rows in groups.items():
        good = fronts.judge(rows, reference[name])
        found[name] = {"runs": len(rows), "failed": len(rows) - len(good)}
    return groups, groups, found


def main(study):
    folder, is_forming = study.folder(), bool(study.args.forming)
    groups, drawn, found = (forming if is_forming else strips)(study)
    for name, rows in groups.items():
        found[name]["front"] = [row["run"] for row in rows if row.get("on_front")]
    rows = sum(groups.values(), [])
    table = [{k: v for k, v in row.items() if k != "curve"} for row in rows]
    bench.finish(study, {"table": table}, quantities=found, material=study.fabric.name)
    for row in rows:
        numbers = (f"{k} {row[k]:.3g}" if k != "reason" else row[k] for k in PRINTED if row.get(k))
        study.say(f"{row['run']}: {', '.join(numbers)}")
    if study.comm.rank == 0 and not study.args.no_pictures:
        name, cost_of = ("forming_front", "CPU") if is_forming else ("front", "wall")
        fronts.draw_fronts(folder / f"{name}.png", drawn, f"{cost_of} time / s")


if __name__ == "__main__":
    run("speed_vs_error", options(), main)
