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


def options(description: str | None) -> Parser:
    """The parser of studies/identify.py."""
    p = Parser(prog=program("identify"), description=description)
    out = Path("results/identify/fabric.toml")
    p.add_argument("--data", metavar="DIR", type=Path, required=True, help=DATA)
    p.add_argument("--out", metavar="FILE", type=Path, default=out, help=OUT)
    p.add_argument("--no-pictures", action="store_true")
    p.add_argument("--overwrite", action="store_true", help="lose the material that --out is")
    p.add_argument("--homogeneous", action="store_true", help=HOMOGENEOUS)
    return p


def check(args: Namespace) -> None:
    """Raise InputError for options that do not fit together."""
    if ending(args.out) != ".toml":
        raise InputError(f"--out is {args.out}; allowed is a file that ends in .toml")
    if args.out.exists() and not args.overwrite:
        allowed = "another file, or --overwrite to lose it"
        raise InputError(f"--out {args.out} is there already; allowed is {allowed}")


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
