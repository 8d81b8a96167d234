"""The state of load stepping, and its messages to observers."""

from dataclasses import dataclass, field

import numpy as np
from petsc4py import PETSc

from .report import Report
from .viscosity import Viscosity


@dataclass
class Progress:
    """The last accepted state, complete for stepping to go on from it.

    - x, previous: displacement and the one before it, own copies [mm]
    - load: factor; step: size of the next load step; last_step: of the one before, None before the
      first
    - work: of supports, loads and tools so far; stored: sum of the energies [N mm]
    - missed, missed_at: energy that a step rejected for that missed [N mm], and its load factor,
      until that is passed; inf without such a step
    - memory, solver: memories of scene and solver
    - accepted, rejected: steps; iterations: of all solves
    """

    x: PETSc.Vec
    previous: PETSc.Vec
    step: float
    load: float = 0.0
    last_step: float | None = None
    work: float = 0.0
    stored: float = 0.0
    missed: float = np.inf
    missed_at: float = 0.0
    viscosity: Viscosity = field(default_factory=Viscosity)
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    solver: dict[str, float] = field(default_factory=dict)
    accepted: int = 0
    rejected: int = 0
    iterations: int = 0


@dataclass(frozen=True)
class Accepted:
    """An accepted state: load factor, energies by kind (with "viscous", what drag took so far) and
    external work [N mm], the report of its hardest solve, cuts of the step before it was accepted,
    seconds since the last accepted state."""

    load: float
    energies: dict[str, float]
    external_work: float
    report: Report
    cuts: int
    wall: float
    progress: Progress


@dataclass(frozen=True)
class Outcome:
    """End of load stepping: the load factor `reached` and, if that is below 1 or the state there is
    not at rest, the reason; steps and iterations, with those of the run that was resumed."""

    reached: float
    reason: str
    accepted: int
    rejected: int
    iterations: int
