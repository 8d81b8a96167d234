"""Energy, forces and stiffness of all terms, of those that are forms and of the others."""

from __future__ import annotations

import ctypes
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import reduce
from operator import add

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..core.errors import InputError
from ..sheet.blank import Blank
from .term import Term, Triplets, overrides

PETSC = ctypes.CDLL(PETSc.__file__)  # for what petsc4py does not offer


def assembled(form: ufl.Form) -> np.ndarray:
    """A linear form at this rank's owned degrees of freedom, (owned dofs,)."""
    return _owned(compat.form(form))


def _owned(form):
    f = fem_petsc.assemble_vector(form)
    f.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return f.array.copy()


def triplets(terms: Iterable[Term], narrow: bool = False) -> Triplets:
    """Rows, columns and values (k,) of the tangents, or narrow ones, of terms that are no forms."""
    parts = [term.preconditioner() if narrow else term.tangent() for term in terms]
    rows, cols, values = (np.concatenate(part) for part in zip(*parts))
    return rows, cols, values


class TripletPlaces:
    """Global `rows` and `cols` (k,) of triplets, for which A, assembled, is given places beside its
    own; those at one place are summed. The rows may be those of other ranks. All ranks make and use
    it together."""

    def __init__(self, A: PETSc.Mat, rows: np.ndarray, cols: np.ndarray) -> None:
        self._comm, self._rows, self._cols = A.comm.tompi4py(), rows, cols
        names = A.getLGMap()
        starts, columns, _ = A.getValuesCSR()
        self._none = np.zeros(len(columns))  # is added to A's own places
        in_rows = np.repeat(np.arange(*A.getOwnershipRange()), np.diff(starts))
        places = np.append(in_rows, rows), np.append(columns, cols)
        pointers = [end.astype(PETSc.IntType).ctypes.data_as(ctypes.c_void_p) for end in places]
        _call("MatSetPreallocationCOO", A, ctypes.c_ssize_t(len(places[0])), *pointers)
        A.setLGMap(*names)
        self._counts: np.ndarray | None = None  # which ones are in free rows and columns
        self.add(A, np.zeros(len(rows)))  # before which A is not assembled

    def add(self, A: PETSc.Mat, values: np.ndarray, free: PETSc.Vec | None = None) -> None:
        """Add triplets with these values (k,) to A. free: 0 at rows and columns that take none, 1
        at others; the same at each call. InputError for another number of values."""
        if len(values) != len(self._rows):
            raise InputError(
                "`tangent` of a term returns other rows and columns than before; expected the same "
                "unless `pattern` changes (`check_derivatives` with such a `size` shows which)"
            )
        if free is not None:
            if self._counts is None:
                everywhere = np.concatenate(self._comm.allgather(free.array > 0))
                self._counts = everywhere[self._rows] & everywhere[self._cols]
            values = np.where(self._counts, values, 0.0)
        given = np.concatenate([self._none, values])
        pointer = given.ctypes.data_as(ctypes.c_void_p)
        _call("MatSetValuesCOO", A, pointer, ctypes.c_int(PETSc.InsertMode.ADD))


class Assembly:
    """Energy, residual and tangent of `terms` on a `blank`. Terms that are forms are assembled by
    DOLFINx, the others add energies, forces and triplets."""

    def __init__(self, blank: Blank, terms: Sequence[Term]) -> None:
        self._blank, self._terms, self._comm = blank, terms, blank.mesh.comm
        self._loaded = [term for term in terms if overrides(term, "applied_forces")]
        v, w = ufl.TestFunction(blank.V), ufl.TrialFunction(blank.V)
        # one form is of one part and one edge, as these share their number
        on: dict[tuple, list[Sequence[ufl.Form]]] = {}
        self._energies: list[tuple[str | None, fem.Form]] = []
        self._loads: list[fem.Form] = []  # first variations of loads that are forms
        for term in terms:
            if term.energy is not None:
                pair = term.variations(v, w)
                on.setdefault((term.part_name, *_marked(term.energy)), []).append(pair)
                self._energies.append((term.energy_kind, compat.form(term.energy)))
                if term.energy_kind is None and term not in self._loaded:
                    self._loads.append(compat.form(pair[0]))
        zero = fem.Constant(blank.mesh, 0.0)
        nothing = zero * ufl.inner(blank.u, v) * ufl.dx, zero * ufl.inner(w, v) * ufl.dx
        groups = list(on.values()) or [[nothing]]
        sums = [[reduce(add, forms) for forms in zip(*pairs)] for pairs in groups]
        self._residuals, self._tangents = ([compat.form(pair[i]) for pair in sums] for i in (0, 1))
        # where any of the parts and edges has entries
        whole = ufl.inner(v, w) * ufl.dx
        if any(t.energy.integrals_by_type("interior_facet") for t in terms if t.energy):
            whole += ufl.inner(ufl.avg(v), ufl.avg(w)) * ufl.dS
        self._places = self._tangents[0] if list(on) == [("",)] else compat.form(whole)
        self._narrowing = [term for term in terms if overrides(term, "preconditioner")]
        # of the matrix and the narrow one: patterns, and places of the terms that are no forms
        self._made: dict[bool, tuple[list[int], TripletPlaces | None]] = {}

    def energies(self) -> dict[str | None, float]:
        """Energy of each kind now, of all ranks {kind: N mm}; None: minus the work of loads."""
        parts = [{kind: fem.assemble_scalar(form)} for kind, form in self._energies]
        parts += [term.energies() for term in self._terms]
        return _summed(self._comm.allgather(_summed(parts)))

    def applied_forces(self) -> list[np.ndarray]:
        """Forces of each tool and load (owned dofs,) [N], with which a residual is compared."""
        forces = [term.applied_forces() for term in self._loaded]
        return forces + [-_owned(form) for form in self._loads]

    def residual(self, f: PETSc.Vec) -> None:
        """Make f (local dofs,) the derivative of all energies [N]."""
        with f.localForm() as local:
            local.set(0)
        for form in self._residuals:
            fem_petsc.assemble_vector(f, form)
        with f.localForm() as local:
            for term in self._terms:
                term.add_forces(local.array)
        f.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)

    def create_matrix(self, narrow: bool = False) -> PETSc.Mat:
        """A matrix with entries where the present tangent, or the narrow one, has some."""
        PETSc.garbage_cleanup(self._comm)  # matrices and scatters of other places
        A = fem_petsc.create_matrix(self._places)
        patterns, extra = self._patterns(), None
        rows, cols, _ = triplets(self._terms, narrow)
        if self._comm.allreduce(len(rows), MPI.MAX) > 0:
            self._assemble(A, [])
            A.assemble()  # as unused places are given up
            extra = TripletPlaces(A, rows, cols)
        self._made[narrow] = patterns, extra
        A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        return A

    def places_changed(self, narrow: bool = False) -> bool:
        """True if `tangent` has other places than the matrix made last, on any rank."""
        return self._comm.allreduce(self._made[narrow][0] != self._patterns(), MPI.LOR)

    def tangent(
        self,
        A: PETSc.Mat,
        bcs: Sequence[fem.DirichletBC] = (),
        free: PETSc.Vec | None = None,
        narrow: bool = False,
    ) -> None:
        """Make A the second derivative of all energies [N/mm], or the narrow one near it, with unit
        rows and columns where `bcs` hold. free: 0 at what they hold, 1 elsewhere."""
        A.zeroEntries()
        self._assemble(A, bcs)
        if extra := self._made[narrow][1]:
            values = triplets(self._terms, narrow)[2]
            A.assemble()
            extra.add(A, values, free)
        A.assemble()

    def add_remainder(self, v: PETSc.Vec, f: PETSc.Vec, free: PETSc.Vec) -> None:
        """Add to f what the tangent gives along v beyond the last narrow one, where `free`."""
        more, along = np.zeros(f.local_size), v.array_r * free.array_r
        for term in self._narrowing:
            term.add_remainder(along, more)
        f.array[:] += more * free.array_r

    def _assemble(self, A, bcs):
        for form in self._tangents:
            fem_petsc.assemble_matrix(A, form, bcs=list(bcs))
            # not the end, after which places that no form has used yet are given up
            A.assemble(PETSc.Mat.AssemblyType.FLUSH)

    def _patterns(self):
        return [term.pattern for term in self._terms]


def _summed(parts):
    total: Counter[str | None] = Counter()
    for part in parts:
        total.update(part)
    return dict(total)


def _marked(form):
    """Which marked sides or cells a form is integrated over."""
    marked = {integral.integral_type(): integral.subdomain_data() for integral in form.integrals()}
    return sorted((kind, id(data)) for kind, data in marked.items() if data is not None)


def _call(name, A, *given):
    if code := getattr(PETSC, name)(ctypes.c_void_p(A.handle), *given):
        raise PETSc.Error(code)
