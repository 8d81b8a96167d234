"""What accuracy costs: wall time and iterations against the error to studies/reference, over
elements, meshes, load steps, tolerances and linear solvers, one factor at a time from a baseline.
Forming is compared with its own finest run. Mesh and solver are the runs' own."""

from pathlib import Path

from bench import cost, fronts
from bench.cost_plan import plan, plan_forming
from bench.reference import read_references
from bench.strips import STRIPS
from tqdm import tqdm

from fabric_fenicsx.command_line.options import option_type
from fabric_fenicsx.command_line.study import parser, run
from fabric_fenicsx.coupons.coupon import Coupon
from fabric_fenicsx.runtime.rules import FINITE

REFERENCE = Path(__file__).resolve().parents[1] / "studies" / "reference"
PRINTED = "cost", "error_curve", "error_reaction", "error_strain", "reason"


def options():
    p = parser(Coupon, __doc__, "speed_vs_error")
    p.group("test")
    scenes = "of benchmarks/reference.py (all, with --quick the first two)"
    p.option("--scenes", nargs="+", choices=tuple(STRIPS), help=scenes)
    what = {"metavar": "DIR", "type": Path, "help": "what errors are to"}
    p.option("--reference", default=REFERENCE, **what)
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


def forming(study):
    """Forming over meshes and steps, judged by the finest run of each angle."""
    groups, found = rows_of(study, plan_forming(study.args.forming, study.args.quick)), {}
    others = {}
    for name, rows in groups.items():
        finest = fronts.judge_forming(rows)
        found[name] = {"finest": str(fronts.configuration(finest)), "front": front(rows)}
        others[name] = [row for row in rows if row is not finest]
    written(study, groups, quantities=found)
    if study.comm.rank == 0 and not study.args.no_pictures:
        fronts.draw_fronts(study.folder() / "forming_front.png", others, "CPU time / s")


def strips(study):
    """Runs of strips, judged by the references."""
    args, fabric, found = study.args, study.fabric, {}
    names = args.scenes or list(STRIPS)[: 2 if args.quick else None]
    reference = read_references(args.reference, names, fabric, args.material)
    groups = rows_of(study, plan(names, args.quick))
    for name, rows in groups.items():
        fronts.judge(rows, reference[name])
        found[name] = {"runs": len(rows), "failed": len(rows) - len(fronts.succeeded(rows))}
        found[name] |= {"front": front(rows)}
    written(study, groups, quantities=found, material=fabric.name)
    if study.comm.rank == 0 and not args.no_pictures:
        fronts.draw_fronts(study.folder() / "front.png", groups, "wall time / s")


def main(study):
    (forming if study.args.forming else strips)(study)


if __name__ == "__main__":
    run("speed_vs_error", options(), main)
