"""The decoupled baseline as users of Abaqus' FABRIC know it: tabulated nominal curves for warp, weft and shear."""

import csv
import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

import numpy as np
import tomli_w
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator
from ufl import conditional, lt
from ufl.core.expr import Expr

from ..errors import InputError
from .parameters import SHEET, WovenFabric, check_complete, check_couplings, check_number, read_sheet_numbers

MIN_POINTS = 3
MAX_POINTS = 40  # in a file: compiling the form takes the square of their number, half a minute at 100
_STRESS = {"MPa": 1.0, "kPa": 1e-3, "Pa": 1e-6, "GPa": 1e3}
_COLUMNS = {
    "yarn": (("eps", {"-": 1.0, "%": 0.01}), ("sigma", _STRESS)),
    "shear": (("gamma", {"rad": 1.0, "deg": math.pi / 180}), ("tau", _STRESS)),
}


@dataclass(frozen=True)
class Curve:
    """Nominal stress [MPa] over strain [- or rad] through tabulated points; x, y: tuples of n >= 3 numbers, x rising.

    Between the points a monotone cubic (Fritsch and Carlson 1980, SciPy's PCHIP): where the data rise so does the
    curve, its slope is continuous, so the energy is C2. Beyond the first and last point it goes on straight.
    Energy is counted from zero strain, where the curve must be free of stress.
    Raises InputError, which names the point, for other points than these.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]
    _c: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        x, y = np.asarray(self.x, float), np.asarray(self.y, float)
        for k in range(len(x)):
            if not (math.isfinite(x[k]) and math.isfinite(y[k])):
                raise InputError(f"point {k + 1} is ({x[k]}, {y[k]}), but it must be finite numbers")
            if k and x[k] <= x[k - 1]:
                raise InputError(
                    f"point {k + 1}: {x[k]:.6g} comes after {x[k - 1]:.6g}, but strains must rise strictly"
                )
        if len(x) < MIN_POINTS:
            raise InputError(f"the curve has {len(x)} points; at least {MIN_POINTS} are needed")
        zero = np.flatnonzero(x == 0)
        if len(zero) != 1 or y[zero[0]] != 0:
            raise InputError("the curve has no point (0, 0); it must be free of stress at zero strain")
        inner = PchipInterpolator(x, y)
        left, right = inner.derivative()(x[[0, -1]])
        # one polynomial a piece in its own t, highest power first: [left tail, pieces.., right tail]
        c = np.column_stack([[0, 0, left, y[0]], inner.c, [0, 0, right, y[-1]]])
        object.__setattr__(self, "_c", c)

    @property
    def starts(self) -> np.ndarray:
        """Where each piece's t is zero, (n + 1,): the first point for the tail before it, then each point."""
        return np.concatenate([self.x[:1], self.x])

    def _pieces(self) -> np.ndarray:
        """Coefficients of the energy (5, n + 1) in t, highest power first, continuous, zero at zero strain."""
        starts, c = self.starts, self._c
        W = np.vstack([c / np.array([4.0, 3.0, 2.0, 1.0])[:, None], np.zeros(c.shape[1])])
        for k in range(2, c.shape[1]):
            W[4, k] = np.polyval(W[:, k - 1], starts[k] - starts[k - 1])
        W[4] -= np.polyval(W[:, self._piece(0.0)], 0.0 - starts[self._piece(0.0)])
        return W

    def _piece(self, e: ArrayLike) -> np.ndarray:
        return np.searchsorted(self.x, e, side="right")

    def __call__(self, e: ArrayLike) -> np.ndarray:
        """Stress [MPa] at strains `e`, of their shape."""
        return self.derivatives(e)[1]

    def derivatives(self, e: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy, stress and tangent [MPa] at strains `e`, each of their shape."""
        e = np.asarray(e, float)
        k, W = self._piece(e), self._pieces()
        t = e - self.starts[k]
        w4, w3, w2, w1, w0 = W[:, k]
        energy = (((w4 * t + w3) * t + w2) * t + w1) * t + w0
        return energy, ((4 * w4 * t + 3 * w3) * t + 2 * w2) * t + w1, (12 * w4 * t + 6 * w3) * t + 2 * w2

    def symbols(self, make: Callable[[float], Any]) -> Callable[[Expr], Expr]:
        """The energy [MPa] as a function of a UFL strain, its numbers v replaced by make(v)."""
        columns = [[make(v) for v in column] for column in (self.starts, *self._pieces())]

        def energy(e):
            def pick(
                values,
            ):  # constants alone, so that their choice is not differentiated; halved, to nest log2(n) deep
                if len(values) == 1:
                    return values[0][1]
                upper = values[len(values) // 2 :]
                return conditional(lt(e, upper[0][0]), pick(values[: len(values) // 2]), pick(upper))

            start, w4, w3, w2, w1, w0 = (pick(list(zip(columns[0], column))) for column in columns)
            t = e - start
            return (((w4 * t + w3) * t + w2) * t + w1) * t + w0

        return energy


@dataclass(frozen=True)
class TabulatedFabric:
    """FABRIC from tables: curves of warp and weft over nominal strain, of shear over the shear angle (both senses
    mirror images, so that its table begins at 0), thickness [mm], density [g/cm3].

    It takes the place of a `WovenFabric` with every coupling off, in the forms and in the kernel.
    Raises InputError for a shear table that begins below 0, and for a thickness or density not above 0.
    """

    warp: Curve
    weft: Curve
    shear: Curve
    thickness: float = 1.0
    density: float = 0.75
    name: str = ""
    couplings = frozenset[str]()
    biaxial = tension_shear = compression_shear = False

    def __post_init__(self) -> None:
        for key in SHEET:
            object.__setattr__(self, key, check_number(key, getattr(self, key), key))
        if self.shear.x[0] < 0:
            raise InputError(
                f"shear begins at {self.shear.x[0]:.6g}, but it must begin at 0; the other sense is its mirror image"
            )

    @property
    def curves(self) -> tuple[Curve, Curve, Curve]:
        """Curves of eps_a, eps_b and gamma, the last in both senses."""
        x, y = np.array(self.shear.x), np.array(self.shear.y)
        both = Curve(tuple(np.concatenate([-x[:0:-1], x])), tuple(np.concatenate([-y[:0:-1], y])))
        return self.warp, self.weft, both

    @property
    def s1(self) -> float:
        """Shear stiffness at rest [MPa]."""
        return float(self.curves[2].derivatives(0.0)[2])

    def decoupled(self) -> Self:
        """Itself: there is no coupling to turn off."""
        return self

    def without(self, *names: str) -> Self:
        """Itself; InputError for an unknown name."""
        check_couplings(names, "without")
        return self

    def symbols(self, make: Callable[[float], Any]) -> SimpleNamespace:
        """What the energy needs, each number v replaced by make(v)."""
        return SimpleNamespace(curves=[curve.symbols(make) for curve in self.curves], thickness=make(self.thickness))

    def dumps(self) -> str:
        """All of it as a TOML text."""
        tables = {
            key: {"x": list(c.x), "y": list(c.y)}
            for key, c in (("warp", self.warp), ("weft", self.weft), ("shear", self.shear))
        }
        return tomli_w.dumps(
            {"model": "fabric", "name": self.name, "thickness": self.thickness, "density": self.density, **tables}
        )

    @classmethod
    def from_toml(cls, path: str | os.PathLike[str], document: dict[str, Any]) -> Self:
        """Read a material file with `model = "fabric"`; `document` is its parsed TOML.

        Top level: name, thickness, density as in any material file, and `warp`, `weft`, `shear`: CSV files beside it
        with the headers `eps [%], sigma [MPa]` and `gamma [deg], tau [MPa]`. Raises InputError by file and row.
        """
        files = {key: document.pop(key, None) for key in ("warp", "weft", "shear")}
        fields: dict[str, Any] = {"name": document.pop("name", "")}
        document.pop("model")
        units = document.pop("units", {})
        fields |= (numbers := read_sheet_numbers(document, units, ("model", "name", *files))[0])
        check_complete(numbers, SHEET, "", "at the top of the file")
        for key, name in files.items():
            if not isinstance(name, str):
                raise InputError(f"{key} is {name!r}, but it must be the name of a CSV file beside this one")
            fields[key] = read_table(Path(path).parent / name, "shear" if key == "shear" else "yarn")
        return cls(**fields)


Fabric = WovenFabric | TabulatedFabric


def read_table(path: str | os.PathLike[str], kind: str) -> Curve:
    """Curve from a CSV file with a header of names and units; kind: "yarn" or "shear". InputError by file and row."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = [
                (n, row) for n, row in enumerate(csv.reader(file), 1) if row and not row[0].lstrip().startswith("#")
            ]
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    columns = _COLUMNS[kind]
    wanted = ", ".join(f"{name} [{'|'.join(units)}]" for name, units in columns)
    if not rows or len(rows[0][1]) != 2:
        raise InputError(f"{path}: row {rows[0][0] if rows else 1} is no header of two columns; allowed is {wanted}")
    factors = []
    for cell, (name, units) in zip(rows[0][1], columns):
        match = re.fullmatch(r"\s*(\w+)\s*\[(.*)\]\s*", cell)
        if not match or match[1] != name or match[2] not in units:
            raise InputError(f"{path}: row {rows[0][0]} has the column {cell.strip()!r}; allowed is {wanted}")
        factors.append(units[match[2]])
    points = []
    for number, row in rows[1:]:
        try:
            points.append([float(cell) * factor for cell, factor in zip(row, factors, strict=True)])
        except ValueError:
            raise InputError(f"{path}: row {number} is {','.join(row)!r}; allowed are two numbers") from None
    if len(points) > MAX_POINTS:
        raise InputError(f"{path}: has {len(points)} points; allowed are {MIN_POINTS} to {MAX_POINTS}, so thin it out")
    try:
        return Curve(*(tuple(column) for column in zip(*points))) if points else Curve((), ())
    except InputError as error:
        message = str(error)
        if match := re.match(r"point (\d+)", message):
            message = message.replace(match[0], f"row {rows[int(match[1])][0]}", 1)
        raise InputError(f"{path}: {message}") from None
