"""Sheets laid on one another: one mesh with a part for each."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.rules import FINITE, POSITIVE
from .blank import Blank, Part


class StackedSheet(NamedTuple):
    """A flat blank in space, its thickness [mm], and its name, by which `on` puts a term on it."""

    blank: Blank
    thickness: float
    name: str


class Stack(Blank):
    """Sheets, the lowest first, each laid on the one below: a blank whose `parts` they are. They
    may differ in outline, cells and yarns, not in kind of cells; if one is of degree 2, all are.

    sheets: list of flat blanks in space, their thicknesses [mm] and the names of their parts;
    bottom: height z of the lowest face, by default that of the first sheet, play: between sheets
    [mm]; name: of the stack in messages. Raises InputError for sheets in a plane mesh, not flat in
    z, of other cells than P1, P2 and Q1 or of different kinds, without a name of their own or a
    thickness above 0, or beside all others.

    Examples
    --------
    >>> plies = [ff.Blank.rectangle(60, 40, nx=3, spatial=True, fibre_angle=a) for a in (0, 45)]
    >>> stack = ff.Stack([(plies[0], 0.5, "lower"), (plies[1], 0.5, "upper")], bottom=0)
    >>> list(stack.parts), stack.heights
    (['lower', 'upper'], array([0.25, 0.75]))
    """

    def __init__(
        self,
        sheets: Sequence[tuple[Blank, float, str]],
        bottom: float | None = None,
        play: float = 0.0,
        name: str = "stack",
    ) -> None:
        self.sheets = [
            StackedSheet(blank, POSITIVE.check(f"thickness of sheet {part} of the stack", t), part)
            for blank, t, part in sheets
        ]
        if flaw := _flaw(self.sheets):
            raise InputError(flaw)
        play = FINITE.check("`play` of the stack", play)
        if bottom is not None:
            bottom = FINITE.check("`bottom` of the stack", bottom)
        first = self.sheets[0].blank.mesh
        comm = first.comm
        lower_faces = np.cumsum([0.0, *(s.thickness + play for s in self.sheets[:-1])])
        middles = lower_faces + [s.thickness / 2 for s in self.sheets]
        low = [sheet.blank.extent()[0][2] for sheet in self.sheets]
        self.heights = middles + (low[0] - middles[0] if bottom is None else bottom)
        points, cells, kept = _merged(self.sheets, self.heights - low, comm)
        mesh = compat.create_mesh(comm, cells, points, compat.cell_name(first), 1)
        # yarns and sheet of each cell in the order in which all ranks gave them
        rows = np.concatenate(comm.allgather(kept))[mesh.topology.original_cell_index]
        a, b, number = np.split(rows, [3, 6], axis=1)
        degree = max(sheet.blank.degree for sheet in self.sheets)
        super().__init__(mesh, lambda x: a.T, lambda x: b.T, degree=degree, name=name)
        self.number = number[:, 0].astype(np.int32)
        self.from_file = any(sheet.blank.from_file for sheet in self.sheets)
        self.warnings = [text for sheet in self.sheets for text in sheet.blank.warnings]
        for k, (blank, thickness, part) in enumerate(self.sheets):
            at = np.flatnonzero(self.number == k)
            self.parts[part] = Part(self, part, at, thickness, blank.orthogonal)

    def is_flat(self) -> bool:
        """True, as its sheets are."""
        return True

    @property
    def thickness(self) -> float:
        """Thickness of all sheets together [mm]."""
        return sum(sheet.thickness for sheet in self.sheets)


def _flaw(sheets):
    """Why these sheets make no stack, and what is allowed; else ""."""
    names = [sheet.name for sheet in sheets]
    if len(set(names)) < len(names) or not all(names):
        return f"sheets of the stack are named {names}; allowed are different names"
    kinds = {compat.cell_name(sheet.blank.mesh) for sheet in sheets}
    if len(kinds) > 1:
        return f"the stack has sheets of {sorted(kinds)}s; allowed is one kind of cells"
    for blank, _, name in sheets:
        where = f"sheet {name} of the stack"
        if blank.mesh.geometry.dim != 3 or not np.array_equal(blank.frame, np.eye(3)):
            flaw = "lies in a plane mesh or along turned axes"
            return f"{where} {flaw}; allowed is a sheet in space (`spatial=True`)"
        if not (blank.degree == 1 or blank.triangulated) or compat.geometry_degree(blank.mesh) > 1:
            return f"{where} has other cells; allowed are P1, P2 and Q1, not curved"
        height, size = blank.sides()[2], blank.sides().max()
        if height > 1e-9 * size:
            return f"{where} is {rounded(height, 4)} mm high; allowed is a flat sheet, z = const"
    return ""


def _merged(sheets, lifts, comm):
    """This rank's points (n, 3) and cells (m, nodes) of one mesh of all lifted sheets. Then, of
    each cell, yarns a and b and the number of its sheet (m, 7)."""
    maps = [sheet.blank.mesh.geometry.index_map() for sheet in sheets]
    counts = np.array(comm.allgather([each.size_local for each in maps]))  # (ranks, sheets)
    # points are numbered by rank, then by sheet
    before = np.concatenate([[0], counts.ravel().cumsum()[:-1]]).reshape(counts.shape)
    points, cells, kept = [], [], []
    for k, (sheet, index_map, lift) in enumerate(zip(sheets, maps, lifts)):
        mesh = sheet.blank.mesh
        owned = mesh.topology.index_map(2).size_local
        points.append(mesh.geometry.x[: index_map.size_local] + [0.0, 0.0, lift])
        local = compat.geometry_dofmap(mesh)[:owned]
        known = index_map.local_to_global(local.ravel().astype(np.int32))
        ends = counts[:, k].cumsum()
        rank = np.searchsorted(ends, known, side="right")
        number = known - (ends - counts[:, k])[rank] + before[rank, k]
        cells.append(number.reshape(local.shape))
        fields = [f.x.array.reshape(-1, 3)[:owned] for f in (sheet.blank.a0, sheet.blank.b0)]
        kept.append(np.hstack([*fields, np.full((owned, 1), float(k))]))
    return np.concatenate(points), np.concatenate(cells).astype(np.int64), np.concatenate(kept)
