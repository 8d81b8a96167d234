"""Where load stepping stands, and what it tells of each state."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from petsc4py import PETSc

from .report import Report
from .viscosity import Viscosity


@dataclass
class Progress:
    """The last accepted state, in all that stepping needs to go on from it.

    - load: factor; step: size of the next load step, last_step: of the one before (None before the
      first)
    - x, previous: displacement and the one before it, vectors of the stepping's own [mm]
    - work: of supports, loads and tools so far; stored: sum of the energies as the state was
      accepted [N mm]
    - memory, solver: what scene and solver remember; viscosity
    - accepted, rejected: steps; iterations: of all solves
    """

    load: float
    step: float
    last_step: float | None
    work: float
    viscosity: Viscosity
    x: PETSc.Vec
    previous: PETSc.Vec
    memory: dict[str, np.ndarray] = field(default_factory=dict)
    solver: dict[str, Any] = field(default_factory=dict)
    accepted: int = 0
    rejected: int = 0
    iterations: int = 0
    stored: float = 0.0


@dataclass(frozen=True)
class Accepted:
    """An accepted state: load factor, energies by kind (with "viscous", what drag took so far) and
    external work [N mm], the report of its hardest solve, how often the step was cut before it was
    accepted, seconds since the last accepted state."""

    load: float
    energies: dict[str, float]
    external_work: float
    report: Report
    cuts: int
    wall: float
    progress: Progress


@dataclass(frozen=True)
class Outcome:
    """How load stepping ended: `reached` in [0, 1] and, if that is below 1 or the state there is
    not at rest, why; steps and iterations, also of the run that this one went on from."""

    reached: float
    reason: str
    accepted: int
    rejected: int
    iterations: int
