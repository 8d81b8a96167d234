"""A sheet's fields made into a blank: a rectangle, an own mesh or an outline."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from .. import dolfinx_compat as compat
from ..mechanics.shell.membrane_warnings import size_warning
from ..runtime import timing
from ..runtime.errors import InputError
from ..runtime.status import task
from ..sheets.blank import Blank
from ..sheets.layout import Layout, blank_options
from ..sheets.sheet_fields import SheetFields

FITS = 1e-3  # of a length, by which an own mesh may differ from what is asked for


class Laid(NamedTuple):
    """A `blank`; settled: fields of the sheet to which its mesh gave their values; warnings."""

    blank: Blank
    settled: dict[str, Any]
    warnings: list[str]


def lay(
    sheet: SheetFields,
    sides: tuple[str, str],
    comm: MPI.Comm,
    *,
    spatial: bool = False,
    planes: Sequence[int] = (),
    height: float | None = None,
    **layout: Any,
) -> Laid:
    """Mesh a sheet, and check it.

    sides: names of its fields of length and width; spatial: free to leave its plane; planes: axes
    to which planes of symmetry through the origin are perpendicular; height: as in `Blank.read`;
    layout: `turned` and `centred` of `Layout`. Raises InputError as `Blank` does, and for fields
    that do not fit the mesh.
    """
    source = sheet.sheet_file or "the specimen"
    with timing.phase("setup"), task("meshing the sheet"):
        blank = _blank(sheet, sides, comm, spatial, planes, height, layout)
    if blank.mesh.geometry.dim == 3 and not spatial:
        raise InputError(
            f"{source} is not plane in z; allowed in this study is a sheet in a plane z = const"
        )
    kind = "P" if compat.cell_name(blank.mesh) == "triangle" else "Q"
    if sheet.element and sheet.element[0] != kind:
        raise InputError(
            f"`element` {sheet.element} does not fit the cells of {source}; "
            "allowed is P on triangles, Q on quadrilaterals"
        )
    settled: dict[str, Any] = {"element": f"{kind}{blank.degree}"}
    warnings = [*blank.warnings, size_warning(blank, source)]
    if sheet.sheet_file:
        warnings.append(_idle_warning(sheet))
        settled |= _own_sizes(sheet, sides, blank, planes)
        settled |= dict.fromkeys(("nx", "ny", "pattern") if sheet.mesh else ("ny",))
    return Laid(blank, settled, [*filter(None, warnings)])


def modelled(planes: Sequence[int]) -> np.ndarray:
    """Shares (2,) of length and width that are modelled."""
    return np.where(np.isin([0, 1], planes), 0.5, 1.0)


def _blank(sheet, sides, comm, spatial, planes, height, more):
    layout: Layout = {
        "element": sheet.element,
        "fibre_angle": sheet.fibre_angle,
        "yarn_angle": sheet.yarn_angle,
        **more,
    }
    if sheet.mesh:
        place = {"centred": more.get("centred", False), "height": height}
        options = blank_options(layout)
        return Blank.read(sheet.mesh, spatial=spatial, comm=comm, **place, **options)
    how = {"pattern": sheet.pattern, "spatial": spatial, "comm": comm}
    if sheet.outline:
        cells = {"nx": sheet.nx or 1, "size": sheet.size, "layer": sheet.layer, "planes": planes}
        return Blank.outline(sheet.outline, **cells, **how, **layout)
    length, width = modelled(planes) * [getattr(sheet, side) for side in sides]
    return Blank.rectangle(length, width, nx=sheet.nx, ny=sheet.ny, **how, **layout)


def _own_sizes(sheet, sides, blank, planes):
    """Length and width of an own mesh, by their fields."""
    low, high = blank.extent()
    # rounded, to be the same on any number of ranks
    own = [float(f"{size:.9g}") for size in (high - low)[:2] / modelled(planes)]
    where = sheet.sheet_file
    if sides[0] == sides[1] and abs(own[0] - own[1]) > FITS * own[0]:
        raise InputError(
            f"{where} is {own[0]:g} x {own[1]:g} mm; allowed in this study is a square"
        )
    for name, size in zip(sides, own):
        asked = getattr(sheet, name)
        if asked is not None and abs(asked - size) > FITS * size:
            raise InputError(
                f"`{name}` {asked:g} does not fit {where}, of {size:g} mm; allowed "
                "is its own, or none"
            )
    return dict(zip(sides, own))


def _idle_warning(sheet):
    """A sentence on fields that change nothing beside an own mesh, or ""."""
    idle = {"nx": None, "ny": None, "pattern": type(sheet).pattern}
    asked = [k for k, usual in idle.items() if getattr(sheet, k) not in (None, usual)]
    names = ", ".join(f"`{k}`" for k in asked if sheet.mesh or k == "ny")
    why = "has its own cells" if sheet.mesh else "has cells of one size"
    return f"{names} changes nothing, as {sheet.sheet_file} {why}" if names else ""
