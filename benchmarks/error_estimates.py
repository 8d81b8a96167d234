"""How good estimated errors are: runs with --error beside their true errors, to finer meshes. The
runs are drawn at random, by --seed; mesh, element and steps are their own."""

from bench import error_cases
from bench.forming_cost import dome
from bench.once import once
from tqdm import tqdm

from fabric_fenicsx.command_line.study import parser, run
from fabric_fenicsx.coupons.coupon import BiasExtension, Coupon, Tensile
from fabric_fenicsx.runtime.errors import SolverFailure

TESTS = {"tensile": Tensile, "bias": BiasExtension, "dome": dome}


def options():
    p = parser(Coupon, __doc__, "error_estimates")
    p.group("test")
    p.option("--only", nargs="+", choices=tuple(TESTS), default=list(TESTS))
    p.option("--seed", type=int, default=1)
    return p


def main(study):
    args, folder, rows = study.args, study.folder(), []
    count = {"strips": 2, "domes": 0} if args.quick else {}
    chosen = [case for case in error_cases.cases(args.seed, **count) if case.test in args.only]
    outline = folder / "outline.csv"
    if study.comm.rank == 0:
        rings = ("\n".join(f"{x},{y}" for x, y in ring) for ring in error_cases.RINGS)
        outline.write_text("x,y\n" + "\n\n".join(rings) + "\n")
    study.comm.barrier()

    def solved(case, error):
        given = {k: v for k, v in case.options.items() if v is not None}
        given |= {"outline": str(outline)} if "size" in given else {}
        return TESTS[case.test](study.fabric, **given).job(error=error).run()

    def compared(case):
        try:
            truth = [solved(each, False) for each in error_cases.finer(case)]
            return error_cases.compare(case, solved(case, True), truth)
        except SolverFailure as failure:  # a run that is not believed has no error to judge
            study.say(f"{case}: {failure}")
            return []

    for case in tqdm(chosen, disable=None, leave=False):
        rows += once(study, str(case), lambda case=case: compared(case))
    judged = error_cases.judge(rows)
    study.write_table(folder / "errors.csv", rows)
    study.write_table(folder / "coverage.csv", judged)
    if study.comm.rank == 0 and not args.no_pictures:
        error_cases.draw(folder / "error_estimates.png", rows)
    study.summarise(folder, converged=True, stroke_reached=1.0, quantities={"coverage": judged})
    for row in judged:
        study.say(error_cases.line(row))


if __name__ == "__main__":
    run("error_estimates", options(), main)
