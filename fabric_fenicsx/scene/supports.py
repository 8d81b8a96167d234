"""Supports: nodes whose displacement is prescribed, their degrees of freedom and reactions."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from ..core.errors import InputError
from ..core.formatting import percent, rounded, share
from ..core.rules import FINITE
from ..energy.work import Work
from ..sheet.blank import Blank
from ..sheet.sheet_mesh import bounds
from ..surfaces.surfaces import checked_vector


@dataclass(frozen=True)
class Support:
    """Prescribed displacement of some nodes along the axes of the blank's frame.

    Parameters
    ----------
    name
        In messages, and for `Scene.reaction`.
    where
        Function of points (3, n) [mm] that returns a mask (n,).
    components
        Axes that are fixed: 0, 1 and, for a sheet in space, 2.
    value
        Displacement at full load (gdim,) [mm], which grows with the load factor, or a function of
        points (3, n) and load factor that returns (gdim, n). Raises InputError if it is neither.
    locates
        The support only prevents rigid motions of the sheet and should carry no force. It is
        dropped from a single sheet as soon as friction of tools holds it. Otherwise a run warns
        if such supports carry more than 0.5 % of all external nodal forces, summed by magnitude,
        and is not valid beyond `Limits.located`.

    Examples
    --------
    >>> ff.Support("left end", lambda x: x[0] < 1e-6, (0, 1)).value
    (0.0, 0.0, 0.0)
    """

    name: str
    where: Callable[[np.ndarray], np.ndarray]
    components: tuple[int, ...]
    value: Sequence[float] | Callable[[np.ndarray, float], np.ndarray] = (0.0, 0.0, 0.0)
    locates: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", tuple(map(int, self.components)))
        if not callable(self.value):
            name = f"value of support {self.name}"
            vector = checked_vector(name, self.value, size="two or three")
            object.__setattr__(self, "value", (*vector.tolist(), 0.0)[:3])

    def at(self, x: np.ndarray, load: float) -> np.ndarray:
        """Displacements (2 or 3, n) [mm] of points x (3, n) at a load factor."""
        if not callable(self.value):
            return load * np.outer(self.value, np.ones(x.shape[1]))
        return np.asarray(self.value(x, load), float)


# of a scene: supports, or a function that makes them for its blank
Supports = Iterable[Support] | Callable[[Blank], Iterable[Support]]


def clamped_ends(stroke: float = 0.0) -> Callable[[Blank], list[Support]]:
    """Supports of a strip that is clamped at both ends and pulled along its length: a function of a
    blank, for `Scene`. It raises InputError if an end is not straight over half the strip's width
    or more.

    Parameters
    ----------
    stroke
        Displacement of the "moving grip" along the frame's first axis [mm]; the "fixed grip" stays.

    Examples
    --------
    >>> [s.name for s in ff.clamped_ends(2.0)(ff.Blank.rectangle(40, 20, nx=4))]
    ['fixed grip', 'moving grip']
    """
    stroke = FINITE.check("`stroke`", stroke)
    return lambda blank: _ends(blank, stroke, tuple(range(blank.mesh.geometry.dim)))


def rolling_ends(stroke: float = 0.0) -> Callable[[Blank], list[Support]]:
    """Supports of a strip that is pulled at both ends, which are free to move across it.

    One corner is also fixed across. See `clamped_ends` for parameters, result and errors.

    Examples
    --------
    >>> [s.components for s in ff.rolling_ends(2.0)(ff.Blank.rectangle(40, 20, nx=4))]
    [(0,), (0,), (1,)]
    """
    stroke = FINITE.check("`stroke`", stroke)

    def supports(blank: Blank) -> list[Support]:
        low, high = blank.extent()
        near, corner = 1e-6 * (high - low).max(), low[:2, None]
        at_corner = lambda x: (np.abs(blank.along(x)[:2] - corner) <= near).all(0)  # noqa: E731
        ends = _ends(blank, stroke, (0, *range(2, len(low))))
        return [*ends, Support("corner", at_corner, (1,))]

    return supports


def _ends(blank, stroke, components):
    low, high = blank.extent()
    x, comm, near = blank.along(blank.coordinates().T), blank.mesh.comm, 1e-6 * (high - low).max()
    for name, position in (("low", low[0]), ("high", high[0])):
        first, last = bounds(comm, x[1:2, np.abs(x[0] - position) <= near])
        held = float((last - first)[0])
        if held < 0.5 * (high - low)[1]:
            raise InputError(
                f"the {name} end of {blank.name} along its length can be gripped over "
                f"{rounded(held, 4)} of {rounded((high - low)[1], 4)} mm; expected a straight "
                "end, half the width or more"
            )

    def end(position):
        return lambda x: np.abs(blank.along(x)[0] - position) <= near

    return [
        Support("fixed grip", end(low[0]), components),
        Support("moving grip", end(high[0]), components, (stroke, 0.0, 0.0)),
    ]


def on_edge(blank: Blank) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) that returns the mask (n,) of those on a rectangle's edge."""
    low, high = (corner[:2, None] for corner in blank.extent())
    near = 1e-6 * (high - low).max()

    def edge(x):
        x = blank.along(x)[:2]
        return (np.minimum(np.abs(x - low), np.abs(x - high)) <= near).any(0)

    return edge


def frame(deformation: Callable[[float], np.ndarray]) -> Callable[[Blank], list[Support]]:
    """Support "frame" of a rectangle's whole edge that deforms it homogeneously: a function of a
    blank, for `Scene`.

    Parameters
    ----------
    deformation
        Function of the load factor that returns the deformation gradient (2, 2).

    Examples
    --------
    >>> shear = ff.frame(lambda load: np.array([[1.0, 0.1 * load], [0.0, 1.0]]))
    >>> [support.name for support in shear(ff.Blank.rectangle(10, 10, nx=2))]
    ['frame']
    """

    def supports(blank: Blank) -> list[Support]:
        low = blank.extent()[0][:2, None]

        def value(x, load):
            x = blank.along(x)
            moved = np.zeros_like(x)
            moved[:2] = (deformation(load) - np.eye(2)) @ (x[:2] - low)
            return moved

        return [Support("frame", on_edge(blank), tuple(range(blank.mesh.geometry.dim)), value)]

    return supports


class FixedDofs:
    """Degrees of freedom of a `blank` that `supports` fix; iterating gives the supports.

    - dofs (fixed,): those that this rank owns and that are fixed now; dofs_of: of each support
      {name: (nodes, gdim)}, with free ones of its nodes
    - bcs: the same for DOLFINx
    - locates: True while supports fix some that only locate the sheet
    - work: of all supports

    Raises InputError for a support that holds no node, or components that the blank lacks.
    """

    def __init__(self, blank: Blank, supports: Iterable[Support]) -> None:
        self.blank, self._supports = blank, list(supports)
        self.work = Work(comm=blank.mesh.comm)
        self._gdim, x = blank.mesh.geometry.dim, blank.coordinates()
        self._owned = blank.V.dofmap.index_map.size_local
        self.dofs_of: dict[str, np.ndarray] = {}
        self._nodes: list[np.ndarray] = []
        for support in self:
            nodes = np.flatnonzero(support.where(x.T))
            owned, flaw = nodes[nodes < self._owned], ""
            if not set(support.components) <= set(range(self._gdim)):
                in_space = ", or 2 on a blank made with `spatial=True`" if self._gdim == 2 else ""
                allowed = f"expected those from 0 to {self._gdim - 1}{in_space}"
                flaw = f"the components {support.components} of {blank.name}; {allowed}"
            elif blank.mesh.comm.allreduce(len(owned)) == 0:
                flaw = f"no node of {blank.name}; expected 1 or more"
            if flaw:
                raise InputError(f"support {support.name} holds {flaw}")
            self._nodes.append(nodes)
            self.dofs_of[support.name] = owned[:, None] * self._gdim + np.arange(self._gdim)
        self.locates = any(support.locates for support in self)  # until `release_locating_supports`
        self._fix(self._supports)

    def __iter__(self) -> Iterator[Support]:
        return iter(self._supports)

    def _fix(self, supports):
        V, gdim = self.blank.V, self._gdim
        fixed = np.zeros(len(self.blank.coordinates()) * gdim, dtype=bool)
        for support, nodes in zip(self, self._nodes):
            if support in supports:
                fixed[nodes[:, None] * gdim + np.array(support.components, int)] = True
        dofs = np.flatnonzero(fixed).astype(np.int32)
        zero = PETSc.ScalarType(0)
        self.bcs = [fem.dirichletbc(zero, dofs[dofs % gdim == i], V.sub(i)) for i in range(gdim)]
        self.dofs = dofs[dofs < self._owned * gdim]

    def release_locating_supports(self) -> None:
        """Drop the supports that only locate the sheet."""
        before, self.locates = self.dofs, False
        self._fix([support for support in self if not support.locates])
        self.work.keep(np.isin(before, self.dofs))

    def values(self, load: float) -> np.ndarray:
        """Displacements of `dofs` at a load factor, along the frame's axes, (fixed,) [mm]."""
        x = self.blank.coordinates()
        values = np.zeros(len(x) * self._gdim)
        for support, nodes in zip(self, self._nodes):
            axes = np.array(support.components, dtype=int)
            values[nodes[:, None] * self._gdim + axes] = support.at(x[nodes].T, load)[axes].T
        return values[self.dofs]

    def reaction(self, name: str, forces: PETSc.Vec) -> np.ndarray:
        """Force of support `name` on the blank along the axes of the frame, (gdim,) [N]; forces:
        internal ones of all degrees of freedom. Raises InputError for an unknown name."""
        if name not in self.dofs_of:
            known = ", ".join(self.dofs_of)
            raise InputError(f"support {name!r} is not of this scene; expected {known}")
        return self.blank.mesh.comm.allreduce(forces.array[self.dofs_of[name]].sum(0), MPI.SUM)

    def memory(self) -> np.ndarray:
        """The memory of `work` at this rank's nodes, (owned nodes, k)."""
        states = self.work.memory()
        nodal = np.zeros((self._owned * self._gdim, len(states), 4))
        nodal[:, :, :2] = states[:, :2]
        if states.shape[1] > 2:
            nodal[self.dofs, :, 2:] = states[:, 2:].reshape(len(states), 2, -1).transpose(2, 0, 1)
        return nodal.reshape(self._owned, 4 * len(states) * self._gdim)

    def recall(self, memory: np.ndarray) -> None:
        """Restore the history from `memory`."""
        states = len(self.work.memory())
        nodal = memory.reshape(-1, states, 4)
        shared = nodal[:, :, :2].max(0, initial=0.0)
        self.blank.mesh.comm.Allreduce(MPI.IN_PLACE, shared, MPI.MAX)  # a rank may have no node
        fixed = nodal[self.dofs, :, 2:].transpose(1, 2, 0).reshape(states, -1)
        self.work.recall(np.hstack([shared, fixed]))

    def _located(self, sizes):
        return {s.name: sizes[s.name] for s in self if s.locates and self.locates}

    def located_share(self, sizes: dict[str, float]) -> float:
        """Share of all forces that supports bear which only locate; sizes: see `outer_forces`."""
        return share(sum(self._located(sizes).values()), sum(sizes.values()))

    def locating_warning(self, sizes: dict[str, float]) -> str:
        """A warning if supports that only locate bear a force, else ""; sizes: as before."""
        located, most = self._located(sizes), 0.005 * sum(sizes.values())
        forces = " and ".join(
            f"{k} {rounded(force)} N" for k, force in located.items() if force > most
        )
        return forces and (
            f"supports that should only locate the sheet carry {forces}, "
            f"{percent(self.located_share(sizes))} of all forces, because sheet, yarns or tools "
            "are not symmetric: the formed shape depends on them; use friction of a blank holder "
            "or of tools instead"
        )
