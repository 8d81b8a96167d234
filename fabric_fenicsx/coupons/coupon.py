"""Coupon tests as data: what is tested, and how. `build` makes mesh and scene of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mpi4py import MPI

from ..job.job import Job
from ..material.laws import Law
from ..material.presets import load
from ..runtime.rules import FINITE
from ..sheets.sheet import FULL_TURN, SheetFields, Values, declared_again
from .setup import CouponSetup


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
