"""The parameters of a woven fabric from test curves: a material file, a report and pictures in one go."""

import json
import platform
import sys
import time
from pathlib import Path

import numpy as np
import scipy

from fabric_fenicsx import __version__
from fabric_fenicsx.cli import Help, Parser, command, exit_status
from fabric_fenicsx.errors import InputError, SolverFailure
from fabric_fenicsx.material import curves, identification
from fabric_fenicsx.material.parameters import WovenFabric
from fabric_fenicsx.material.presets import load
from fabric_fenicsx.results import report as html


def options():
    p = Parser(
        prog="studies/identify.py",
        description=__doc__,
        formatter_class=Help,
        allow_abbrev=False,
    )
    p.add_argument(
        "--data",
        metavar="DIR",
        type=Path,
        help="folder with sheet.toml and a CSV file a test; see fabric_fenicsx/material/curves",
    )
    p.add_argument(
        "--out",
        metavar="FILE",
        type=Path,
        default=Path("results/identify/fabric.toml"),
        help="the material; report and pictures go beside it",
    )
    p.add_argument("--no-pictures", action="store_true")
    p.add_argument("--overwrite", action="store_true", help="lose the material that --out is")
    synthetic = p.add_argument_group("synthetic data")
    synthetic.add_argument(
        "--synthesize", metavar="FILE|PRESET", help="first write the curves of this material to --data"
    )
    synthetic.add_argument(
        "--tests",
        choices=tuple(identification.PLANS),
        default="all",
        help="paper: what the paper had, which leaves 3 of 10 parameters assumed",
    )
    synthetic.add_argument(
        "--noise", type=float, default=0.0, help="standard deviation over each column's largest value"
    )
    synthetic.add_argument("--seed", type=int, default=1)
    synthetic.add_argument(
        "--coverage",
        metavar="N",
        type=int,
        help="fit N seeds and count how often each true value lies in its 95 %% interval; no material is written",
    )
    return p


def check(args):
    if args.out.suffix != ".toml":
        raise InputError(f"--out is {args.out}; allowed is a file that ends in .toml")
    if args.out.exists() and not args.overwrite and args.coverage is None:
        raise InputError(f"--out {args.out} is there already; allowed is another file, or --overwrite to lose it")
    if not 0 <= args.noise < 1 or args.seed < 0:
        raise InputError(
            f"--noise is {args.noise} and --seed {args.seed}; allowed is a noise from 0 to below 1 and a seed of 0 or more"
        )
    if args.coverage is None and args.data is None:
        raise InputError("--data is missing; allowed is a folder with test curves, or a new one with --synthesize")
    if args.coverage is not None and (args.coverage < 1 or not args.synthesize or not args.noise):
        raise InputError("--coverage needs 1 seed or more, --synthesize and a --noise above 0")
    if args.synthesize and args.coverage is None and args.data.is_dir() and any(args.data.iterdir()):
        raise InputError(f"--data {args.data} is not empty; allowed with --synthesize is a folder that is new or empty")


def write_report(args, path, report, started):
    versions = {
        "fabric_fenicsx": __version__,
        "scipy": scipy.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
    report = (
        {"study": "identify", "converged": True}
        | report
        | {
            "command": command(),
            "options": {k: v if isinstance(v, (int, float)) else v and str(v) for k, v in vars(args).items()},
        }
        | {"wall_s": {"total": round(time.perf_counter() - started, 3)}, "versions": versions}
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(report, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"--out {args.out} can't be written to ({error.strerror}); allowed is a file in a folder that is there or can be made"
        ) from None


def main(args):
    check(args)
    started = time.perf_counter()
    fabric = load(args.synthesize) if args.synthesize else None
    if fabric and not isinstance(fabric, WovenFabric):
        raise InputError(
            f"--synthesize {args.synthesize} is a fabric of tabulated curves; allowed is one with parameters"
        )
    if args.coverage is not None:
        found = identification.coverage(fabric, args.tests, args.noise, range(args.seed, args.seed + args.coverage))
        write_report(args, args.out.with_name(args.out.stem + "_coverage.json"), found, started)
        for name, inside in found["inside"].items():
            print(
                f"{name:12s} in its 95 % interval {inside} of {found['determined'][name]} times, {found['seeds']} seeds"
            )
        return
    if fabric:
        sheet, tests = identification.synthesise(fabric, args.tests, args.noise, args.seed)
        remark = f"synthetic, from {args.synthesize} with seed {args.seed} and normal noise of {100 * args.noise:g} % of each column's largest value"
        curves.write(args.data, sheet, tests, [remark])
    result = identification.identify(*curves.read(args.data))
    report = {"data": str(args.data)} | result.report()
    write_report(args, args.out.with_suffix(".json"), report, started)
    result.fabric.to_toml(args.out, result.remarks())
    if not args.no_pictures:
        identification.draw(result, args.out.with_suffix(""))
    files = args.out.with_suffix(".json"), args.out.parent.glob(f"{args.out.stem}_*.png")
    page = html.page("identify", {"": files}, __doc__, "done")
    args.out.with_suffix(".html").write_text(page)
    for name, p in result.determined.items():
        print(f"{name:12s} {p.value:12.6g} {p.unit:4s} 95 % interval {p.interval[0]:.6g} to {p.interval[1]:.6g}")
    for name, p in result.assumed.items():
        print(f"{name:12s} {p.value:12.6g} {p.unit:4s} {p}")
    for curve in report["curves"]:
        print(
            f"{curve['file']}: r.m.s. error of {curve['column']} {curve['rms_error']:.4g} {curve['unit']}, {100 * curve['rms_error_of_peak']:.2g} % of its peak"
        )
    if result.areal_weight is not None:
        print(f"density {result.fabric.density:.4g} g/cm3 = areal weight {result.areal_weight:g} g/m2 / thickness")
    for warning in result.warnings:
        print(f"warning: {warning}")
    print(
        f"{args.out}: {len(result.determined)} of {report['parameters']} parameters determined, {len(result.assumed)} assumed"
    )


if __name__ == "__main__":
    try:
        main(options().parse_args())
    except (InputError, SolverFailure) as error:
        status, text = exit_status(error)
        print(f"studies/identify.py: {text}", file=sys.stderr)
        sys.exit(status)
