"""The parameters of a woven fabric from test curves: a material file, a report and pictures in one
go."""

import json
import platform
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import scipy

from fabric_fenicsx import __version__, identification
from fabric_fenicsx.cli.options import Parser, exit_status, program, restart_command
from fabric_fenicsx.core.errors import InputError, SolverFailure
from fabric_fenicsx.core.files import check_new, ending
from fabric_fenicsx.core.status import shown, task
from fabric_fenicsx.identification import curves
from fabric_fenicsx.results import report as html
from fabric_fenicsx.studies.lib.identified import draw, result_lines


def options():
    p = Parser(prog=program("identify"), description=__doc__)
    words = "folder with sheet.toml and a CSV file a test; see docs/howto/own_data.md"
    p.option("--data", metavar="DIR", type=Path, required=True, help=words)
    out, words = Path("results/identify/fabric.toml"), "material file, with report and pictures"
    p.option("--out", metavar="FILE", type=Path, default=out, help=words)
    p.switch("--no-pictures", "draw nothing")
    p.switch("--overwrite", "replace an existing material file")
    words = "fit bias tests of force against displacement by a formula, without simulation"
    p.switch("--homogeneous", words)
    return p


def check(args):
    """InputError for options that do not fit together."""
    if ending(args.out) != ".toml":
        raise InputError(f"--out is {args.out}; expected a file that ends in .toml")
    ends = ".toml", ".json", ".html", "_fit.png", "_residuals.png", "_correlation.png"
    files = (args.out.with_name(args.out.stem + end) for end in (*ends, "_compaction.png"))
    check_new(*files, overwrite=args.overwrite)


def is_first_rank():
    """True on one of all ranks, which does all the work."""
    if not find_spec("dolfinx"):
        return True
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1:
        from petsc4py import PETSc  # noqa: F401, as ranks start and end it together
    return not MPI.COMM_WORLD.rank


def identified(sheet, tests, homogeneous):
    """The fit: of simulated specimens where there are raw bias tests, DOLFINx is there and
    `homogeneous` is not asked for."""
    if homogeneous or not find_spec("dolfinx") or not any(test.is_raw for test in tests):
        return identification.identify(sheet, tests)
    from fabric_fenicsx.coupons.simulated import simulated_bias

    def simulate(fabric, curve):
        shear = ", ".join(f"{name} {getattr(fabric, name):.4g}" for name in ("s1", "s2", "s3"))
        print(f"{curve.file}: simulating its specimen with {shear} MPa", flush=True)
        return simulated_bias(fabric, curve)

    return identification.identify_simulated(sheet, tests, simulate)


def write_report(args, path, report, started):
    numbers = int, float
    given = {k: v if isinstance(v, numbers) else v and str(v) for k, v in vars(args).items()}
    versions = {"fabric_fenicsx": __version__, "scipy": scipy.__version__}
    versions |= {"numpy": np.__version__, "python": platform.python_version()}
    report = {"study": "identify", "converged": True} | report
    report |= {"command": restart_command(), "options": given}
    report |= {"wall_s": {"total": round(time.perf_counter() - started, 3)}, "versions": versions}
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(report, indent=2, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def main(args):
    check(args)
    started = time.perf_counter()
    result = identified(*curves.read(args.data), args.homogeneous)
    report = {"data": str(args.data)} | result.report()
    write_report(args, args.out.with_suffix(".json"), report, started)
    result.fabric.to_toml(args.out, result.remarks())
    if not args.no_pictures:
        draw(result, args.out.with_suffix(""))
    files = args.out.with_suffix(".json"), args.out.parent.glob(f"{args.out.stem}_*.png")
    page = html.page("identify", {"": files}, __doc__, "done")
    args.out.with_suffix(".html").write_text(page, encoding="utf-8")
    print(*result_lines(result), sep="\n")
    print(
        f"{args.out}: {len(result.determined)} of {report['parameters']} parameters determined, "
        f"{len(result.assumed)} assumed"
    )


if __name__ == "__main__":
    try:
        if is_first_rank():
            with shown(), task(program("identify")):
                main(options().parse_args())
    except (InputError, SolverFailure, OSError) as error:
        status, text = exit_status(error)
        print(f"{program('identify')}: {text}", file=sys.stderr)
        sys.exit(status)
