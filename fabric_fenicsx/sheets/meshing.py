"""A sheet's fields made into a blank: a rectangle, an own mesh or an outline."""

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TypeVar

import numpy as np
from mpi4py import MPI

from ..runtime import timing
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..runtime.status import task
from .blank import Blank
from .flat import FlatSheet, Outline, Rectangle
from .sheet import Layout, SheetFields, Values

SIZE_TOLERANCE = 1e-3  # of a length, by which an own mesh may differ from what is asked for
Kind = TypeVar("Kind", bound=SheetFields)


def mesh_sheet(
    sheet: Kind,
    comm: MPI.Comm,
    values: Values,
    *,
    spatial: bool = False,
    turned: float = 0.0,
    centred: bool | Sequence[bool] = False,
    planes: Sequence[int] = (),
    height: float | None = None,
) -> tuple[Kind, Blank, list[str]]:
    """The sheet with the values that its mesh has, its blank, and doubts.

    values: of fields, in place of the sheet's, as its `defaults`; spatial: free to leave its plane;
    turned, centred, planes: as in `Blank.outline`; height: as in `Blank.read`. Raises InputError as
    `Blank` does, and for fields that do not fit the mesh.
    """
    given = {each.name: getattr(sheet, each.name) for each in fields(sheet)} | values
    place: Values = {each.name: given[each.name] for each in fields(Layout)}
    place |= {"turned": turned, "centred": centred}
    sides = [*sheet.SIDES][0], [*sheet.SIDES][-1]
    source = sheet.sheet_file or "the specimen"
    with timing.phase("setup"), task("meshing the sheet"):
        if sheet.mesh:
            options: Values = {**FlatSheet(**place).options(), "centred": centred, "height": height}
            blank = Blank.read(sheet.mesh, spatial=spatial, comm=comm, **options)
        elif sheet.outline:
            cells: Values = {"size": sheet.size, "layer": sheet.layer, "planes": planes}
            blank = Blank.of_flat(Outline(outline=sheet.outline, **cells, **place), spatial, comm)
        else:
            modelled = modelled_share(planes) * [given[side] for side in sides]
            blank = Blank.of_flat(Rectangle(sides=modelled.tolist(), **place), spatial, comm)
    if blank.mesh.geometry.dim == 3 and not spatial:
        raise InputError(
            f"{source} is not plane in z; allowed in this study is a sheet in a plane z = const"
        )
    kind = "P" if blank.around == [0, 1, 2] else "Q"
    if sheet.element and sheet.element[0] != kind:
        raise InputError(
            f"`element` {sheet.element} does not fit the cells of {source}; "
            "allowed is P on triangles, Q on quadrilaterals"
        )
    doubts = [*blank.warnings, size_warning(blank, source)]
    final: Values = {**values, "element": f"{kind}{blank.degree}", "integration": sheet.integration}
    if not sheet.integration:
        quadratic = blank.degree == 2 and blank.triangulated
        follow = quadratic and (given["pattern"] == "yarns" or blank.whole.follows_yarns())
        final["integration"] = sheet.points_of_p2(follow) if quadratic else "full"
    if sheet.sheet_file:
        doubts.append(_idle_warning(sheet))
        final |= _own_sizes(sheet, sides, blank, planes)
        final |= dict.fromkeys(("nx", "ny", "pattern") if sheet.mesh else ("ny",))
    return replace(sheet, **final), blank, [*filter(None, doubts)]


def modelled_share(planes: Sequence[int]) -> np.ndarray:
    """Shares (2,) of length and width that planes of symmetry perpendicular to these axes leave."""
    return np.where(np.isin([0, 1], planes), 0.5, 1.0)


def size_warning(blank: Blank, source: str) -> str:
    """A sentence if the sheet's size may be in another unit than mm, else ""."""
    low, high = blank.extent()
    if 20 <= (high - low).max() <= 10_000:  # a few yarns, more than looms weave
        return ""
    sides = " x ".join(rounded(side, 4) for side in high - low)
    return f"{source} is {sides} mm; lengths are in mm (metres times 1000, inches times 25.4)"


def whole_sides(blank: Blank, planes: Sequence[int]) -> list[float]:
    """Length and width of the whole sheet [mm], rounded, to be the same on any number of ranks."""
    low, high = blank.extent()
    return [float(f"{size:.9g}") for size in (high - low)[:2] / modelled_share(planes)]


def _own_sizes(sheet, names, blank, planes):
    """Length and width of an own mesh, by their fields, of a square the same one."""
    sizes = dict[str, float]()
    for name, size in zip(names, whole_sides(blank, planes)):
        asked = sizes.setdefault(name, getattr(sheet, name) or size)
        if abs(asked - size) > SIZE_TOLERANCE * size:
            raise InputError(
                f"`{name}` {asked:g} does not fit {sheet.sheet_file}, of {size:g} mm; allowed "
                "is its own, or none"
            )
        sizes[name] = size
    return sizes


def _idle_warning(sheet):
    """A sentence on fields that change nothing beside an own mesh, or ""."""
    idle = {"nx": None, "ny": None, "pattern": type(sheet).pattern}
    asked = [k for k, usual in idle.items() if getattr(sheet, k) not in (None, usual)]
    names = ", ".join(f"`{k}`" for k in asked if sheet.mesh or k == "ny")
    why = "has its own cells" if sheet.mesh else "has cells of one size"
    return f"{names} changes nothing, as {sheet.sheet_file} {why}" if names else ""
