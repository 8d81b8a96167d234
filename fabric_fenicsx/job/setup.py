"""What a job runs: a scene, and what is measured, written and drawn of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..results.curve import Curves, Measure, default_measure
from ..results.result import Result
from ..runtime.fields import declared
from ..scene.scene import Scene
from ..solve.settings import Settings

if TYPE_CHECKING:
    from .job import Job


class Setup:
    """A `scene`, and what is measured, written and drawn of it; a subclass overrides what it has.

    Parameters
    ----------
    scene : Scene
        At rest, with new terms.
    data : optional
        The description that it was built of, a frozen dataclass with the class variables NAME,
        FULL, SOLVER, HEADLINES and CHEAP_FROM, in which every default has its value.
    warnings : sequence of str
        Sentences with which a run begins.

    Examples
    --------
    >>> class Pulled(ff.Setup):
    ...     def quantities(self, result):
    ...         return {"shear_deg": float(result.fields["shear_angle"].max())}
    >>> sheet = ff.Blank.rectangle(40, 20, nx=2, element="P1")
    >>> scene = ff.Scene(sheet, [ff.Membrane(ff.load("komeili"))], ff.clamped_ends(0.4))
    >>> ff.Job(Pulled(scene), steps=2).run().summary["quantities"]["shear_deg"] < 1
    True
    """

    FEWER_STEPS = 2  # times as many steps has a run as the coarser one that tells its error

    def __init__(self, scene: Scene, data: Any = None, warnings: Sequence[str] = ()) -> None:
        self.scene, self.data, self.warnings = scene, data, list(warnings)
        self.name: str = data.NAME if data else "job"
        self._measure: Measure | None = None

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Displacement [mm] and force [N] for the history, at a load factor; by default of the
        first tool or support that moves."""
        self._measure = self._measure or default_measure(self.scene)
        return self._measure(scene, load)

    def force_name(self) -> str:
        """Name of the force of `measure`."""
        return "reaction"

    def modelled_share(self) -> float:
        """Share of the whole sheet that symmetry leaves, by which forces are divided, too."""
        return 1.0

    def stage(self, load: float) -> str:
        """Name of the stage under way at a load factor."""
        return ""

    def columns(self, scene: Scene) -> dict[str, float]:
        """Further columns of the history {name: value}, on all ranks."""
        return {}

    def quantities(self, result: Result) -> dict[str, Any]:
        """Its own numbers for the summary; their names end with their units."""
        return {}

    def headlines(self) -> Sequence[str]:
        """Quantities that get errors, nested ones as "draw_in.largest_mm"."""
        return self.data.HEADLINES if self.data else ()

    def tables(self, result: Result, folder: Path) -> None:
        """Write its own tables into `folder`; called on all ranks."""

    def first_picture(self, folder: Path) -> None:
        """Draw into `folder` before the run; called on all ranks."""

    def pictures(self, result: Result, folder: Path) -> None:
        """Draw its own pictures into `folder`; called on rank 0."""

    def reference_curves(self) -> Curves:
        """Curves of force over displacement to draw beside the run's."""
        return {}

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
        """The data of the same test on a coarser mesh; None if none is known."""
        return None

    def coarser_is_other_kind(self) -> bool:
        """True if that mesh has cells of another kind, not only larger ones."""
        return False

    def has_cheap_error(self) -> bool:
        """True if a study estimates errors unasked, for a tenth to a third of the cost."""
        cells = self.scene.blank.mesh.topology.index_map(2).size_global
        return 0 < self.data.CHEAP_FROM <= cells and self.coarser() is not None

    def job(self, **changes: Any) -> Job:
        """The `Job` of this test with its defaults, `changes` in its fields."""
        from .job import Job

        names = [each.name for each in declared(Settings)]
        usual = {name: value for name, value in self.data.FULL.items() if name in names}
        return Job(self, **usual | dict(self.data.SOLVER) | changes)
