"""The blank of a press: sheets of cells, one or a stack."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from .. import dolfinx_compat as compat
from ..mechanics.shell import mesh_warnings
from ..runtime import timing
from ..runtime.errors import InputError
from ..runtime.formatting import coordinates, rounded
from ..sheets.blank import Blank
from ..sheets.layout import Layout, blank_options
from ..sheets.stack import Stack
from .press import Press
from .sheet import Sheet, halved

USUAL_NX = 24  # rectangles along the length, unless a sheet says others
FITS = 1e-3  # of a length, by which a sheet may reach beyond a plane of symmetry
ON_PLANE = 1e-6  # mm off a plane of symmetry up to which nodes lie on it
OFF_CENTRE = 0.05  # of its extent, by which a sheet may lie off the origin without a word


@dataclass(frozen=True)
class Laid:
    """The blank of a press, in space, and its sheets with names, materials and meshes as they are;
    sides: length and width of the whole first sheet [mm]."""

    blank: Blank
    sheets: Sequence[Sheet]
    sides: Sequence[float]

    @property
    def blanks(self) -> list[Blank]:
        """The blank of each sheet."""
        stack = self.blank
        return [s.blank for s in stack.sheets] if isinstance(stack, Stack) else [stack]

    def flat_nodes(self) -> np.ndarray:
        """This rank's nodes (n, 3) [mm] as if all sheets lay in the blank's middle."""
        owned = self.blank.V.dofmap.index_map.size_local
        flat = 0 if isinstance(self.blank, Stack) else 1
        return self.blank.coordinates()[:owned] * (1, 1, flat)

    def extents(self) -> list[np.ndarray]:
        """Length and width of each sheet, of what is modelled (2,) [mm]."""
        return [np.subtract(*blank.extent()[::-1])[:2] for blank in self.blanks]


def lay(press: Press, comm: MPI.Comm, warnings: list[str]) -> Laid:
    """The blank of a press. Raises InputError for sheets that can't be meshed or do not suit a
    quarter."""
    sheets = [s.ready(f"ply {k}", press.interface) for k, s in enumerate(press.sheets, 1)]
    if press.quarter:
        warnings += filter(None, (sheet.mirror_warning() for sheet in sheets))
    sheets, blanks = _meshed_all(sheets, press.quarter, comm)
    one = not sheets[1:]
    for sheet, blank in zip(sheets, blanks):
        source = f"ply {sheet.name}" if sheets[1:] else sheet.file or "the blank"
        _check_place(blank, press, sheet, source, warnings)
        size = mesh_warnings.size_warning(blank, sheet.thickness_under(0.0), source)
        warnings += filter(None, [*blank.warnings, size])
        warnings += mesh_warnings.cell_warnings(blank, source) if sheet.file else []
    blank = blanks[0] if one else _piled(sheets, blanks)
    low, high = blanks[0].extent()
    share = 0.5 if press.quarter else 1.0
    # rounded, to be the same on any number of ranks
    sides = [float(f"{size / share:.9g}") for size in (high - low)[:2]]
    return Laid(blank, sheets, sides)


def _piled(sheets, blanks):
    """The sheets on one another without pressure. The upper face of the last one is half of all
    thicknesses over z = 0, where the die lies."""
    heights = [sheet.thickness_under(0.0) for sheet in sheets]
    names = [sheet.name for sheet in sheets]
    return Stack(list(zip(blanks, heights, names)), -sum(heights) / 2)


def _meshed_all(sheets, quarter, comm):
    """The sheets with their meshes as they are, and their blanks. Where a cell does not follow the
    yarns all are quadratic; by default such cells are twice as large, so that nodes are as many."""
    unasked = [not (sheet.nx or sheet.size or sheet.mesh) for sheet in sheets]

    def with_nx(nx, **mesh):
        nx += nx % 2 if not quarter else 0  # a node at the centre
        return [
            dataclasses.replace(sheet, **mesh, nx=nx) if usual else sheet
            for sheet, usual in zip(sheets, unasked)
        ]

    made = with_nx(USUAL_NX)
    blanks = [_meshed(sheet, quarter, comm) for sheet in made]
    asked = any(sheet.element for sheet in sheets)
    if any(unasked) and not asked and max(blank.degree for blank in blanks) == 2:
        made = with_nx(halved(USUAL_NX), element="P2")
        blanks = [_meshed(sheet, quarter, comm) for sheet in made]
    return [_as_meshed(*each, quarter) for each in zip(made, blanks)], blanks


def _as_meshed(sheet, blank, quarter):
    """The sheet with the values that its mesh has; InputError for an element of other cells."""
    kind = "P" if compat.cell_name(blank.mesh) == "triangle" else "Q"
    if sheet.element and sheet.element[0] != kind:
        raise InputError(
            f"`element` {sheet.element} does not fit the cells of {sheet.file}; allowed is P on "
            "triangles, Q on quadrilaterals"
        )
    mesh: dict[str, Any] = {"element": f"{kind}{blank.degree}"}
    if sheet.outline:
        mesh["pattern"] = sheet.pattern or "unstructured"
    elif not sheet.mesh:
        mesh |= {"ny": _across(sheet, quarter), "pattern": sheet.pattern or "crossed"}
    return dataclasses.replace(sheet, **mesh)


def _across(sheet, quarter):
    """Rectangles across the width; of a whole sheet by default an even number."""
    if sheet.ny or quarter:
        return sheet.ny
    return 2 * max(1, round(sheet.nx * sheet.width / sheet.length / 2))


def _meshed(sheet, quarter, comm):
    layout: Layout = {
        "element": sheet.element,
        "fibre_angle": sheet.fibre_angle,
        "yarn_angle": sheet.yarn_angle,
    }
    with timing.phase("setup"):
        if sheet.mesh:
            return Blank.read(sheet.mesh, spatial=True, comm=comm, **blank_options(layout))
        if sheet.outline:
            return Blank.outline(
                sheet.outline,
                nx=sheet.nx or 1,
                size=sheet.size,
                pattern=sheet.pattern or "unstructured",
                layer=sheet.layer,
                centred=sheet.centred,
                spatial=True,
                comm=comm,
                **layout,
            )
        share = 0.5 if quarter else 1.0
        return Blank.rectangle(
            share * sheet.length,
            share * sheet.width,
            nx=sheet.nx,
            ny=_across(sheet, quarter),
            pattern=sheet.pattern or "crossed",
            centred=not quarter,
            spatial=True,
            comm=comm,
            **layout,
        )


def _check_place(blank, press, sheet, source, warnings):
    """Raise InputError for a sheet that planes of symmetry would cut, or that has no edge on one of
    them; warn of a whole one that does not lie under the press."""
    low, high = (each[:2] for each in blank.extent())
    for axis, start, end in zip("xy", low, high) if press.quarter else ():
        reaches = f"{source} reaches from {axis} = {rounded(start, 4)} to {rounded(end, 4)} mm"
        if start < -FITS * (end - start):
            raise InputError(
                f"{reaches}, beyond the quarter x, y >= 0; allowed is the whole blank, or a quarter"
            )
        if start > ON_PLANE:
            raise InputError(
                f"{reaches}, but the planes of symmetry of a quarter are x = 0 and y = 0; allowed "
                "is a mesh with edges on both, or the whole blank"
            )
    middle = (low + high) / 2
    if not press.quarter and sheet.file and (abs(middle) > OFF_CENTRE * (high - low)).any():
        warnings.append(
            f"{source} has its centre at {coordinates(middle)} mm, and the press at (0, 0)"
            f"{'; `centred` puts it there' if sheet.outline else ''}"
        )
