"""Linear solvers by name: their options, MUMPS' room and the inertia it tells."""

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
from petsc4py import PETSc

from ..runtime.errors import InputError

PREFIX = "fabric_"  # of PETSc's options
# In PORD's order of elimination factors cost least: approximate minimum degree takes 1.1 times as
# long on one ply and 1.3 times on a laminate, minimum fill up to 1.8 times. Rows are not scaled:
# that would take 5 to 20 % more and leave the same residual, 1e-14.
MUMPS = {"mat_mumps_icntl_7": 4, "mat_mumps_icntl_8": 0}
# PORD ends the process where all unknowns are coupled, as in a single cell: minimum degree there
FULL = {"mat_mumps_icntl_7": 0}
LINEAR_SOLVERS: dict[str, dict[str, Any]] = {
    "mumps-cholesky": {
        "ksp_type": "preonly",
        "pc_type": "cholesky",
        "mat_mumps_icntl_24": 1,
        **MUMPS,
    },
    "mumps-lu": {"ksp_type": "preonly", "pc_type": "lu", **MUMPS},
    # flexible: their smoothers are not quite symmetric, which matters with yarns 50 000 times
    # stiffer than shear
    "cg-gamg": {
        "ksp_type": "fcg",
        "pc_type": "gamg",
        "pc_gamg_agg_nsmooths": 0,
        "ksp_rtol": 1e-8,
        "ksp_max_it": 2000,
    },
    "cg-hypre": {"ksp_type": "fcg", "pc_type": "hypre", "ksp_rtol": 1e-8, "ksp_max_it": 2000},
}
MUMPS_ROOM = 14  # its option for how much more than estimated it may take [%]
NOT_DEFINITE = {  # singular too: a membrane without tension has no stiffness across itself
    getattr(PETSc.KSP.ConvergedReason, "DIVERGED_" + name)
    for name in ("INDEFINITE_MAT", "INDEFINITE_PC", "PCSETUP_FAILED")
}


KSP_WORDS = {
    value: name.lower().replace("_", " ").replace("diverged ", "")
    for name, value in vars(PETSc.KSP.ConvergedReason).items()
    if isinstance(value, int)
}


def is_there(name: str) -> bool:
    """Whether PETSc was built with what the linear solver `name` needs; pip's has no hypre."""
    return name != "cg-hypre" or bool(PETSc.Sys.hasExternalPackage("hypre"))


def check_name(name: str) -> None:
    """Raise InputError for a linear solver that is not there."""
    allowed = [each for each in LINEAR_SOLVERS if is_there(each)]
    if name not in allowed:
        why = ", and this PETSc has no hypre" if name in LINEAR_SOLVERS else ""
        raise InputError(f"linear solver is {name!r}{why}; allowed are {', '.join(allowed)}")


def configure(ksp: PETSc.KSP, A: PETSc.Mat, name: str) -> None:
    """Make `ksp` the linear solver `name`, one of `LINEAR_SOLVERS`, of the matrix A."""
    options, given = PETSc.Options(PREFIX), dict(LINEAR_SOLVERS[name])
    ksp.setOperators(A)
    if name.startswith("mumps"):
        given |= FULL if _is_full(A) else {}
        ksp.pc.setType(given["pc_type"])
        ksp.pc.setFactorSolverType("mumps")
    for key, value in given.items():
        if key not in _users_options():
            options[key] = value
    ksp.setFromOptions()
    for key in given:
        # read only when the factor is made; read here too, as PETSc reports unused options
        if key.startswith("mat_mumps"):
            options.getInt(key)
        else:
            options.delValue(key)


def _is_full(A):
    """Whether all entries of a matrix have a place."""
    return A.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_allocated"] >= A.size[0] * A.size[1]


@functools.cache
def _users_options():
    """Those of `MUMPS` that the user gave to PETSc; asked before they are set here."""
    return [key for key in MUMPS if PETSc.Options(PREFIX).hasName(key)]


def factorisation_had_room(pc: PETSc.PC) -> bool:
    """False if MUMPS ran out of the room that its analysis foresaw, as where many pivots were zero
    then and are not now. It then starts anew, with more: after an error it would never factor
    again."""
    if pc.getType() not in ("lu", "cholesky") or pc.getFactorSolverType() != "mumps":
        return True
    factor = pc.getFactorMatrix()
    room = factor.getMumpsIcntl(MUMPS_ROOM)
    if factor.getMumpsInfog(1) >= 0 or room > 10_000:
        return True
    PETSc.Options(PREFIX)[f"mat_mumps_icntl_{MUMPS_ROOM}"] = 5 * room
    pc.reset()
    return False


def inertia(pc: PETSc.PC) -> tuple[int, int]:
    """Negative and zero pivots of the last factorisation by `mumps-cholesky`."""
    return pc.getFactorMatrix().getInertia()[:2]


def subtract_compliances(
    ksp: PETSc.KSP, given: Sequence[tuple[PETSc.Vec, float]], d: PETSc.Vec, rounding: float
) -> bool:
    """Make d, which `ksp` solved for, the solution with the tangent less c c^T / k for each `given`
    c and k [N/mm], as of tools that a force moves (Woodbury's formula). False, and d unchanged, if
    that tangent is not positive definite; rounding: share of the largest k that counts as 0."""
    if not given:
        return True
    solved = [c.duplicate() for c, _ in given]
    for (c, _), y in zip(given, solved):
        ksp.solve(c, y)
    given_up = np.array([[c.dot(y) for y in solved] for c, _ in given])
    stiffness = np.array([k for _, k in given])
    left = np.diag(stiffness) - (given_up + given_up.T) / 2
    # none where sheet and tool can go together unresisted
    if np.linalg.eigvalsh(left)[0] <= rounding * stiffness.max():
        return False
    for travel, y in zip(np.linalg.solve(left, [c.dot(d) for c, _ in given]), solved):
        d.axpy(travel, y)
    return True
