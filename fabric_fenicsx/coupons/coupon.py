"""Coupon tests as data: what is tested, and how. `build` makes mesh and scene of it."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

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
from ..sheet.meshing import mesh_sheet
from ..sheet.sheet import FULL_TURN, SheetFields, Values, declared_again


class CouponSetup(Setup):
    """A coupon test on the ranks of `comm`; a subclass says what is put on its `blank`.

    `data` is then the description with all defaults filled in. Raises InputError as
    `mesh_sheet` does.
    """

    fewer_steps = 4  # as states of coupons do not hang on steps

    def __init__(self, data: Any, comm: MPI.Comm | None = None) -> None:
        self.comm = comm or MPI.COMM_WORLD
        sheet = data.filled(**data.defaults(data.FULL["nx"]))
        turned = math.radians(getattr(data, "turned", 0.0))
        self.data, self.blank, self.warnings = mesh_sheet(sheet, self.comm, turned=turned)
        self.low, self.high = self.blank.extent()  # corners (2,) [mm]
        weave = data.weave_angle and math.radians(data.weave_angle)
        self.membrane = Membrane(
            self.data.fabric, integration=self.data.integration, weave_angle=weave
        )
        self.prepare()
        terms = [self.membrane, *self.terms()]
        super().__init__(Scene(self.blank, terms, self.supports()), self.data, self.warnings)
        names = "nx", "ny", "size", "pattern", "element", "integration", *data.SIDES
        self.resolved = {name: getattr(self.data, name) for name in names}
        coarse = self.coarser()
        self.coarser_is_other_kind = bool(coarse) and coarse.pattern != self.data.pattern

    def prepare(self) -> None:
        """Check what belongs together, once blank and membrane are there."""

    def terms(self) -> Iterable[Term]:
        """Terms of the scene besides the membrane."""
        return []

    def supports(self) -> Supports:
        """Supports of the scene."""
        raise NotImplementedError

    def job(self, **changes: Any) -> Job:
        """The `Job` of this test with its defaults, `changes` in its fields."""
        return Job.of(self, **changes)

    def coarser(self) -> Any:
        """The data with half the rectangles along each side; None for an own mesh."""
        return self.data.coarser(self.high - self.low)


@dataclass(frozen=True, kw_only=True)
class Coupon(SheetFields):
    """A test of a sheet of `fabric`, as data; a subclass says which test.

    A field that is None has a default that depends on others; `build().data` has them all.
    """

    SETUP: ClassVar[type[CouponSetup]]  # what it is when it is built
    NAME: ClassVar[str] = ""
    # of mesh and solver; with P2 and path_tolerance 1e-4 the cheapest with curves right to 0.1 %
    FULL: ClassVar[Mapping[str, object]] = {"nx": 32, "steps": 20}
    QUICK: ClassVar[Mapping[str, object]] = {"nx": 20, "steps": 5}
    SOLVER: ClassVar[Mapping[str, object]] = {}  # other defaults of its `Job`
    CHEAP_FROM: ClassVar[int] = 0  # cells from which errors are estimated unasked, 0: never
    HEADLINES: ClassVar[tuple[str, ...]] = ()  # quantities that get an estimated error

    fabric: Law = field(kw_only=False, default_factory=lambda: load("komeili"))
    fibre_angle: float = declared_again(SheetFields, "fibre_angle", rule=FULL_TURN)
    temperature: float | None = declared_again(SheetFields, "temperature", rule=FINITE)

    def defaults(self, nx: int) -> Values:
        """As in `SheetFields`, and the fabric at its temperature."""
        warm = {"fabric": self.fabric.at(self.temperature), "temperature": None}
        return super().defaults(nx) | warm

    def build(self, comm: MPI.Comm | None = None) -> Any:
        """Its `SETUP`: mesh the sheet and make its scene, on the ranks of `comm` (all)."""
        return self.SETUP(self, comm)

    def job(self, **changes: Any) -> Job:
        """The `Job` of the built test; changes: fields of `Job`."""
        return self.build().job(**changes)
