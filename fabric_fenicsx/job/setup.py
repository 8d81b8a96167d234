"""A built test: its scene, and what its job measures, writes and draws."""

from pathlib import Path
from typing import Any

from ..results.curve import Curves
from ..runtime.fields import declared
from ..scene.scene import Scene
from ..solve.settings import Settings
from .job import Job, Result


class Setup:
    """A `scene` made from the `data` of a test, and what a job needs to know of it.

    data: a frozen dataclass with the class variables NAME, FULL, SOLVER, HEADLINES and
    CHEAP_FROM, in which every default has its value; warnings: sentences found while building. A
    subclass overrides what it has.
    """

    def __init__(self, data: Any, scene: Scene, warnings: list[str]) -> None:
        self.data, self.scene, self.warnings = data, scene, warnings

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Displacement [mm] and force [N] for the history, at a load factor."""
        raise NotImplementedError

    def quantities(self, result: Result) -> dict[str, Any]:
        """Its own numbers for the summary; their names end with their units."""
        return {}

    def tables(self, result: Result, folder: Path) -> None:
        """Write its own tables into `folder`; called on all ranks."""

    def pictures(self, result: Result, folder: Path) -> None:
        """Draw its own pictures into `folder`; called on rank 0."""

    def reference_curves(self) -> Curves:
        """Curves of force over displacement to draw beside the run's."""
        return {}

    def force_name(self) -> str:
        """Name of the force of `measure`."""
        return "reaction"

    def modelled_share(self) -> float:
        """Share of the whole sheet that symmetry leaves."""
        return 1.0

    def title_and_text(self) -> tuple[str, str]:
        """Title and description of the report, "" for those of the study."""
        return "", ""

    def fingerprint(self) -> dict[str, Any]:
        """Facts besides options and fabric in which a checkpoint must agree."""
        return {}

    def resolved(self) -> dict[str, Any]:
        """Options to which building gave their values, as the sides of an own mesh."""
        return {}

    def coarser(self) -> Any:
        """The data of the same test on a mesh twice as coarse; None if none is known."""
        return None

    def has_cheap_error(self) -> bool:
        """True if a study estimates errors unasked: the coarser run then costs a tenth to a third
        of the run."""
        cells = self.scene.blank.mesh.topology.index_map(2).size_global
        return 0 < self.data.CHEAP_FROM <= cells and self.coarser() is not None

    def job(self, **changes: Any) -> Job:
        """The `Job` of this test with its defaults, `changes` in its fields."""
        coarser, comm = self.coarser(), self.scene.comm
        names = [each.name for each in declared(Settings)]
        usual: dict[str, Any] = {k: v for k, v in self.data.FULL.items() if k in names}
        usual |= {
            "name": self.data.NAME,
            "measure": self.measure,
            "force_name": self.force_name(),
            "modelled": self.modelled_share(),
            "quantities": self.quantities,
            "tables": self.tables,
            "pictures": self.pictures,
            "warnings": self.warnings,
            "beside": self.reference_curves(),
            "coarser": None if coarser is None else lambda: coarser.build(comm).job(),
            "headlines": self.data.HEADLINES,
        }
        return Job(self.scene, **usual | dict(self.data.SOLVER) | changes)
