"""Fields: numbers that depend on the place, by a function or by points in a file."""

import hashlib
import os
from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..core.errors import InputError
from ..core.files import check_file, ending
from ..core.formatting import coordinates, rounded
from ..core.rules import FINITE, Rule, unknown_key
from .text_tables import columns_of, read_lines, table_of

ALLOWED = "a CSV with columns x, y and one more, or a mesh with values at its points"
Function = Callable[..., np.ndarray | float]  # of arrays x, y and perhaps z (n,) [mm]


class Field:
    """A number that varies in space, for options that accept one.

    Between points in a file the number is interpolated linearly, on triangles or tetrahedra between
    them; outside it is that of the nearest point, up to the extent of the points. Angles are
    interpolated as numbers, so write 190 after 170 deg, not -170. Raises InputError for a file
    without such points, and for points that span no area, or have several values at one
    values.

    Parameters
    ----------
    source : function or file name
        A function of x and y of the flat sheet, for friction with tools of x, y and z; of arrays
        (n,) [mm], to the values (n,). Or a CSV with columns x, y, if wanted z, and values; or a
        mesh with values at its points, as .vtu.
    name : str
        Of the values, if the file has several.

    Examples
    --------
    >>> rim = ff.Field(lambda x, y: np.where(abs(x) > 40, 20.0, 180.0))
    >>> rim.at(np.array([[0.0, 0.0, 0.0], [45.0, 0.0, 0.0]])).tolist()
    [180.0, 20.0]
    """

    def __init__(self, source: Function | str | os.PathLike[str], name: str = "") -> None:
        self.source, self.name = source, name
        self.label, self.rule, self.axes = "the field", FINITE, "xy"
        self._places, self._values = np.empty((2, 0))
        if not callable(source):
            from scipy.interpolate import LinearNDInterpolator  # take long to import
            from scipy.spatial import QhullError, cKDTree

            try:
                self._places, self._values = _read(Path(source), name)
                self._between = LinearNDInterpolator(self._places, self._values)
            except (QhullError, ValueError) as error:  # of the file or of what is in it
                flat = f"its {len(self._values)} points span no area, or with z no volume"
                flaw = error if isinstance(error, ValueError) else flat
                raise InputError(f"{source}: {flaw}") from None
            self._nearest = cKDTree(self._places)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Field):
            return NotImplemented
        return (self.content or self.source) == (other.content or other.source)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Field({self.source!r})"

    def of(self, label: str, rule: Rule, axes: str) -> Self:
        """The same for an option: what messages call it, the rule of its values and its axes.
        Raises InputError for points that have no place or value for it."""
        new = copy(self)
        new.label, new.rule, new.axes = label, rule, axes
        if len(self._values):
            if self._places.shape[1] > len(axes):
                flaw = "whose points have different z; expected x and y of the flat sheet"
                raise InputError(f"{label} is {self.source}, {flaw}")
            new._check(self._values, self._places)
        return new

    def at(self, x: np.ndarray) -> np.ndarray:
        """Values (n,) at places x (n, 3) [mm]. Raises InputError where there are none."""
        if callable(self.source):
            axes = ", ".join(self.axes)
            try:
                values = np.asarray(self.source(*x.T[: len(self.axes)]), float)
                values = np.broadcast_to(values, len(x)).copy()
            except Exception as error:  # a user's function raises whatever it does
                raise InputError(
                    f"{self.label} as a function of {axes} fails ({type(error).__name__}: {error});"
                    f" expected one of arrays, as lambda {axes}: np.where(x > 0, 1.0, 2.0)"
                ) from None
            self._check(values, x)
            return values
        places = x[:, : self._places.shape[1]]
        values = self._between(places)
        out = np.isnan(values)
        distance, nearest = self._nearest.query(places[out])
        if (distance > np.ptp(self._places, axis=0).max()).any():
            k = distance.argmax()
            raise InputError(
                f"{self.label}: {self.source} has no point within {rounded(distance[k])} mm of "
                f"{coordinates(places[out][k])} mm; expected points where the sheet lies"
            )
        values[out] = self._values[nearest]
        return values

    @property
    def content(self) -> str:
        """What tells files with other points apart, "" of a function."""
        if callable(self.source):
            return ""
        data = self._places.tobytes() + self._values.tobytes()
        return hashlib.sha256(data).hexdigest()[:16]

    @property
    def entry(self) -> Function | str | dict[str, str]:
        """As a press's file says it; a function as it is."""
        if self.name:
            return {"file": str(self.source), "field": self.name}
        return self.source if callable(self.source) else str(self.source)

    def in_words(self, low: float, high: float) -> str:
        """The least and the largest value, and where they are from, for people."""
        ends = dict.fromkeys((rounded(low, 4), rounded(high, 4)))
        source = "a function" if callable(self.source) else Path(self.source).name
        return f"{' to '.join(ends)} ({source})"

    def _check(self, values, places):
        for k in {int(np.argmin(values)), int(np.argmax(values))} if len(values) else ():
            where = f"{self.label} at {coordinates(places[k])} mm"
            self.rule.check(where, float(values[k]))


@dataclass(frozen=True)
class OfPlace(Rule):
    """A rule for a number that may be a `Field` of these axes, too, or what makes one. numbers: the
    rule of its values."""

    numbers: Rule = FINITE
    axes: str = "xy"

    def check(self, name: str, value: object) -> Any:
        """As of `Rule`: a number, or the `Field`."""
        if callable(value) or isinstance(value, (str, os.PathLike)):
            value = Field(value)
        if isinstance(value, Field):
            return value.of(name, self.numbers, self.axes)
        return super().check(name, value)


def of_place(rule: Rule, axes: str = "xy") -> OfPlace:
    """The rule for a number that `rule` allows, or for a field of such."""
    words = f"{rule.allowed}, a function of {', '.join(axes)}, or a file of points"
    return OfPlace(**vars(rule) | {"allowed": words}, numbers=rule, axes=axes)


def from_entry(value: object, path: str, found: Callable[[object, str], str]) -> object:
    """The field of an option that is a file's name or a table with one; another value as it is.
    found: function of a file's name, and what messages call it, to its path."""
    if not isinstance(value, Mapping):
        return Field(found(value, path)) if isinstance(value, str) else value
    for key in value:
        if key not in ("file", "field"):
            raise unknown_key(key, ("file", "field"), f"{path}.{key}")
    return Field(found(value.get("file"), f"{path}.file"), str(value.get("field", "")))


def _read(path, name):
    """Places (n, 2 or 3) [mm] and values (n,) of the points in a file, each place once. Raises
    ValueError with the reason."""
    check_file(path, "file", ALLOWED)
    is_table = ending(path) in (".csv", ".txt", ".dat")
    if is_table:
        table, kind = table_of(read_lines(path), ("x", "y", "z").__contains__), "columns"
        names = [each for each in table.names if each not in ("x", "y", "z")]
    else:
        import meshio

        try:
            mesh, kind = meshio.read(path), "fields at points"
        except (Exception, SystemExit) as error:  # meshio raises whatever its parsing stumbles on
            raise ValueError(f"can't be read ({error}); expected {ALLOWED}") from None
        fields = {k: np.asarray(v, float) for k, v in mesh.point_data.items() if np.ndim(v) == 1}
        names = list(fields)
    one = name or (names[0] if len(names) == 1 else "")
    if one not in names:
        found = f"has the {kind} {', '.join(names) or 'x, y alone'}{name and f', not {name!r}'}"
        raise ValueError(f"{found}; expected one, or one of them that `field` names")
    if is_table:
        units = dict.fromkeys(("x", "y", "z"), {None: 1.0, "mm": 1.0})
        units[one] = dict.fromkeys((None, "deg", "mm", "deg C", "C", "-"), 1.0)
        columns = columns_of(table, units, ("z",))
        values = columns.pop(one)
        places = np.stack([*columns.values()], 1)
    else:
        values, places = fields[one], np.asarray(mesh.points, float)
    once, first, which = np.unique(places.round(9), axis=0, return_index=True, return_inverse=True)
    others = values[first][which.ravel()]
    for k in np.flatnonzero(abs(values - others) > 1e-9 * np.maximum(abs(values), 1.0))[:1]:
        both = f"{rounded(others[k], 4)} and {rounded(values[k], 4)}"
        raise ValueError(f"at {coordinates(places[k])} mm there are the values {both}")
    is_flat = once.shape[1] == 3 and np.ptp(once[:, 2]) < 1e-9
    return once[:, :2] if is_flat else once, values[first]
