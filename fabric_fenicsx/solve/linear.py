"""Linear solvers by name: their options, and MUMPS' memory and inertia."""

import functools

from petsc4py import PETSc

from ..core.errors import InputError

PREFIX = "fabric_"  # of PETSc's options
LINEAR_SOLVERS: dict[str, dict[str, str | float]] = {
    "mumps-cholesky": {"pc_type": "cholesky", "mat_mumps_icntl_24": 1},
    "mumps-lu": {"pc_type": "lu"},
    "cg-gamg": {"pc_type": "gamg", "pc_gamg_agg_nsmooths": 0},
    "cg-hypre": {"pc_type": "hypre"},
}


def _options(name):
    if name.startswith("mumps"):
        # In PORD's order of elimination factors cost least: approximate minimum degree takes 1.1
        # times as long on one ply and 1.3 times on a laminate, minimum fill up to 1.8 times. Rows
        # are not scaled: that would take 5 to 20 % more and leave the same residual, 1e-14.
        usual = {"ksp_type": "preonly", "mat_mumps_icntl_7": 4, "mat_mumps_icntl_8": 0}
    else:
        # flexible: their smoothers are not quite symmetric, which matters with yarns 50 000 times
        # stiffer than shear
        usual = {"ksp_type": "fcg", "ksp_rtol": 1e-8, "ksp_max_it": 2000}
    return usual | LINEAR_SOLVERS[name]


def reason_name(reason: int) -> str:
    """Name of the reason for which a KSP ended."""
    for name, value in vars(PETSc.KSP.ConvergedReason).items():
        if value == reason and not name.startswith("_"):
            return name.lower().replace("_", " ").replace("diverged ", "")
    return "unknown reason"


def is_there(name: str) -> bool:
    """True if PETSc has what the linear solver `name` needs; pip's lacks hypre."""
    return name != "cg-hypre" or bool(PETSc.Sys.hasExternalPackage("hypre"))


def check_name(name: str) -> None:
    """Raise InputError for a linear solver that is not there."""
    allowed = [each for each in LINEAR_SOLVERS if is_there(each)]
    if name not in allowed:
        why = ", and this PETSc has no hypre" if name in LINEAR_SOLVERS else ""
        raise InputError(f"linear solver is {name!r}{why}; expected {', '.join(allowed)}")


def places(A: PETSc.Mat) -> float:
    """Number of A's places on all ranks, of which none is used before it is assembled."""
    known = A.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)
    return max(known["nz_allocated"], known["nz_used"])


def configure(ksp: PETSc.KSP, A: PETSc.Mat, name: str) -> None:
    """Make `ksp` the linear solver `name`, one of `LINEAR_SOLVERS`, of the matrix A."""
    database, options = PETSc.Options(PREFIX), _options(name)
    ksp.setOperators(A)
    if name.startswith("mumps"):
        if places(A) >= A.size[0] * A.size[1]:  # PORD ends the process then: minimum degree there
            options["mat_mumps_icntl_7"] = 0
        ksp.pc.setType(options["pc_type"])
        ksp.pc.setFactorSolverType("mumps")
    for key, value in options.items():
        if key not in _users_options():
            database[key] = value
    ksp.setFromOptions()
    for key in options:
        # read only when the factor is made; read here too, as PETSc reports unused options
        if key.startswith("mat_mumps"):
            database.getInt(key)
        else:
            database.delValue(key)


def conjugate_gradients(A: PETSc.Mat, P: PETSc.Mat, reduction: float, most: int) -> PETSc.KSP:
    """A solver of A by conjugate gradients, with the factors of P by `mumps-cholesky`, at `most` so
    many; reduction: of the error in the energy norm."""
    ksp = PETSc.KSP().create(P.comm)
    ksp.setOptionsPrefix(PREFIX)
    configure(ksp, P, "mumps-cholesky")
    ksp.setType(PETSc.KSP.Type.CG)
    ksp.setNormType(PETSc.KSP.NormType.NATURAL)
    ksp.setTolerances(rtol=reduction, atol=0.0, max_it=most)
    ksp.setOperators(A, P)
    return ksp


@functools.cache
def _users_options():
    """Keys that the user gave to PETSc, found before they are set here."""
    return [key for key in _options("mumps-lu") if PETSc.Options(PREFIX).hasName(key)]


def had_memory(pc: PETSc.PC) -> bool:
    """False if MUMPS ran out of the memory that its analysis estimated, as where many pivots were
    zero then and are not now. It then restarts with more, as it cannot factor after an error."""
    if pc.getType() not in ("lu", "cholesky") or pc.getFactorSolverType() != "mumps":
        return True
    factor, option = pc.getFactorMatrix(), 14  # memory beyond the estimate [%]
    margin = factor.getMumpsIcntl(option)
    if factor.getMumpsInfog(1) >= 0 or margin > 10_000:
        return True
    PETSc.Options(PREFIX)[f"mat_mumps_icntl_{option}"] = 5 * margin
    pc.reset()
    return False


def inertia(pc: PETSc.PC) -> tuple[int, int]:
    """Negative and zero pivots of the last factorisation by `mumps-cholesky`."""
    return pc.getFactorMatrix().getInertia()[:2]
