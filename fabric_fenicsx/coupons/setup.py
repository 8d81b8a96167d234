"""A built coupon test: its blank, membrane and scene."""

import math
from collections.abc import Iterable
from typing import Any

from mpi4py import MPI

from ..job.job import Job
from ..job.setup import Setup
from ..mechanics.shell.membrane import Membrane
from ..mechanics.term import Term
from ..scene.scene import Scene
from ..scene.supports import Supports
from ..sheets.meshing import mesh_sheet


class CouponSetup(Setup):
    """A coupon test on the ranks of `comm`; a subclass says what is put on its `blank`.

    `data` is then the description with all defaults filled in. Raises InputError as
    `mesh_sheet` does.
    """

    fewer_steps = 4  # as states of coupons do not hang on steps
    turned = 0.0  # angle from x to the length [rad]

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
        self.coarser_is_other_kind = self.on_other_cells() is not None

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
        """The data with half the rectangles along each side, of other cells if those are better;
        None for an own mesh."""
        coarse = self.data.coarser(self.high - self.low)
        return coarse and (self.on_other_cells() or coarse)

    def on_other_cells(self) -> Any:
        """The data on a coarser mesh of cells of another kind; None if the same are as good."""
        return None
