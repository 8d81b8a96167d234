"""The place where a blank holder acts: the die's flange, and parts of the blank."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from ..contact.coulomb import Coulomb
from ..contact.sheet_contact import SheetContact
from ..contact.tool_contact import Contact
from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.rules import FINITE, repr_short, unknown_key
from ..energy.nodes import values_at
from ..material.files import Interval
from ..sheet.blank import Blank
from ..surfaces.surfaces import checked_vector
from ..surfaces.tool import Tool
from . import stack
from .interface import Interface
from .laying import Laid

Where = Callable[[np.ndarray], np.ndarray]  # function of points (3, n) [mm] to a mask (n,)
# edge of a rectangle around the blank -> axis, and which end of it
EDGES = {"low x": (0, 0), "high x": (0, 1), "low y": (1, 0), "high y": (1, 1)}


@dataclass(frozen=True)
class Region:
    """Function of points (3, n) [mm] to a mask (n,), True where they lie within all `limits`.

    limits: {name: (low, high)} of x, y [mm], and of r [mm] and angle (to x) [deg], polar
    coordinates about the point `at` (x, y), by default the blank's centroid when a holder is built.
    Raises InputError for others.
    """

    limits: Mapping[str, Sequence[float]]

    def __post_init__(self) -> None:
        if not isinstance(self.limits, Mapping) or not self.limits:
            raise InputError(
                f"`where` is {repr_short(self.limits)}; allowed is a table, as x = [0, 50]"
            )
        for name, ends in self.limits.items():
            if name == "at":
                checked_vector("`where`.at", ends, size="two")
            elif name in ("x", "y", "r", "angle"):
                Interval(FINITE).check(f"`where`.{name}", ends)
            else:
                raise unknown_key(name, ("x", "y", "r", "angle", "at"), f"`where`.{name}")

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The mask (n,)."""
        rounding = 1e-6  # mm or deg, by which a node may lie beyond a limit
        arm = x[:2] - np.reshape(self.limits.get("at", (0.0, 0.0)), (2, 1))
        angle = np.degrees(np.arctan2(arm[1], arm[0]))
        values = {"x": x[0], "y": x[1], "r": np.hypot(*arm), "angle": angle}
        inside = np.ones(x.shape[1], dtype=bool)
        for name in values.keys() & self.limits.keys():
            low, high = self.limits[name]
            over = values[name] - low + rounding
            over = over % 360 if name == "angle" else over
            inside &= (over >= 0) & (over <= high - low + 2 * rounding)
        return inside

    def about(self, centre: np.ndarray) -> Region:
        """The region with `at` (2,) [mm] unless it has its own."""
        return Region({"at": centre.tolist()} | dict(self.limits))


class Flange:
    """Function of places (3, n) to the share (n,) to which each lies on the die's flange: 1 where
    the die is flat, 0 beyond, and less than 1 where its radius begins; it depends only on x and y.

    Where a lattice over the `extent` of the blank, two corners, is flat everywhere or nowhere about
    a place, so is the place: smaller parts of the flange may be missed. thickness: of all that lies
    between die and holder [mm]; up: 1 for a die above the blank, -1 below it.
    """

    spacing = 2.0  # mm, of the lattice that tells where the die need not be asked
    beyond = 2  # points of it beyond a place's square, as the end may be curved
    # height over the thickness, and 1 less the normal's part along z: up to the first a face is
    # flat, from the second on it is not
    limits = 1e-3, 1e-2

    def __init__(self, die: Tool, thickness: float, up: float, extent: ArrayLike) -> None:
        self.die, self.thickness, self.up = die, thickness, up
        low, high = np.asarray(extent)[:, :2] / self.spacing
        self._first = np.floor(low).astype(int) - self.beyond  # of the lattice along x and y
        self._last = np.ceil(high).astype(int) + self.beyond
        self._seen = np.full(3, np.nan)  # where the die was

    def _follow_die(self):
        if np.array_equal(self.die.displacement, self._seen):
            return
        self._seen = self.die.displacement
        axes = (np.arange(first, last + 1) for first, last in zip(self._first, self._last))
        lattice = self.spacing * np.stack(np.meshgrid(*axes, indexing="ij"), -1)
        flat = self._flat(lattice.reshape(-1, 2)).reshape(lattice.shape[:2])
        least, most = (
            extreme(flat, 2 * self.beyond + 2, origin=-1)
            for extreme in (ndimage.minimum_filter, ndimage.maximum_filter)
        )
        uniform = most == 0, least == 1
        # how many squares before each have share 0 everywhere, and 1
        self._counts = [np.pad(u.cumsum(0).cumsum(1), ((1, 0), (1, 0))) for u in uniform]

    def over(self, x: np.ndarray) -> np.ndarray:
        """The share (n,) of each figure with corners x (n, k, 2 or 3) [mm] that is 0 or 1 all over
        it; nan where it may differ, and has to be asked for at places."""
        self._follow_die()
        low, high = (np.floor(ends[:, :2] / self.spacing) for ends in (x.min(1), x.max(1)))
        known = ((low >= self._first) & (high <= self._last)).all(1)
        (a, b), (c, d) = (
            (np.where(known[:, None], end - self._first, 0).astype(int) + n).T
            for n, end in enumerate((low, high))
        )
        squares, share = (c - a) * (d - b), np.full(len(x), np.nan)
        for value, sums in enumerate(self._counts):
            share[known & (sums[c, d] - sums[a, d] - sums[c, b] + sums[a, b] == squares)] = value
        return share

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The share (n,) of places x (3, n) [mm]."""
        finite = np.isfinite(x[:2]).all(0)
        places = np.where(finite, x[:2], 0.0).T
        share = self.over(places[:, None])
        near = np.isnan(share)
        share[near] = self._flat(places[near])
        return np.where(finite, share, 0.0)

    def _flat(self, points):
        """The share (n,) of points (n, 2)."""
        t, at = self.thickness, np.column_stack([points, np.zeros(len(points))])
        gap, normal, _ = self.die.evaluate(at, reach=t)
        off = np.fmax(abs(gap - t / 2) / t, 1 + self.up * normal[:, 2])
        flat, not_flat = self.limits
        return np.clip((not_flat - off) / (not_flat - flat), 0, 1)


@dataclass(frozen=True, kw_only=True)
class HolderSite:
    """The place where a blank holder acts: what it needs to make its terms.

    Parameters
    ----------
    name
        A name for the holder's tool.
    laid, planes, share
        The blank as it is laid, the axes across which planes of symmetry halve it, and the share of
        it that is modelled.
    die, up, thickness
        The tool on which the holder presses the blank, the direction (3,) towards it, and the
        thickness of all between them [mm].
    interface, friction, against
        How tools touch the blank, their friction; of a stack the contacts of its sheets.
    taken
        By holders before this one: {place: {name of a holder: where it acts there}}.

    Examples
    --------
    >>> class Cushion:
    ...     def terms(self, site):
    ...         return [ff.BlankHolderPressure(0.1, site.up, site.on_flange(), lag=site.lag)]
    >>> press = ff.Press.read("hemisphere").replace(holders={"rim": Cushion()})
    >>> [*press.holders]
    ['rim']
    """

    name: str
    laid: Laid
    planes: Mapping[int, float]
    share: float
    die: Tool
    up: np.ndarray
    thickness: float
    interface: Interface
    friction: Coulomb
    against: Sequence[SheetContact] = ()
    taken: dict[str, dict[str, Where]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @property
    def path(self) -> str:
        """Of the holder, in messages."""
        return f"holders.{self.name}"

    @property
    def blank(self) -> Blank:
        """The flat blank, in z = 0."""
        return self.laid.blank

    @property
    def centre(self) -> np.ndarray:
        """The whole blank's centroid (2,) [mm]."""
        return self.laid.centre

    @property
    def lag(self) -> float:
        """Share of areas and normal forces, by which these may lag behind the state."""
        return self.interface.lag

    @property
    def sheets(self) -> list[str]:
        """Names of the sheets of a stack, the lowest first."""
        return [sheet.name for sheet in self.laid.sheets] if self.laid.stack else []

    @property
    def rims(self) -> list[str]:
        """Names of the sheets of a stack that reach beyond all sheets below them."""
        return stack.rims(self.laid)

    def warn(self, *sentences: str) -> None:
        """Add these sentences to the warnings of the run."""
        self.warnings.extend(sentences)

    def contact(self, tool: Tool, where: Where | None = None) -> Contact:
        """Contact with a tool of the holder, as that with the die; where: as in `Contact`."""
        penalty = self.interface.penalty
        return Contact(tool, penalty=penalty, friction=self.friction, where=where)

    def on_flange(self) -> Flange:
        """Function of positions (3, n) to the share (n,) of each that is on the die's flange."""
        return Flange(self.die, self.thickness, self.up[2], self.blank.extent())

    def edges(self, names: Sequence[str]) -> Iterator[tuple[str, np.ndarray, Where]]:
        """The modelled ones of the edges: name, direction outwards (3,), and mask of points."""
        for name in names:
            axis, end = EDGES[name]
            if end or axis not in self.planes:
                place = self.blank.extent()[end][axis]
                mask = partial(lambda axis, place, x: abs(x[axis] - place) < 1e-6, axis, place)
                yield name, (2 * end - 1) * np.eye(3)[axis], mask

    def loose_ends(self) -> list[str]:
        """A sentence on each end of the smallest sheet, on the axes through the blank's centre,
        that lies over the die's opening, where no blank holder presses it."""
        extents = np.array([blank.extent() for blank in self.laid.blanks])
        doubts, flange = list[str](), self.on_flange()
        reach = np.arange(200)  # mm, within which the flange is looked for
        for _, outwards, _ in self.edges(list(EDGES)):
            axis = int(abs(outwards).argmax())
            end = (extents @ outwards).max(1).min() * outwards[axis]
            x = np.outer([*self.centre, 0.0], np.ones(len(reach)))
            x[axis] = end + outwards[axis] * reach
            if not (share := flange(x))[0]:
                away = f"{(share > 0).argmax()} mm" if share.any() else f"more than {len(reach)} mm"
                doubts.append(
                    f"the smallest sheet ends over the die's opening at {'xy'[axis]} = "
                    f"{rounded(end, 4)} mm, {away} from the flange: the blank holder does not press"
                    " it there"
                )
        return doubts

    def gripped(self, name: str, edge: Where, where: Where | None) -> Where | None:
        """Where this holder acts on an edge; None if at most a corner is marked."""
        x, mask = self.laid.flat_nodes().T, self._checked(where)
        nodes, grips = np.ones(x.shape[1]), lambda x: edge(x) & mask(x)
        if self._sum(nodes, x, grips) <= 1:
            return None
        self._take(name, grips, x, nodes, 1, f"nodes of the edge {name}")
        return grips

    def pressed(self, where: Where | None) -> Where | None:
        """Function of points (3, n) to a mask (n,) of what this holder presses on the die's face
        and none before it does, None for all of it: a node at the common limit of two segments is
        the first one's. Raises InputError where they overlap by more than that."""
        blank, mask, face = self.laid.blanks[0], self._checked(where), f"face of {self.die.name}"
        x = blank.midpoints()
        areas = np.where(self.on_flange()(x) > 0, blank.areas() / self.share, 0.0)
        others = self._take(face, mask, x, areas, 0, "mm2 of the blank")
        if where is None and not others:
            return None
        return lambda x: np.all([mask(x), *(~other(x) for other in others)], axis=0)

    def _checked(self, where):
        """`where` of a holder, None for everywhere, as a function that checks each mask."""
        if where is None:
            return lambda x: np.ones(x.shape[1], dtype=bool)
        given = where.about(self.centre) if isinstance(where, Region) else where
        x = self.laid.flat_nodes().T
        if not self._sum(np.ones(x.shape[1]), x, lambda x: values_at(given, x)):
            raise InputError(f"`where` of {self.path} marks no node; allowed is a mask of some")
        return lambda x: values_at(given, x)

    def _sum(self, weights, x, *masks):
        """Of all ranks, of the weights where all masks are true."""
        own = weights[np.all([mask(x) for mask in masks], axis=0)].sum()
        return self.blank.mesh.comm.allreduce(float(own))

    def _take(self, place, mask, x, weights, most, unit):
        """Note that the holder acts on a `place` where a mask is true; the masks of the holders
        before it there. Raises InputError where two overlap by more than `most`, as a sum of
        weights at x."""
        earlier = self.taken.setdefault(place, {})
        others = list(earlier.values())
        for name, other in earlier.items():
            if (shared := self._sum(weights, x, mask, other)) > most:
                raise InputError(
                    f"holders.{name} and {self.path} overlap on {rounded(shared, 4)} {unit}, "
                    "where both would act; allowed are segments beside each other (`where`)"
                )
        earlier[self.name] = mask
        return others
