"""What a job runs: a scene, and what is measured, written and drawn of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..core.formatting import TINY
from ..results.result import Result
from ..results.verdict import Numbers, Reason
from ..scene import output
from ..scene.scene import Scene
from ..solve.progress import Accepted, Report

# displacement [mm], force [N], and further columns of the history
Measured = tuple[float, float] | tuple[float, float, dict[str, float]]


class Observer:
    """Observer of a run on all ranks; a subclass overrides what it needs."""

    def begin(self, folder: Path, pictures: bool) -> None:
        """Before the first step; pictures: whether any are asked for, in `folder`."""

    def accept(self, accepted: Accepted) -> None:
        """At each accepted state, in which the scene is."""

    def reject(self, load: float, report: Report) -> None:
        """After each step that failed."""

    def end(self, result: Result, folder: Path) -> None:
        """At full load, after the summary was written into `folder`."""


class Setup(Observer):
    """A `scene`, and what is measured and drawn of it: a subclass overrides what it has of
    `measure`, `quantities`, `doubts`, `pictures`, `coarser` and the methods of an `Observer`.

    Parameters
    ----------
    scene : Scene
        At rest, with new terms.
    data : optional
        The description that it was built of, a frozen dataclass with the class variables NAME,
        FULL, SOLVER, HEADLINES and CHEAP_FROM, in which every default has its value.
    warnings : sequence of str
        Warnings at the start of a run.

    Attributes
    ----------
    name : str
        Of the study in the summary.
    title, text : str
        Title and description of the report, "" for those of the study.
    force_name : str
        Name of the force of `measure`.
    modelled_share : float
        Share of the whole sheet that is modelled, by which forces are divided.
    headlines : sequence of str
        Quantities that get errors, nested ones as "draw_in.largest_mm".
    stages : sequence of (float, str)
        Load factor at the end of each stage, and the stage's name.
    resolved : dict
        Options whose values were set during building, e.g. the size of a mesh.
    coarser_is_other_kind : bool
        True if the coarser mesh has cells of another kind, not only larger ones.
    fewer_steps : int
        Ratio of the steps of a run to those of the coarser run for its error.

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

    title, text, force_name = "", "", "reaction"
    modelled_share = 1.0
    stages: Sequence[tuple[float, str]] = ()
    coarser_is_other_kind = False
    fewer_steps = 2

    def __init__(self, scene: Scene, data: Any = None, warnings: Sequence[str] = ()) -> None:
        self.scene, self.data, self.warnings = scene, data, list(warnings)
        self.name: str = data.NAME if data else "job"
        self.headlines: Sequence[str] = data.HEADLINES if data else ()
        self.resolved: Numbers = {}

    def measure(self, scene: Scene, load: float) -> Measured:
        """Displacement [mm] and force [N] for the history, at a load factor, on all ranks; as a
        third further columns of it {name: value}. By default of the first tool that moves, else of
        the support that moves furthest, along the motion of either; 0 and 0 without both."""
        for tool in output.tools(scene):
            motion, moved = (np.subtract(tool.path(at), tool.path(0.0)) for at in (1.0, load))
            if size := np.linalg.norm(motion):
                along = motion / size
                return float(along @ moved), float(along @ output.tool_force(scene, tool))
        strokes = [(_stroke(scene, support, 1.0), support) for support in scene.supports]
        if not strokes:
            return 0.0, 0.0
        stroke, support = max(strokes, key=lambda each: float(np.linalg.norm(each[0])))
        along, reaction = stroke / max(np.linalg.norm(stroke), TINY), scene.reaction(support.name)
        return float(along @ _stroke(scene, support, load)), float(along @ reaction)

    def quantities(self, result: Result) -> Numbers:
        """Its own numbers for the summary; their names end with their units."""
        return {}

    def doubts(self, result: Result) -> list[Reason]:
        """Its own doubts about a result, on all ranks."""
        return []

    def pictures(self, result: Result, folder: Path) -> None:
        """Draw its own pictures into `folder`; called on rank 0."""

    def coarser(self) -> Any:
        """The data of the same test on a coarser mesh; None if none is known."""
        return None

    def has_cheap_error(self) -> bool:
        """True if a study estimates errors unasked, for a tenth to half of the cost."""
        cells = self.scene.blank.mesh.topology.index_map(2).size_global
        return 0 < self.data.CHEAP_FROM <= cells and self.coarser() is not None


def _stroke(scene, support, load):
    """Mean displacement of the nodes of a support, (gdim,) [mm]."""
    x = scene.blank.coordinates()[: scene.blank.V.dofmap.index_map.size_local].T
    moved = support.at(x[:, support.where(x)], load)[: scene.blank.mesh.geometry.dim]
    return scene.comm.allreduce(moved.sum(1)) / scene.comm.allreduce(moved.shape[1])
