"""Sheets laid on one another: one mesh with a part for each."""

from collections.abc import Sequence

import numpy as np

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.rules import FINITE, POSITIVE
from .blank import Blank, Part


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
        blanks, given, names = map(list, zip(*sheets))
        words = [f"thickness of sheet {each} of the stack" for each in names]
        t = np.array([*map(POSITIVE.check, words, given)])
        if flaw := _flaw(blanks, names):
            raise InputError(flaw)
        play = FINITE.check("`play` of the stack", play)
        if bottom is not None:
            bottom = FINITE.check("`bottom` of the stack", bottom)
        middles = np.cumsum([0.0, *(t[:-1] + play)]) + t / 2
        low = [blank.extent()[0][2] for blank in blanks]
        self.heights = middles + (low[0] - middles[0] if bottom is None else bottom)
        points, cells, rows = _merged(blanks, self.heights - low)
        comm, kind = blanks[0].mesh.comm, compat.cell_name(blanks[0].mesh)
        here = slice(None if comm.rank == 0 else 0)  # rank 0 gives all of the mesh
        mesh = compat.create_mesh(comm, cells[here], points[here], kind, 1)
        a, b, number = np.split(rows[mesh.topology.original_cell_index], [3, 6], axis=1)
        degree = max(blank.degree for blank in blanks)
        super().__init__(mesh, lambda x: a.T, lambda x: b.T, degree=degree, name=name)
        self.thickness = float(t.sum())  # of all sheets together [mm]
        self.blanks = blanks
        self.number = number[:, 0].astype(np.int32)
        self.warnings = [text for blank in blanks for text in blank.warnings]
        for k, (blank, part) in enumerate(zip(blanks, names)):
            at = np.flatnonzero(self.number == k)
            self.parts[part] = Part(self, part, at, float(t[k]), blank.orthogonal)

    def is_flat(self) -> bool:
        """True, as its sheets are."""
        return True


def _flaw(blanks, names):
    """Why these sheets make no stack, and what is allowed; else ""."""
    if len(set(names)) < len(names) or not all(names):
        return f"sheets of the stack have the names {names}; expected different names"
    kinds = {compat.cell_name(blank.mesh) for blank in blanks}
    if len(kinds) > 1:
        return f"the stack has sheets of {sorted(kinds)}s; expected one kind of cells"
    for blank, name in zip(blanks, names):
        where = f"sheet {name} of the stack"
        if blank.mesh.geometry.dim != 3 or not np.array_equal(blank.frame, np.eye(3)):
            flaw = "lies in a plane mesh or along turned axes"
            return f"{where} {flaw}; expected a sheet in space (`spatial=True`)"
        if not (blank.degree == 1 or blank.triangulated) or compat.geometry_degree(blank.mesh) > 1:
            return f"{where} has other cells; expected P1, P2 and Q1, not curved"
        height, size = blank.sides()[2], blank.sides().max()
        if height > 1e-9 * size:
            return f"{where} is {rounded(height, 4)} mm high; expected a flat sheet, z = const"
    return ""


def _merged(blanks, lifts):
    """Points (n, 3) and cells (m, nodes) of one mesh of all lifted blanks, of all ranks. Then, of
    each cell, yarns a and b and the number of its sheet (m, 7)."""
    parts, before = [], 0
    for k, (blank, lift) in enumerate(zip(blanks, lifts)):
        geometry, owned = blank.mesh.geometry, len(blank.cell_nodes)
        numbers, local = geometry.index_map(), compat.geometry_dofmap(blank.mesh)[:owned]
        known = numbers.local_to_global(local.ravel().astype(np.int32)).reshape(local.shape)
        yarns = [f.x.array.reshape(-1, 3)[:owned] for f in (blank.a0, blank.b0)]
        here = (
            geometry.x[: numbers.size_local] + [0.0, 0.0, lift],
            known + before,
            np.hstack([*yarns, np.full((owned, 1), float(k))]),
        )
        # by rank, as DOLFINx numbers points
        parts.append([np.concatenate(blank.mesh.comm.allgather(each)) for each in here])
        before += numbers.size_global
    return [np.concatenate(each) for each in zip(*parts)]
