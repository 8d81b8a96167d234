"""Result of a run: its summary, history and fields, to be asked and drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..mechanics.output import Fields
from ..mechanics.protocols import Pressing
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..scene import output as reports
from ..scene.scene import Scene
from . import measures
from .curve import Curves

if TYPE_CHECKING:
    import pyvista

    from ..tools.tool import Tool
    from .forming import Outline

LAST_PICTURE = "maps.png"  # where it is, all pictures of a run are
MAPS = "log_eps_11", "log_eps_22", "shear_angle"  # what one looks at first
OUTLIERS = 0.005  # of the cells, as at corners, that are left out of a map's scale


@dataclass
class Result:
    """Summary, history and fields of a run.

    Parameters
    ----------
    summary : dict
        Content of summary.json. Its `energy` has the energies of the last state by kind (strain,
        bending, contact, friction, of metal metal and plastic, and those of own terms), viscous,
        which regularisation took, and external_work [N mm].
    rows : list of dict
        The history, {column of history.csv: value} for each accepted step.
    fields : Fields
        {name: array (cells, ...)} of this rank's cells, with their `units` {name: unit}.
    folder : Path or None
        Where all is kept, None if nothing was.
    scene : Scene
        In its last state.

    Examples
    --------
    >>> result = ff.Tensile(nx=4, element="P1").job(steps=2).run()
    >>> result.summary["converged"], len(result.rows), result.fields["shear_angle"].shape
    (True, 3, (16,))
    """

    summary: dict[str, Any]
    rows: list[dict[str, Any]]
    fields: Fields
    folder: Path | None
    scene: Scene
    _grid: pyvista.UnstructuredGrid | None = field(default=None, repr=False)

    @property
    def grid(self) -> pyvista.UnstructuredGrid:
        """The whole sheet as it lay at first, with the displacement `u` [mm] to its last state and
        the fields of that state, on rank 0 only: `grid.warp_by_vector("u")` is the formed one."""
        if self._grid is None:
            from .fields import read_last

            assert self.folder
            self._grid = read_last(self.folder)
        return self._grid

    @property
    def grids(self) -> dict[str, pyvista.UnstructuredGrid]:
        """The last state of each sheet of a stack {name: grid}, or of the one {"": grid}, on rank 0
        only."""
        from .fields import sheets_of

        return sheets_of(self.grid, list(self.scene.blank.parts))

    def number(self, name: str) -> float | None:
        """A number of the summary or its quantities; of nested ones as "draw_in.largest_mm". None
        if there is none."""
        if name == "strain_energy_Nmm":
            return self.summary["energy"]["strain"]
        found: Any = self.summary if name in self.summary else self.summary["quantities"]
        for key in name.split("."):
            found = found.get(key) if isinstance(found, dict) else None
        return found if isinstance(found, (int, float)) else None

    def told(self, name: str, form: str = ".6g", scale: float = 1.0) -> str:
        """That number times `scale` in this format, with its estimated error if there is one:
        "2033.42 +- 0.05"."""
        value, errors = self.number(name), self.summary.get("error", {})
        if value is None:
            return "-"
        text = format(round(scale * value, 12) + 0.0, form)
        return text + (f" +- {rounded(abs(scale) * errors[name], 2)}" if name in errors else "")

    def force(self, tool: Tool | str) -> np.ndarray:
        """Force of `tool`, or of the tool of that name, on the sheet in the last accepted state,
        (3,) [N]. Raises InputError for a tool or a name that the scene does not have once."""
        scene = self.scene
        pressing = [term.tool for term in scene.terms if isinstance(term, Pressing)]
        tools = dict.fromkeys([*reports.tools(scene), *pressing])
        asked = [each for each in tools if tool in (each, each.name)]
        force = np.zeros(3) if isinstance(tool, str) else reports.tool_force(scene, tool)
        if len(asked) != 1 and not force.any():
            name = tool if isinstance(tool, str) else tool.name
            raise InputError(
                f"force of {name!r} is asked for, which {len(asked) or 'no'} tools of the scene "
                "are; allowed is one of its own tools, or the name of one alone: "
                f"{', '.join(each.name for each in tools) or 'it has none'}"
            )
        return reports.tool_force(scene, asked[0]) if asked else force

    def draw_in(self, sheet: str = "") -> dict[str, Any]:
        """How far the edge of the sheet, or of the one of this name in a stack, went inwards in
        plan [mm], by the names of `forming.draw_in`, on all ranks.

        An edge on x = 0 or y = 0 that supports hold along its normal alone is a plane of symmetry.
        Raises InputError for a name that is none, for a stack without one, and for a sheet that was
        not flat in a plane z = const at first.
        """
        part, blank = self._sheet("draw-in", sheet), self.scene.blank
        z = blank.coordinates()[: len(part.nodes), 2][part.nodes]
        low, high = measures.extremes(self.scene.comm, z)
        if high - low > measures.SAME:
            raise InputError(
                f"draw-in of {sheet or blank.name} is asked for, whose undeformed nodes are up to "
                f"{rounded(high - low, 4)} mm apart along z; allowed is a sheet that is flat in z "
                "= const"
            )
        planes, found = measures.planes_of_symmetry(self.scene, part), {}
        if self.scene.comm.rank == 0:
            from . import forming

            found = forming.draw_in(self.grids[sheet] if sheet else self.grid, planes)
        return self.scene.comm.bcast(found)

    def _sheet(self, asked, name):
        """The part of that name, of which something is `asked`."""
        blank = self.scene.blank
        part = blank.part(name)
        if part.is_whole and any(each.thickness for each in blank.parts.values()):
            raise InputError(
                f"{asked} of {blank.name} is asked for; allowed is one of its sheets: "
                f"{', '.join(blank.parts)}"
            )
        return part

    def outline(self, sheet: str = "") -> list[Outline]:
        """The free edges of the sheet, or of the one of this name in a stack, flat and formed, as
        `forming.outline`; on rank 0, elsewhere none. Raises InputError for a name that is none and
        for a stack without one."""
        part = self._sheet("outline", sheet)
        planes = measures.planes_of_symmetry(self.scene, part)
        if self.scene.comm.rank:
            return []
        from . import forming

        return forming.outline(self.grids[sheet] if sheet else self.grid, planes)

    def at(self, place: ArrayLike, name: str, sheet: str = "") -> float:
        """Field `name`, of one number a cell, of the cell at `place` (x, y) [mm] of the flat sheet,
        or of the one of this name in a stack, on all ranks. Raises InputError for a place beside it
        and for a field that it does not have."""
        self._sheet(f"field {name}", sheet)
        found: Any = None
        if self.scene.comm.rank == 0:
            from . import forming

            try:
                found = forming.value_at(self.grids[sheet] if sheet else self.grid, place, name)
            except InputError as error:
                found = str(error)
        found = self.scene.comm.bcast(found)
        if isinstance(found, str):
            raise InputError(found)
        return found

    def forget_grid(self) -> None:
        """Read the last state anew when it is asked for, as it was written anew."""
        self._grid = None

    def forget_folder(self) -> None:
        """Keep the grid, not the folder that it is in."""
        if self.scene.comm.rank == 0:
            self._grid = self.grid
        self.folder = None

    def plot(self, name: str, path: Path | str) -> None:
        """Draw field `name`, of one number a cell or node, on the deformed sheet, to a PNG file, on
        rank 0; of nodes the mean over each cell. Raises InputError for a name that is none."""
        # asked of all ranks, which a field of cells does not need
        nodal = Fields({}) if name in self.fields else reports.nodal_fields(self.scene)
        drawn = sorted(
            each for each, values in {**self.fields, **nodal}.items() if values.ndim == 1
        )
        grid, comm = (self.grid if self.scene.comm.rank == 0 else None), self.scene.comm
        kept = comm.bcast(grid and {*grid.cell_data, *grid.point_data})
        if name not in drawn or name not in kept:
            raise InputError(
                f"a picture of {name} is asked for; allowed are the fields of the run "
                f"{', '.join(each for each in drawn if each in kept)}"
            )
        if self.scene.comm.rank == 0:
            from ..plot import pictures

            grids, units = self.grids, self.fields.units | nodal.units
            if name in nodal:
                means = f"{name}, mean over each cell"
                grids = {
                    title: grid.point_data_to_cell_data(pass_point_data=True)
                    for title, grid in grids.items()
                }
                for grid in grids.values():
                    grid.cell_data[means] = grid.cell_data[name]
                units, name = {means: units.get(name, "")}, means
            pictures.maps(Path(path), grids, (name,), OUTLIERS, units)

    def export(self, path: Path | str) -> None:
        """Write the formed plies with their yarn directions for a structural analysis, to a .vtu
        file or as Abaqus input (.inp), on rank 0; see `structural.export`, which says what is in
        them. Raises InputError for another ending."""
        from . import structural

        path = structural.checked(path)
        if self.scene.comm.rank == 0:
            structural.export(self.grids, path)


def of_fabric(grids: Mapping[str, pyvista.UnstructuredGrid]) -> dict[str, pyvista.UnstructuredGrid]:
    """Those {name: grid} that have yarns."""
    return {name: grid for name, grid in grids.items() if "shear_angle" in grid.cell_data}


def draw_state(name: str, result: Result, folder: Path, beside: Curves, force_name: str) -> None:
    """maps.png and curve.png, what one looks at first; beside: other curves to draw in that,
    force_name: what its force is called."""
    from ..plot import pictures

    run = {"simulated" if beside else "": result}
    pictures.reactions(folder / "curve.png", run, ylabel=f"{force_name} / N", beside=beside)
    maps = {part or name.replace("_", " "): grid for part, grid in of_fabric(result.grids).items()}
    if not maps:  # sheets of metal alone
        return
    pictures.maps(folder / LAST_PICTURE, maps, MAPS, outliers=OUTLIERS)
    errors = tuple(f"error_{field}" for field in MAPS)
    if all(name in grid.cell_data for grid in maps.values() for name in errors):
        pictures.maps(folder / "error.png", maps, errors, outliers=OUTLIERS)
