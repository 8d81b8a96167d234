"""Options of studies/identify.py."""

from argparse import Namespace
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from .. import identification
from ..identification.curves import Curve, Sheet
from ..runtime.errors import InputError
from ..runtime.files import ending
from .options import Parser, program

DATA = "folder with sheet.toml and a CSV file a test; see docs/howto/own_data.md"
OUT = "the material; report and pictures go beside it"
HOMOGENEOUS = (
    "fit bias tests of force over displacement by formula, not by simulating their specimens"
)
TESTS = "paper: what the paper had, which leaves 3 of 10 parameters assumed"
COVERAGE = (
    "fit N seeds and count how often each true value lies in its 95 %% interval; "
    "no material is written"
)


def options(description: str | None) -> Parser:
    """The parser of studies/identify.py."""
    p = Parser(prog=program("identify"), description=description)
    out = Path("results/identify/fabric.toml")
    p.add_argument("--data", metavar="DIR", type=Path, help=DATA)
    p.add_argument("--out", metavar="FILE", type=Path, default=out, help=OUT)
    p.add_argument("--no-pictures", action="store_true")
    p.add_argument("--overwrite", action="store_true", help="lose the material that --out is")
    p.add_argument("--homogeneous", action="store_true", help=HOMOGENEOUS)
    synthetic = p.add_argument_group("synthetic data")
    first = "first write the curves of this material to --data"
    synthetic.add_argument("--synthesize", metavar="FILE|PRESET", help=first)
    tests = tuple(identification.PLANS)
    synthetic.add_argument("--tests", choices=tests, default="all", help=TESTS)
    noise = "standard deviation over each column's largest value"
    synthetic.add_argument("--noise", type=float, default=0.0, help=noise)
    synthetic.add_argument("--seed", type=int, default=1)
    synthetic.add_argument("--coverage", metavar="N", type=int, help=COVERAGE)
    return p


def check(args: Namespace) -> None:
    """Raise InputError for options that do not fit together."""
    new = args.coverage is None
    if ending(args.out) != ".toml":
        raise InputError(f"--out is {args.out}; allowed is a file that ends in .toml")
    if args.out.exists() and not args.overwrite and new:
        allowed = "another file, or --overwrite to lose it"
        raise InputError(f"--out {args.out} is there already; allowed is {allowed}")
    if not 0 <= args.noise < 1 or args.seed < 0:
        allowed = "a noise from 0 to below 1 and a seed of 0 or more"
        raise InputError(f"--noise is {args.noise} and --seed {args.seed}; allowed is {allowed}")
    if new and args.data is None:
        allowed = "a folder with test curves, or a new one with --synthesize"
        raise InputError(f"--data is missing; allowed is {allowed}")
    if not new and (args.coverage < 1 or not args.synthesize or not args.noise):
        raise InputError("--coverage needs 1 seed or more, --synthesize and a --noise above 0")
    if args.synthesize and new and args.data.is_dir() and any(args.data.iterdir()):
        allowed = "allowed with --synthesize is a folder that is new or empty"
        raise InputError(f"--data {args.data} is not empty; {allowed}")


def is_first_rank() -> bool:
    """True on one of all ranks, which does all the work."""
    if not find_spec("dolfinx"):
        return True
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1:
        from petsc4py import PETSc  # noqa: F401, as ranks start and end it together
    return not MPI.COMM_WORLD.rank


def identified(
    sheet: Sheet, curves: Sequence[Curve], homogeneous: bool
) -> identification.Identification:
    """The fit: of simulated specimens where there are raw bias tests, DOLFINx is there and
    `homogeneous` is not asked for. Raises InputError, SolverFailure."""
    if homogeneous or not find_spec("dolfinx") or not any(curve.is_raw for curve in curves):
        return identification.identify(sheet, curves)
    from ..coupons.simulated import simulated_bias

    def simulate(fabric, curve):
        shear = ", ".join(f"{name} {getattr(fabric, name):.4g}" for name in ("s1", "s2", "s3"))
        print(f"{curve.file}: simulating its specimen with {shear} MPa", flush=True)
        return simulated_bias(fabric, curve)

    return identification.identify_simulated(sheet, curves, simulate)
