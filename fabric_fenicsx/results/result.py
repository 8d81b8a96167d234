"""What a run gives back: its summary, history and fields, to be asked and drawn."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..scene import Scene
from . import measures
from .curve import Curves

if TYPE_CHECKING:
    import pyvista

    from ..tools import Tool

LAST_PICTURE = "maps.png"  # where it is, all pictures of a run are
MAPS = "log_eps_11", "log_eps_22", "shear_angle"  # what one looks at first
OUTLIERS = 0.005  # of the cells, as at corners, that are left out of a map's scale


@dataclass
class Result:
    """A run's `summary` (as in summary.json), `rows` of its history, cell `fields` (this rank's
    cells) and `folder` (None if nothing was kept), with the `scene` in its last state."""

    summary: dict[str, Any]
    rows: list[dict[str, Any]]
    fields: dict[str, np.ndarray]
    folder: Path | None
    scene: Scene
    _grid: "pyvista.UnstructuredGrid | None" = field(default=None, repr=False)

    @property
    def grid(self) -> "pyvista.UnstructuredGrid":
        """The last state of the whole sheet with its fields, on rank 0 only."""
        if self._grid is None:
            from .fields import read_last

            assert self.folder
            self._grid = read_last(self.folder)
        return self._grid

    @property
    def grids(self) -> "dict[str, pyvista.UnstructuredGrid]":
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
        return text + (f" +- {abs(scale) * errors[name]:.2g}" if name in errors else "")

    def force(self, tool: "Tool") -> np.ndarray:
        """Force of `tool` on the sheet in the last accepted state, (3,) [N]."""
        return self.scene.tool_force(tool)

    def draw_in(self, sheet: str = "") -> dict[str, float]:
        """How far the edge of the sheet, or of the one of this name in a stack, went inwards in
        plan [mm], by the names of `forming.draw_in`, on all ranks.

        An edge on x = 0 or y = 0 that supports hold along its normal alone is a plane of symmetry.
        Raises InputError for a name that is none, for a stack without one, and for a sheet that was
        not flat in a plane z = const at first.
        """
        blank = self.scene.blank
        part = blank.part(sheet)
        if part.is_whole and any(each.thickness for each in blank.parts.values()):
            raise InputError(
                f"draw-in of the stack {blank.name} is asked; allowed is one of its sheets: "
                f"{', '.join(blank.parts)}"
            )
        z = blank.coordinates()[: len(part.nodes), 2][part.nodes]
        low, high = measures.extremes(self.scene.comm, z)
        if high - low > measures.SAME:
            raise InputError(
                f"draw-in of {sheet or blank.name} is asked, whose undeformed nodes are up to "
                f"{high - low:.4g} mm apart along z; allowed is a sheet that is flat in z = const"
            )
        planes, found = measures.planes_of_symmetry(self.scene, part), {}
        if self.scene.comm.rank == 0:
            from . import forming

            found = forming.draw_in(self.grids[sheet] if sheet else self.grid, planes)
        return self.scene.comm.bcast(found)

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
        rank 0; nodes as means over the cells. Raises InputError for a name that is none."""
        # asked of all ranks, which a field of cells does not need
        nodal = {} if name in self.fields else self.scene.nodal_fields()
        drawn = sorted(
            each for each, values in {**self.fields, **nodal}.items() if values.ndim == 1
        )
        if name not in drawn:
            raise InputError(
                f"a picture of {name} is asked for; allowed are the fields {', '.join(drawn)}"
            )
        if self.scene.comm.rank == 0:
            from . import pictures

            grids = self.grids
            if name in nodal:
                grids = {
                    title: grid.point_data_to_cell_data(pass_point_data=True)
                    for title, grid in grids.items()
                }
            units = self.scene.units()
            pictures.maps(Path(path), grids, (name,), OUTLIERS, units)

    def export(self, path: Path | str) -> None:
        """Write the formed plies with their yarn directions for a structural analysis, to a .vtu
        file or as Abaqus input (.inp), on rank 0; see `structural.export`, which says what is in
        them. Raises InputError for another ending."""
        from . import structural

        path = structural.checked(path)
        if self.scene.comm.rank == 0:
            structural.export(self.grids, path)


def of_fabric(
    grids: "Mapping[str, pyvista.UnstructuredGrid]",
) -> "dict[str, pyvista.UnstructuredGrid]":
    """Those {name: grid} that have yarns."""
    return {name: grid for name, grid in grids.items() if "shear_angle" in grid.cell_data}


def draw_state(name: str, result: Result, folder: Path, beside: Curves) -> None:
    """maps.png and curve.png, what one looks at first; beside: other curves to draw in that."""
    from . import pictures

    run = {"simulated" if beside else "": result}
    pictures.reactions(folder / "curve.png", run, beside=beside)
    maps = {part or name.replace("_", " "): grid for part, grid in of_fabric(result.grids).items()}
    pictures.maps(folder / LAST_PICTURE, maps, MAPS, outliers=OUTLIERS)
    errors = tuple(f"error_{field}" for field in MAPS)
    if all(name in grid.cell_data for grid in maps.values() for name in errors):
        pictures.maps(folder / "error.png", maps, errors, outliers=OUTLIERS)
