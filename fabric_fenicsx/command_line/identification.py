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


def options(description: str | None) -> Parser:
    """The parser of studies/identify.py."""
    p = Parser(prog=program("identify"), description=description)
    words = "folder with sheet.toml and a CSV file a test; see docs/howto/own_data.md"
    p.option("--data", metavar="DIR", type=Path, required=True, help=words)
    out, words = Path("results/identify/fabric.toml"), "the material; report and pictures beside it"
    p.option("--out", metavar="FILE", type=Path, default=out, help=words)
    p.switch("--no-pictures", "draw nothing")
    p.switch("--overwrite", "lose the material that --out is")
    words = "fit bias tests of force over displacement by formula, not by simulating specimens"
    p.switch("--homogeneous", words)
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
