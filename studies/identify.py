"""The parameters of a woven fabric from test curves: a material file, a report and pictures in one
go."""

import json
import platform
import sys
import time

import numpy as np
import scipy

from fabric_fenicsx import __version__, identification
from fabric_fenicsx.command_line.identification import check, identified, is_first_rank, options
from fabric_fenicsx.command_line.options import exit_status, program, restart_command
from fabric_fenicsx.identification import curves
from fabric_fenicsx.results import report as html
from fabric_fenicsx.runtime.errors import InputError, SolverFailure
from fabric_fenicsx.runtime.status import shown, task


def write_report(args, path, report, started):
    numbers = int, float
    given = {k: v if isinstance(v, numbers) else v and str(v) for k, v in vars(args).items()}
    versions = {"fabric_fenicsx": __version__, "scipy": scipy.__version__}
    versions |= {"numpy": np.__version__, "python": platform.python_version()}
    report = {"study": "identify", "converged": True} | report
    report |= {"command": restart_command(), "options": given}
    report |= {"wall_s": {"total": round(time.perf_counter() - started, 3)}, "versions": versions}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(report, indent=2, ensure_ascii=False)
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"--out {args.out} can't be written to ({error.strerror}); "
            "allowed is a file in a folder that is there or can be made"
        ) from None


def main(args):
    check(args)
    started = time.perf_counter()
    result = identified(*curves.read(args.data), args.homogeneous)
    report = {"data": str(args.data)} | result.report()
    write_report(args, args.out.with_suffix(".json"), report, started)
    result.fabric.to_toml(args.out, result.remarks())
    if not args.no_pictures:
        identification.draw(result, args.out.with_suffix(""))
    files = args.out.with_suffix(".json"), args.out.parent.glob(f"{args.out.stem}_*.png")
    page = html.page("identify", {"": files}, __doc__, "done")
    args.out.with_suffix(".html").write_text(page)
    print(*identification.result_lines(result), sep="\n")
    print(
        f"{args.out}: {len(result.determined)} of {report['parameters']} parameters determined, "
        f"{len(result.assumed)} assumed"
    )


if __name__ == "__main__":
    try:
        if is_first_rank():
            with shown(), task(program("identify")):
                main(options(__doc__).parse_args())
    except (InputError, SolverFailure) as error:
        status, text = exit_status(error)
        print(f"{program('identify')}: {text}", file=sys.stderr)
        sys.exit(status)
