"""The blank of a press: sheets of cells, one or a stack."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..coupons.laying import lay, modelled
from ..mechanics.term import Term
from ..readers.field import Field
from ..runtime.collective_errors import on_all
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..sheets.blank import Blank
from ..sheets.stack import Stack
from .sheet import Sheet

DEFAULT_NX = 24  # rectangles along the length, unless a sheet says others
PLANE_TOLERANCE = 1e-6  # mm off a plane of symmetry up to which nodes lie on it


@dataclass(frozen=True)
class Laid:
    """The blank of a press, in space, and its sheets with final names, materials and meshes; sides:
    length and width of the whole `first` sheet, centre (2,): the whole blank's centroid [mm]."""

    blank: Blank
    sheets: Sequence[Sheet]
    sides: Sequence[float]
    centre: np.ndarray

    @property
    def first(self) -> Sheet:
        """The lowest sheet of fabric, or of metal alone."""
        return self.sheets[first_fabric(self.sheets)]

    @property
    def blanks(self) -> list[Blank]:
        """The blank of each sheet."""
        return [sheet.blank for sheet in self.stack.sheets] if self.stack else [self.blank]

    @property
    def stack(self) -> Stack | None:
        """The blank, if it is a stack."""
        return self.blank if isinstance(self.blank, Stack) else None

    def on(self, sheet: Sheet, term: Term) -> Term:
        """A term, of a stack on this sheet of it."""
        return term.on(sheet.name) if self.stack else term

    def flat_nodes(self) -> np.ndarray:
        """Nodes (n, 3) of this rank [mm], as if all sheets lay in the blank's middle, z = 0."""
        owned = self.blank.V.dofmap.index_map.size_local
        return self.blank.coordinates()[:owned] * (1, 1, 0)

    def extents(self) -> list[np.ndarray]:
        """Length and width (2,) of the modelled part of each sheet [mm]."""
        return [np.subtract(*blank.extent()[::-1])[:2] for blank in self.blanks]

    def nearest_nodes(self, place: ArrayLike) -> Callable[[np.ndarray], np.ndarray]:
        """Function of points (3, n) to a mask (n,) of one node of each sheet: the nearest to
        `place` (x, y) [mm]; of equally near ones the one with the largest x, then y."""
        nodes = []
        for part in list(self.blank.parts.values()) or [self.blank.whole]:
            x = part.blank.coordinates()[: len(part.nodes)][part.nodes]
            away = np.hypot(*(x[:, :2] - np.asarray(place)).T).round(6)
            order = np.lexsort((-x[:, 1], -x[:, 0], away))[:1]
            mine = [(away[k], *-x[k]) for k in order]
            nodes.append(
                min(each for rank in self.blank.mesh.comm.allgather(mine) for each in rank)
            )
        places = -np.array(nodes)[:, 1:]
        return lambda x: (np.linalg.norm(x.T[:, None] - places, axis=2) < 1e-6).any(1)


def on_plane(axis: int) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) to a mask (n,) of those on a plane of symmetry."""
    return lambda x: x[axis] < PLANE_TOLERANCE


def lay_blank(
    sheets: Sequence[Sheet], planes: Sequence[int], comm: MPI.Comm, rigid: bool = False
) -> tuple[Laid, list[str]]:
    """The blank of a press, and doubts. planes: axes to which planes of symmetry are perpendicular;
    rigid: fabric keeps its thickness under pressure. Raises InputError for sheets that can't be
    meshed, and for own meshes that reach beyond planes of symmetry or not to them."""
    sheets, warnings = [s.ready(f"ply {k}", rigid) for k, s in enumerate(sheets, 1)], list[str]()
    made, meshed = _meshed(sheets, planes, comm)
    part = ("whole", "half", "quarter")[len(planes)]
    for sheet, laid in zip(made, meshed):
        at, warning = laid.blank.centres(), partial(sheet.mirror_warning, part, planes)
        own = on_all(comm, partial(warning, at))
        warnings += [text for text in comm.allgather(own) if text][:1]
    for sheet, laid in zip(made, meshed):
        path = f"ply {sheet.name}" if made[1:] else sheet.sheet_file or "the blank"
        _check_symmetric(laid.blank, path, planes)
        warnings += laid.warnings
    blanks = [each.blank for each in meshed]
    sheets = [
        dataclasses.replace(
            _as_thick(sheet, laid.blank), **laid.settled, integration=sheet.integration or "full"
        )
        for sheet, laid in zip(made, meshed)
    ]
    low, high = blanks[first_fabric(sheets)].extent()
    # rounded, to be the same on any number of ranks
    sides = [float(f"{size:.9g}") for size in (high - low)[:2] / modelled(planes)]
    blank = blanks[0]
    if sheets[1:]:
        # the upper face of the last one, on which the die lies, is half of the whole thickness
        # above z = 0
        heights = [sheet.thickness_under(0.0) for sheet in sheets]
        names = [sheet.name for sheet in sheets]
        blank = Stack(list(zip(blanks, heights, names)), -sum(heights) / 2)
    areas, places = blank.areas(), blank.midpoints()[:2]
    *sums, area = comm.allreduce(np.append(places @ areas, areas.sum()), MPI.SUM)
    centre = np.array(sums) / area
    centre[list(planes)] = 0.0
    return Laid(blank, sheets, sides, centre), warnings


def _as_thick(sheet, blank):
    """The sheet; the fabric of one whose thickness is a field has the largest on this blank."""
    if not isinstance(sheet.thickness, Field):
        return sheet
    comm, x = blank.mesh.comm, np.vstack([blank.coordinates(), blank.centres()])
    own = on_all(comm, lambda: float(sheet.thickness.at(x).max(initial=0.0)))
    most = comm.allreduce(own, MPI.MAX)
    return dataclasses.replace(sheet, fabric=sheet.fabric.replace(thickness=most))


def first_fabric(sheets: Sequence[Sheet]) -> int:
    """Number of the lowest sheet of fabric, 0 if all are of metal."""
    return next((k for k, sheet in enumerate(sheets) if sheet.fabric), 0)


def _meshed(sheets, planes, comm):
    """The sheets with their defaults, and each one laid. If cells do not follow the yarns, all
    are quadratic; by default they are twice as large, so that there are as many nodes."""
    asked = any(sheet.element for sheet in sheets)
    made = [_with_nx(sheet, DEFAULT_NX, planes) for sheet in sheets]
    meshed = [_laid(sheet, planes, comm) for sheet in made]
    if not asked and made != sheets and max(each.blank.degree for each in meshed) == 2:
        made = [_with_nx(sheet, DEFAULT_NX // 2, planes, "P2") for sheet in sheets]
        meshed = [_laid(sheet, planes, comm) for sheet in made]
    return made, meshed


def _with_nx(sheet, nx, planes, element=None):
    """The sheet with this `nx` and element, unless it says others, and a node at its middle."""
    usual = not (sheet.nx or sheet.size or sheet.mesh)
    sheet = dataclasses.replace(sheet, element=element) if usual and element else sheet
    sheet = sheet.with_defaults(nx + (nx % 2 if usual and 0 not in planes else 0))
    if 1 in planes or sheet.sheet_file or sheet.ny:
        return sheet
    length = modelled(planes)[0] * sheet.length
    return dataclasses.replace(sheet, ny=2 * max(1, round(sheet.nx * sheet.width / length / 2)))


def _laid(sheet, planes, comm):
    own = [axis not in planes for axis in (0, 1)]
    return lay(
        sheet,
        ("length", "width"),
        comm,
        spatial=True,
        planes=planes,
        height=0.0,
        centred=sheet.centred if sheet.sheet_file else own,
    )


def _check_symmetric(blank, source, planes):
    """Raise InputError for a sheet that a plane of symmetry would cut, or without an edge on it."""
    low, high = (each[:2] for each in blank.extent())
    for axis in planes:
        name, start, end = "xy"[axis], low[axis], high[axis]
        reaches = f"{source} reaches from {name} = {rounded(start, 4)} to {rounded(end, 4)} mm"
        if start < -1e-3 * (end - start):
            raise InputError(
                f"{reaches}, beyond the plane of symmetry {name} = 0; allowed is the whole blank, "
                f"or a mesh of its part {name} >= 0"
            )
        if start > PLANE_TOLERANCE:
            raise InputError(
                f"{reaches}, but a plane of symmetry is {name} = 0; allowed is a mesh with an edge "
                "on it, or the whole blank"
            )
