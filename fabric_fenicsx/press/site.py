"""What a blank holder gets to make its terms: the die's flange, and where it may act on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from ..contact.coulomb import Coulomb
from ..contact.tool_contact import Contact
from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.rules import FINITE, repr_short, unknown_key
from ..energy.nodes import values_at
from ..material.files import Interval
from ..sheet.blank import Blank
from ..surfaces.surfaces import checked_vector
from ..surfaces.tool import Tool
from .interface import Interface
from .laying import Laid

Where = Callable[[np.ndarray], np.ndarray]  # function of points (3, n) [mm] to a mask (n,)


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
                f"`where` is {repr_short(self.limits)}; expected a table, as x = [0, 50]"
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

    SPACING = 2.0  # mm, of the lattice
    BEYOND = 2  # points of it beyond a place's square, as the end may be curved
    # height over the thickness, and 1 less the normal's part along z: up to the first a face is
    # flat, from the second on it is not
    LIMITS = 1e-3, 1e-2

    def __init__(self, die: Tool, thickness: float, up: float, extent: ArrayLike) -> None:
        self.die, self.thickness, self.up = die, thickness, up
        low, high = np.asarray(extent)[:, :2] / self.SPACING
        self._first, self._last = np.floor(low) - self.BEYOND, np.ceil(high) + self.BEYOND
        self._seen = np.full(3, np.nan)  # where the die was

    def over(self, x: np.ndarray) -> np.ndarray:
        """The share (n,) of each figure with corners x (n, k, 2 or 3) [mm] that is 0 or 1 all over
        it; nan where it may differ, and has to be asked for at places."""
        if not np.array_equal(self.die.displacement, self._seen):
            self._seen, ends = self.die.displacement, zip(self._first, self._last + 1)
            points = np.stack(np.meshgrid(*(np.arange(*each) for each in ends), indexing="ij"), -1)
            flat = self._flat(self.SPACING * points.reshape(-1, 2)).reshape(points.shape[:2])
            # how many points away the nearest one is that has another share than 0, and than 1
            alike = (np.pad(flat == value, 1) for value in (0, 1))
            self._away = [ndimage.distance_transform_cdt(each, "chessboard") for each in alike]
        low, high = (ends[:, :2] / self.SPACING for ends in (x.min(1), x.max(1)))
        middle, needed = (low + high) / 2 - self._first + 1, (high - low).max(1) / 2 + 2
        share = np.full(len(x), np.nan)
        for value, away in enumerate(self._away):
            near = ndimage.map_coordinates(away, middle.T, order=0)  # 0 beyond the lattice
            share[near > needed + self.BEYOND] = value
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
        flat, not_flat = self.LIMITS
        return np.clip((not_flat - off) / (not_flat - flat), 0, 1)


@dataclass(frozen=True, kw_only=True)
class HolderSite:
    """Information that a blank holder gets to create its terms.

    - name, die, up, thickness: its name, the tool on which it presses the blank, the direction (3,)
      towards that, and the thickness of all between them [mm]
    - laid, blank, centre, planes, share: the blank as it is laid, flat in z = 0, the whole one's
      centroid (2,) [mm], axes across which planes of symmetry halve it, the share that is modelled
    - interface, friction, lag: how tools touch the blank, their friction, and the share of areas
      and normal forces by which these may lag behind the state
    - taken: by holders before this one, {place: {name of a holder: where it acts there}}

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
    die: Tool
    up: np.ndarray
    thickness: float
    laid: Laid
    blank: Blank
    centre: np.ndarray
    planes: Mapping[int, float]
    share: float
    interface: Interface
    friction: Coulomb
    lag: float
    taken: dict[str, dict[str, Where]]
    warnings: list[str] = field(default_factory=list)

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

    def mask(self, where: Where | None) -> Where:
        """`where` of the holder, None for everywhere, as a function that returns a mask. Raises
        InputError if it marks no node."""
        given = where.about(self.centre) if isinstance(where, Region) else where
        mask = partial(values_at, given or (lambda x: np.ones(x.shape[1])))
        x = self.laid.flat_nodes().T
        if not self.total(np.ones(x.shape[1]), mask(x)):
            raise InputError(
                f"`where` of holders.{self.name} selects no node; expected a mask that does"
            )
        return mask

    def total(self, weights: np.ndarray, *masks: np.ndarray) -> float:
        """Sum of all ranks' weights (n,) where all masks (n,) are true."""
        local = weights[np.all(masks, axis=0)].sum()
        return self.blank.mesh.comm.allreduce(float(local))

    def take(
        self, place: str, mask: Where, x: np.ndarray, weights: np.ndarray, unit: str, most: int = 0
    ) -> list[Where]:
        """Note that the holder acts on a `place` where a mask is true; the masks of the holders
        before it there. Raises InputError where two overlap by more than `most`, as a sum of
        weights (n,) at x (3, n)."""
        earlier = self.taken.setdefault(place, {})
        others = [*earlier.values()]
        for name, other in earlier.items():
            if (shared := self.total(weights, mask(x), other(x))) > most:
                both = f"holders.{name} and holders.{self.name}"
                raise InputError(
                    f"{both} overlap on {rounded(shared, 4)} {unit}; expected "
                    "segments beside each other (`where`)"
                )
        earlier[self.name] = mask
        return others
