"""Coupon tests as data: what is tested, and how. `build` makes mesh and scene of it."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np
from mpi4py import MPI

from ..core.rules import FINITE
from ..energy.membrane import Membrane
from ..energy.term import Term
from ..job.job import Job
from ..job.setup import Setup
from ..material.laws import Law
from ..material.presets import load
from ..scene.scene import Scene
from ..scene.supports import Supports
from ..sheet.blank import Blank
from ..sheet.meshing import mesh_sheet
from ..sheet.sheet import FULL_TURN, SheetFields, declared_again


class OnMesh(Setup):
    """What `Coupon.build` adds to a test: its `scene`, and

    - comm, blank, membrane: its ranks, its mesh, and the term of its fabric
    - low, high (2,), area: corners [mm] and area [mm2] of the sheet
    """

    comm: MPI.Comm
    blank: Blank
    membrane: Membrane
    low: np.ndarray
    high: np.ndarray
    area: float
    fewer_steps = 4  # as states of coupons do not hang on steps


@dataclass(frozen=True, kw_only=True)
class Coupon(SheetFields, OnMesh):
    """A test of a sheet of `fabric`: a subclass says which, by `supports`, `measure` and what else
    of a `Setup` it needs, which all see the mesh.

    A field that is None has a default that depends on others; the test that `build` returns has
    them all.
    """

    NAME: ClassVar[str] = ""
    # of mesh and solver; with P2 and path_tolerance 1e-4 the cheapest with curves right to 0.1 %
    FULL: ClassVar[Mapping[str, int]] = {"nx": 32, "steps": 20}
    QUICK: ClassVar[Mapping[str, int]] = {"nx": 20, "steps": 5}
    SOLVER: ClassVar[Mapping[str, object]] = {}  # other defaults of its `Job`
    CHEAP_FROM: ClassVar[int] = 0  # cells from which errors are estimated unasked, 0: never
    HEADLINES: ClassVar[tuple[str, ...]] = ()  # quantities that get an estimated error

    fabric: Law = field(
        kw_only=False,
        default_factory=lambda: load("komeili"),
        metadata={"help": "the material, by default the preset `komeili`"},
    )
    fibre_angle: float = declared_again(SheetFields, "fibre_angle", rule=FULL_TURN)
    temperature: float | None = declared_again(SheetFields, "temperature", rule=FINITE)

    def build(self, comm: MPI.Comm | None = None) -> Self:
        """The test on its mesh on the ranks of `comm` (all), with all defaults filled in. Raises
        InputError as `mesh_sheet` does."""
        comm = comm or MPI.COMM_WORLD
        warm = {"fabric": self.fabric.at(self.temperature), "temperature": None}
        sheet = self.filled(**self.defaults(self.FULL["nx"]) | warm)
        turned = math.radians(getattr(self, "turned", 0.0))
        built, blank, warnings = mesh_sheet(sheet, comm, turned=turned)
        weave = self.weave_angle and math.radians(self.weave_angle)
        membrane = Membrane(built.fabric, integration=built.integration, weave_angle=weave)
        (low, high), area = blank.extent(), float(comm.allreduce(blank.areas().sum()))
        vars(built).update(comm=comm, blank=blank, membrane=membrane, low=low, high=high, area=area)
        warnings += built.sheet_warnings()
        scene = Scene(blank, [membrane, *built.terms()], built.supports())
        vars(built).update(vars(Setup(scene, built, warnings)))
        names = "nx", "ny", "size", "pattern", "element", "integration", *self.SIDES
        vars(built)["resolved"] = {name: getattr(built, name) for name in names}
        coarse = built.coarser()
        kinds = {(each.pattern, each.element in ("P1", "Q1")) for each in (coarse or built, built)}
        vars(built)["coarser_is_other_kind"] = len(kinds) == 2
        return built

    def sheet_warnings(self) -> list[str]:
        """Check what belongs together, once blank and membrane are there; sentences on the rest."""
        return []

    def terms(self) -> Iterable[Term]:
        """Terms of the scene besides the membrane."""
        return []

    def supports(self) -> Supports:
        """Supports of the scene."""
        raise NotImplementedError

    def job(self, **changes: Any) -> Job:
        """The `Job` of the test, which is built if it is not yet; changes: fields of `Job`."""
        return Job.of(self if hasattr(self, "scene") else self.build(), **changes)

    def coarser(self) -> Any:
        """The test with half the rectangles along each side; None for an own mesh."""
        return self.with_larger_cells(self.high - self.low)
