"""How good estimated errors are: runs with --error beside their true errors, to finer meshes. The
runs are drawn at random, by --seed; mesh, element and steps are their own."""

from dataclasses import replace

import bench
from bench import error_cases
from bench.cost import dome
from tqdm import tqdm

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import run

TESTS = {"tensile": ff.Tensile, "bias": ff.BiasExtension, "dome": dome}


def options():
    p = bench.options("error_estimates", __doc__)
    p.option("--only", nargs="+", choices=tuple(TESTS), default=list(TESTS))
    p.option("--seed", type=int, default=1, help="of the draw (1)")
    return p


def compared(study, case, outline):
    """Rows of a case; none if a run is not valid, as it has no error to judge."""
    quick = study.args.quick

    def solved(case, error):
        given = {k: v for k, v in case.options.items() if v is not None}
        given |= {"outline": str(outline)} if "size" in given else {}
        steps = {"steps": 4} if quick else {}
        return TESTS[case.test](study.fabric, **given).job(error=error, **steps).run()

    try:
        truth = [solved(each, False) for each in error_cases.finer(case, quick)]
        return error_cases.compare(case, solved(case, True), truth)
    except ff.SolverFailure as failure:
        study.say(f"{case}: {failure}")
        return []


def main(study):
    args, outline, rows = study.args, study.folder() / "outline.csv", []
    drawn = error_cases.cases(args.seed)
    if args.quick:  # of three those that have rectangles, with a quarter of them along each side
        quick = [case for case in drawn[:3] if "nx" in case.options]
        drawn = [replace(c, options=c.options | {"nx": c.options["nx"] // 4}) for c in quick]
    if study.comm.rank == 0:
        rings = ("\n".join(f"{x},{y}" for x, y in ring) for ring in error_cases.RINGS)
        outline.write_text("x,y\n" + "\n\n".join(rings) + "\n")
    study.comm.barrier()
    for case in tqdm([c for c in drawn if c.test in args.only], disable=None, leave=False):
        rows += compared(study, case, outline)
    judged = error_cases.judge(rows)
    bench.finish(study, {"errors": rows, "coverage": judged}, quantities={"coverage": judged})
    for row in judged:
        ratio, covered = row["estimated_over_true"], row["covered"]
        study.say(
            f"{row['quantity']:34s} {row['cases']:4d} cases, {100 * row['unknown']:.0f} % unknown, "
            f"{'-' if covered is None else f'{100 * covered:.1f} %'} of the others covered, "
            f"estimated over true error {ratio and f'{ratio:.2g}' or '-'} (median)"
        )


if __name__ == "__main__":
    run("error_estimates", options(), main)
