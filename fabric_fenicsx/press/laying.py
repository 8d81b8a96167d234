"""The blank of a press: sheets of cells, one or a stack."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..core.collective_errors import on_all
from ..core.errors import InputError
from ..core.formatting import rounded
from ..energy.term import Term
from ..io.field import Field
from ..sheet.blank import Blank
from ..sheet.meshing import mesh_sheet, modelled_share, whole_sides
from ..sheet.sheet import Sheet
from ..sheet.stack import Stack

PLANE_TOLERANCE = 1e-6  # mm off a plane of symmetry up to which nodes lie on it
CELLS = 48  # default along the whole length, of linear cells or halves of quadratic ones


@dataclass(frozen=True)
class Laid:
    """The blank of a press, in space, and its sheets with final names, materials and meshes; first:
    the lowest one of fabric, or of metal alone; sides: its whole length and width; centre (2,): the
    whole blank's centroid [mm]."""

    blank: Blank
    sheets: Sequence[Sheet]
    first: Sheet
    sides: Sequence[float]
    centre: np.ndarray

    @property
    def blanks(self) -> list[Blank]:
        """The blank of each sheet."""
        return self.stack.blanks if self.stack else [self.blank]

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

    def distance(self, place: ArrayLike) -> float:
        """Distance of a place (x, y) from the flat blank, 0 on it; on all ranks together [mm]."""
        cells = shapely.polygons(self.blank.corners()[:, :, :2])
        off = shapely.distance(cells, shapely.Point(np.asarray(place))).min(initial=np.inf)
        return float(self.blank.mesh.comm.allreduce(off, MPI.MIN))

    def nearest_nodes(self, place: ArrayLike) -> Callable[[np.ndarray], np.ndarray]:
        """Function of points (3, n) to a mask (n,) of one node of each sheet: the nearest to
        `place` (x, y) [mm]; of equally near ones the one with the largest x, then y."""
        nodes = []
        for part in list(self.blank.parts.values()) or [self.blank.whole]:
            x = part.blank.coordinates()[: len(part.nodes)][part.nodes]
            away = np.hypot(*(x[:, :2] - np.asarray(place)).T).round(6)
            local = sorted(np.column_stack([away, -x]).tolist())[:1]
            nodes.append(min(sum(self.blank.mesh.comm.allgather(local), [])))
        places = -np.array(nodes)[:, 1:]
        return lambda x: (np.linalg.norm(x.T[:, None] - places, axis=2) < 1e-6).any(1)


def on_plane(axis: int, place: float) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) to a mask (n,) of those on the plane of symmetry at a place."""
    return lambda x: x[axis] < place + PLANE_TOLERANCE


def lay_blank(
    sheets: Sequence[Sheet], planes: Mapping[int, float], comm: MPI.Comm, rigid: bool, finer: float
) -> tuple[Laid, list[str]]:
    """The blank of a press, and doubts. planes: as of `PressData`; rigid: fabric keeps its
    thickness under pressure; finer: times as many cells as `CELLS` by default. Raises InputError
    for sheets that can't be meshed, and for own meshes that reach beyond planes of symmetry or not
    to them."""
    sheets = [s.filled(name=s.name or f"ply {number}") for number, s in enumerate(sheets, 1)]
    cells = math.ceil(finer * CELLS * modelled_share(planes)[0])
    made = [_mesh(sheet, cells, planes, comm, rigid) for sheet in sheets]
    # if cells do not follow the yarns all sheets are quadratic, by default twice as large, so that
    # there are as many nodes
    if any(blank.degree == 2 for _, blank, _ in made) and not any(s.element for s in sheets):
        for k, sheet in enumerate(sheets):
            if not (sheet.nx or sheet.size or sheet.mesh):
                made[k] = _mesh(sheet.filled(element="P2"), -(-cells // 2), planes, comm, rigid)
    final, blanks, doubts = zip(*made)
    for sheet, blank in zip(final, blanks):
        path = f"ply {sheet.name}" if final[1:] else sheet.sheet_file or "the blank"
        _check_symmetric(blank, path, planes)
    first, whole = next((k for k, sheet in enumerate(final) if sheet.fabric), 0), blanks[0]
    if final[1:]:
        # the upper face of the last one, on which the die lies, is half of the whole thickness
        # above z = 0
        plies = [(b, s.thickness_under(0.0), s.name) for s, b in zip(final, blanks)]
        whole = Stack(plies, -sum(height for _, height, _ in plies) / 2)
    areas, places = whole.areas(), whole.midpoints()[:2]
    *sums, area = comm.allreduce(np.append(places @ areas, areas.sum()), MPI.SUM)
    centre = np.array(sums) / area
    centre[[*planes]] = [*planes.values()]
    mirrors = [*filter(None, (mirrored_yarns(*each, planes) for each in zip(final, blanks)))]
    laid = Laid(whole, final, final[first], whole_sides(blanks[first], planes), centre)
    return laid, mirrors + sum(doubts, [])


def _mesh(sheet, nx, planes, comm, rigid):
    """As `mesh_sheet`: with this `nx` unless it says another, and a node at its middle."""
    wanted = {"`fabric` or `metal`": sheet.metal or sheet.fabric}
    size = sheet.sheet_file or (sheet.length and sheet.width)
    wanted["`length` and `width`, `outline` or `mesh`"] = size
    if missing := [what for what, value in wanted.items() if not value]:
        raise InputError(f"a sheet needs {missing[0]}")
    values = sheet.defaults(nx)
    if not (1 in planes or sheet.sheet_file or sheet.ny):
        nx, length = sheet.nx or nx, modelled_share(planes)[0] * sheet.length
        values["ny"] = 2 * max(1, round(nx * sheet.width / length / 2))
    values["metal" if sheet.metal else "fabric"] = sheet.material(rigid)
    centred = sheet.centred if sheet.sheet_file else [axis not in planes for axis in (0, 1)]
    final, blank, doubts = mesh_sheet(
        sheet.filled(**values), comm, spatial=True, centred=centred, planes=planes, height=0.0
    )
    if isinstance(sheet.thickness, Field):  # the fabric has the largest one
        x = np.vstack([blank.coordinates(), blank.centres()])
        largest = on_all(comm, lambda: float(sheet.thickness.at(x).max(initial=0.0)))
        thickness = comm.allreduce(largest, MPI.MAX)
        final = final.filled(fabric=final.fabric.replace(thickness=thickness))
    return final, blank, doubts


def _check_symmetric(blank, source, planes):
    """Raise InputError for a sheet that a plane of symmetry would cut, or without an edge on it."""
    for axis, place in planes.items():
        name, start, end = "xy"[axis], *(float(each[axis]) for each in blank.extent())
        cut = start - place < -1e-3 * (end - start)
        if cut or start - place > PLANE_TOLERANCE:
            raise InputError(
                f"{source} reaches from {name} = {rounded(start, 4)} to {rounded(end, 4)} mm, "
                f"{'beyond' if cut else 'but not to'} the plane of symmetry {name} = {place:g}; "
                f"expected the whole blank, or a mesh of its part {name} >= {place:g} with an "
                "edge on the plane"
            )


def mirrored_yarns(sheet: Sheet, blank: Blank, planes: Mapping[int, float]) -> str:
    """A warning, on all ranks, if planes across these axes don't mirror the yarns into yarns of the
    same kind, otherwise "". A file of points may know of the modelled part alone, and is
    trusted."""
    angle, between, comm = sheet.fibre_angle, sheet.yarn_angle, blank.mesh.comm
    if not sheet.fabric or (isinstance(angle, Field) and not callable(angle.source)):
        return ""
    x, where = blank.centres(), "yarns given by a function"
    if not isinstance(angle, Field):
        x, where = np.zeros((1, 3)), f"yarns at {angle:g} and {angle + between:g} deg"
    images = [np.where(np.arange(3) == axis, 2 * place - x, x) for axis, place in planes.items()]
    both = on_all(comm, lambda: [sheet.fibre_angles(y) + sheet.fibre_angles(x) for y in images])
    one, two, sheared = np.array([[0.01, 0.02], [0.02, 0.01], [0.1, 0.1]])
    alike = math.isclose(*sheet.fabric.derivatives(one, two, sheared, False).parts.sum(1))
    for angles in both:
        # yarns a and b take each other's place, or each its own: multiples of 180 deg
        off = np.abs([(angles + k * between + 90) % 180 - 90 for k in (0, 1, 2)])
        a, swapped, b = np.all(comm.allgather((off < 1e-6).all(1)), axis=0)
        if not ((a and b) or (swapped and alike)):
            differ = ", because warp and weft differ" if swapped else ""
            part = ("half", "quarter")[len(planes) - 1]
            return (
                f"{where} are not symmetric{differ}, so the {part} represents a ply of mirrored "
                "parts; use the whole ply"
            )
    return ""
