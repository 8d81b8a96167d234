"""A sheet's fields made into a blank: a rectangle, an own mesh or an outline."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields
from typing import TypeVar

import numpy as np
from mpi4py import MPI

from ..core import timing
from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.status import task
from .blank import Blank
from .sheet import Layout, SheetFields, Values

MAX_SIDE = 1e6  # mm, beyond which fine grids over a sheet fill any memory
SIZE_TOLERANCE = 1e-3  # of a length, by which an own mesh may differ from what is asked for
Kind = TypeVar("Kind", bound=SheetFields)


def mesh_sheet(
    sheet: Kind,
    comm: MPI.Comm,
    *,
    spatial: bool = False,
    turned: float = 0.0,
    centred: bool | Sequence[bool] = False,
    planes: Mapping[int, float] | None = None,
    height: float | None = None,
) -> tuple[Kind, Blank, list[str]]:
    """The sheet with the values that its mesh has, its blank, and doubts.

    sheet: with its `defaults`; spatial: free to leave its plane; turned, centred, planes: as in
    `Blank.outline`; height: as in `Blank.read`. Raises InputError as `Blank` does, and for fields
    that do not fit the mesh.
    """
    names, source, planes = [*sheet.SIDES], sheet.sheet_file or "the specimen", planes or {}
    sides = names[0], names[-1]
    with timing.phase("setup"), task("meshing the sheet"):
        how: Values = {"spatial": spatial, "comm": comm, "centred": centred}
        cells: Values = {each.name: getattr(sheet, each.name) for each in fields(Layout)}
        cells |= {"turned": turned, "planes": planes}
        if sheet.mesh:
            blank = Blank.read(sheet.mesh, height=height, **how, **sheet.options(turned))
        elif sheet.outline:
            cells |= {"size": sheet.size, "layer": sheet.layer}
            blank = Blank.outline(sheet.outline, **how, **cells)
        else:
            modelled = modelled_share(planes) * [getattr(sheet, name) for name in sides]
            blank = Blank.rectangle(**dict(zip(("length", "width"), modelled)), **how, **cells)
    if blank.mesh.geometry.dim == 3 and not spatial:
        raise InputError(f"{source} is not flat; expected a sheet in a plane z = const")
    kind = "P" if blank.around == [0, 1, 2] else "Q"
    if sheet.element and sheet.element[0] != kind:
        flaw = f"`element` {sheet.element} does not fit the cells of {source}"
        raise InputError(f"{flaw}; expected P on triangles, Q on quadrilaterals")
    if (side := blank.sides().max()) > MAX_SIDE:
        raise InputError(f"{source} is {rounded(side)} mm large; expected up to 1e6 mm")
    doubts = [*blank.warnings, size_warning(blank, source)]
    integration = sheet.integration or "full"
    if not sheet.integration and blank.degree == 2 and blank.triangulated:
        follow = sheet.pattern in ("yarns", "graded") or blank.whole.follows_yarns()
        integration = sheet.points_of_p2(follow)
    values: Values = {"element": f"{kind}{blank.degree}", "integration": integration}
    if sheet.sheet_file:
        idle = ("nx", "ny", "pattern") if sheet.mesh else ("ny",)
        usual = None, type(sheet).pattern
        if asked := ", ".join(f"`{name}`" for name in idle if getattr(sheet, name) not in usual):
            why = "has its own cells" if sheet.mesh else "has cells of one size"
            doubts.append(f"{asked} has no effect, because {source} {why}")
        values |= _own_sizes(sheet, sides, blank, planes) | dict.fromkeys(idle)
    return sheet.filled(**values), blank, [*filter(None, doubts)]


def modelled_share(planes: Collection[int]) -> np.ndarray:
    """Shares (2,) of length and width that planes of symmetry perpendicular to these axes leave."""
    return np.where(np.isin([0, 1], [*planes]), 0.5, 1.0)


def whole_sides(blank: Blank, planes: Collection[int]) -> list[float]:
    """Length and width of the whole sheet [mm], rounded, to be the same on any number of ranks."""
    return [float(f"{size:.9g}") for size in blank.sides()[:2] / modelled_share(planes)]


def size_warning(blank: Blank, source: str) -> str:
    """A sentence if the sheet's size may be in another unit than mm, else ""."""
    if 20 <= blank.sides().max() <= 10_000:  # a few yarns, more than looms weave
        return ""
    sides = " x ".join(rounded(side, 4) for side in blank.sides())
    return f"{source} is {sides} mm; lengths must be in mm (metres times 1000, inches times 25.4)"


def _own_sizes(sheet, names, blank, planes):
    """Length and width of an own mesh, by their fields, of a square the same one."""
    sizes = dict[str, float]()
    for name, size in zip(names, whole_sides(blank, planes)):
        asked = sizes.setdefault(name, getattr(sheet, name) or size)
        if abs(asked - size) > SIZE_TOLERANCE * size:
            given = f"`{name}` {asked:g} does not fit {sheet.sheet_file}, of {size:g} mm"
            raise InputError(f"{given}; expected its own, or none")
        sizes[name] = size
    return sizes
