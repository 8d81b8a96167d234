"""How good estimated errors are: runs with --error beside their true errors, to studies/reference
or to a finer mesh. Mesh, element and steps are the runs' own."""

from functools import cache
from pathlib import Path

from bench import error_cases
from bench.forming_cost import dome
from bench.reference import read_references
from tqdm import tqdm

from fabric_fenicsx.command_line.study import parser, run
from fabric_fenicsx.coupons.coupon import BiasExtension, Coupon, Tensile

REFERENCE = Path(__file__).resolve().parents[1] / "studies" / "reference"
TESTS = {
    "tensile": (Tensile, {}),
    "bias10": (BiasExtension, {}),
    "bias30": (BiasExtension, {"strain": 0.3}),
    "off30": (BiasExtension, {"fibre_angle": 30.0}),
    "off20": (BiasExtension, {"fibre_angle": 20.0, "strain": 0.03}),
    "off10": (BiasExtension, {"fibre_angle": 10.0, "strain": 0.005}),
    "forming": (dome, {}),
}


def options():
    p = parser(Coupon, __doc__, "error_estimates")
    p.group("test")
    p.option("--only", nargs="+", choices=tuple(TESTS), default=list(TESTS))
    return p


def main(study):
    args, folder, rows = study.args, study.folder(), []
    chosen = [case for case in error_cases.cases(args.quick) if case.test in args.only]
    strips = sorted({case.test for case in chosen} - {"forming", *error_cases.OFF_AXIS})
    known = read_references(REFERENCE, strips, study.fabric, args.material)

    @cache
    def solved(case, error):
        kind, more = TESTS[case.test]
        more = more | ({"fibre_angle": case.fibre_angle} if case.test == "forming" else {})
        mesh = {"element": case.element, "nx": case.nx, "pattern": case.pattern}
        return kind(study.fabric, **mesh, **more).job(error=error).run()

    def compared(case):
        fine = error_cases.finest_of(case, args.quick)
        finest = fine and solved(fine, False)
        mine = solved.__wrapped__(case, True)
        if case.test in error_cases.OFF_AXIS:
            return error_cases.compare(case, mine, None, error_cases.OFF_AXIS[case.test])
        return error_cases.compare(case, mine, finest, known.get(case.test), REFERENCE)

    for case in tqdm(chosen, disable=None, leave=False):
        rows += study.once(str(case), lambda case=case: compared(case))
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
