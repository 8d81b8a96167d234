"""Result of a run: its summary, history and fields, to be asked and drawn."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.formatting import rounded, with_error
from ..energy.output import Fields
from ..scene import output
from ..scene.scene import Scene
from ..surfaces.tool import Tool
from . import measures, shape, states, structural
from .ply import SAME, Grid, check_field
from .verdict import Numbers


@dataclass
class Result:
    """Summary, history and fields of a run.

    Attributes
    ----------
    summary : dict
        As in summary.json. Its `energy` has the energies of the last state by kind (strain,
        bending, contact, friction, of metal metal and plastic, those of own terms), viscous, what
        regularisation took, and external_work [N mm].
    rows : list of dict
        The history: {column of history.csv: value} for each accepted step.
    fields : Fields
        {name: array (cells, ...)} of this rank's cells, with their `units` {name: unit}.
    folder : Path or None
        Results folder, None if no files were written.
    scene : Scene
        In its last state.

    Examples
    --------
    >>> result = ff.Tensile(nx=4, element="P1").job(steps=2).run()
    >>> result.summary["converged"], len(result.rows), result.fields["shear_angle"].shape
    (True, 3, (16,))
    """

    summary: Numbers
    rows: list[Numbers]
    fields: Fields
    folder: Path | None
    scene: Scene

    @cached_property
    def grid(self) -> Grid:
        """The whole sheet as it lay at first, with the displacement `u` [mm] to its last state and
        the fields of that state, on rank 0 only: `grid.warp_by_vector("u")` is the formed one."""
        assert self.folder
        return states.read_state(self.folder)

    @property
    def grids(self) -> dict[str, Grid]:
        """The last state of each sheet of a stack {name: grid}, or {"": grid}, on rank 0 only."""
        return states.sheets_of(self.grid, list(self.scene.blank.parts))

    def number(self, name: str) -> float | None:
        """A number of the summary or its quantities; of nested ones as "draw_in.largest_mm". None
        if there is none."""
        if name == "strain_energy_Nmm":
            return self.summary["energy"]["strain"]
        found: object = self.summary if name in self.summary else self.summary["quantities"]
        for key in name.split("."):
            found = found.get(key) if isinstance(found, dict) else None
        return found if isinstance(found, (int, float)) else None

    def formatted(self, name: str, form: str = ".6g", scale: float = 1.0) -> str:
        """A number, as of `number`, times `scale` in this format, with its estimated error if there
        is one: "2033.42 +- 0.05"."""
        value, errors = self.number(name), self.summary.get("error", {})
        if value is None:
            return "-"
        text, error = format(round(scale * value, 12) + 0.0, form), errors.get(name)
        error = None if error is None else abs(scale) * error
        return with_error(text, scale * value, error) if name in errors else text

    def force(self, tool: Tool | str) -> np.ndarray:
        """Force of `tool`, or of the tool of that name, on the sheet in the last accepted state,
        (3,) [N]. Raises InputError for a tool or a name that the scene does not have once."""
        scene = self.scene
        pressing = [term.tool for term in scene.terms if term.tool]
        tools = dict.fromkeys([*output.tools(scene), *pressing])
        asked = [each for each in tools if tool in (each, each.name)]
        if len(asked) != 1:
            name = tool if isinstance(tool, str) else tool.name
            known = ", ".join(each.name for each in tools) or "it has none"
            raise InputError(
                f"the scene has {len(asked) or 'no'} tools {name!r}; expected one of its own "
                f"tools, or the name of one alone: {known}"
            )
        return output.tool_force(scene, asked[0])

    def draw_in(self, sheet: str = "") -> Numbers:
        """Ways [mm] that the edge of the sheet, or of the one of this name in a stack, went inwards
        in plan, by the names of `postprocess.shape.draw_in`, on all ranks. An edge on x = 0 or
        y = 0 that supports hold along its normal alone is a plane of symmetry. Raises InputError
        for a name that is none, a stack without one, and a sheet that was not flat in z = const."""
        part, blank = self._sheet("draw-in", sheet), self.scene.blank
        z = blank.coordinates()[: len(part.nodes), 2][part.nodes]
        low, high = measures.extremes(self.scene.comm, z)
        if high - low > SAME:
            raise InputError(
                f"undeformed nodes of {sheet or blank.name} are up to {rounded(high - low, 4)} mm "
                "apart along z; draw-in needs a sheet that is flat in z = const"
            )
        return on_root(self.scene.comm, lambda: shape.draw_in(self._grid_of(sheet)))

    def _sheet(self, asked, name):
        """The part of that name, of which a quantity is `asked`."""
        blank = self.scene.blank
        part = blank.part(name)
        if part.is_whole and any(each.thickness for each in blank.parts.values()):
            known = ", ".join(blank.parts)
            raise InputError(f"{asked} needs one of the sheets of {blank.name}: {known}")
        return part

    def _grid_of(self, sheet):
        return self.grids[sheet] if sheet else self.grid

    def outline(self, sheet: str = "") -> list[shape.Outline]:
        """Free edges of the sheet, or of the one of this name in a stack, flat and formed, as of
        `postprocess.shape.outline`; on rank 0, elsewhere none. Raises InputError for a name that is
        none and for a stack without one."""
        self._sheet("outline", sheet)
        return [] if self.scene.comm.rank else shape.outline(self._grid_of(sheet))

    def at(self, place: ArrayLike, name: str, sheet: str = "") -> float:
        """Field `name`, of one number a cell, of the cell at `place` (x, y) [mm] of the flat sheet,
        or of the one of this name in a stack, on all ranks. Raises InputError for a place beside it
        and for a field that it does not have."""
        self._sheet("a field", sheet)
        return on_root(self.scene.comm, lambda: shape.value_at(self._grid_of(sheet), place, name))

    def plot(self, name: str, path: Path | str) -> None:
        """Draw field `name`, of one number a cell or node, on the deformed sheet, to a PNG file, on
        rank 0; of nodes the mean over each cell. Raises InputError for a name that is none."""
        units = self.fields.units | output.nodal_fields(self.scene).units

        def draw():
            from .pictures import OUTLIERS, maps

            check_field(name, self.grid.point_data, self.grid.cell_data)
            maps(Path(path), self.grids, (name,), outliers=OUTLIERS, units=units)

        on_root(self.scene.comm, draw)

    def export(self, path: Path | str, modelled: bool = False) -> None:
        """Write the formed plies with thickness and yarn directions for a structural analysis, on
        rank 0; the ending of `path` says how, see `postprocess.structural.export`. A quarter is
        mirrored to the whole part, unless `modelled`. Raises InputError for another ending."""
        on_root(self.scene.comm, lambda: structural.export(self.grids, path, modelled) and None)
