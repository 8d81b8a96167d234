"""The decoupled baseline as users of Abaqus' FABRIC know it: tables for warp, weft and shear."""

import dataclasses
import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from ...readers.text_tables import Problems, read_lines, rows_of, table_of, values_of
from ...readers.units import ANGLE, STRAIN, factors
from ...runtime.errors import InputError
from ...runtime.rules import shown
from ..files import take_units
from ..functions import where
from ..parameters import Parameters
from .base import Derivatives, Law, Range, sheet_fields

MIN_POINTS = 3
MAX_POINTS = (
    40  # in a file: compiling the form takes the square of their number, half a minute at 100
)
EXTRAPOLATION = CONSTANT, LINEAR = "constant", "linear"
CURVES = "warp", "weft", "shear"
_BEYOND = {
    CONSTANT: "there the stress stays at the table's last, without stiffness",
    LINEAR: "there the table's last slope goes on",
}
_COLUMNS = {
    "yarn": (("eps", STRAIN), ("sigma", factors("stress"))),
    "shear": (("gamma", ANGLE), ("tau", factors("stress"))),
}


@dataclass(frozen=True)
class Curve(Parameters):
    """Nominal stress [MPa] over strain [- or rad] through points; x, y: tuples of n >= 3 numbers,
    x rising.

    Between the points it is a monotone cubic (Fritsch and Carlson 1980, SciPy's PCHIP): it rises
    where the data rise, and its slope is continuous, so the energy is C2. Energy counts from zero
    strain, where the curve must be free of stress.

    extrapolation, in Abaqus' words: `constant` holds the first and the last stress beyond the
    points, `linear` goes on with the slopes there, but holds a stress that falls towards 0. A
    curve that begins at 0 has no stress below, with either.

    Raises InputError, which names the point, for points of another kind, and for another
    extrapolation.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]
    extrapolation: str = CONSTANT
    # for each piece where its t is zero, and its energy's coefficients, highest power first
    _pieces: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        x, y = np.asarray(self.x, float), np.asarray(self.y, float)
        for k in range(len(x)):
            if not (math.isfinite(x[k]) and math.isfinite(y[k])):
                raise InputError(f"point {k + 1} is ({x[k]}, {y[k]}); allowed are finite numbers")
            if x[k] * y[k] < 0:
                raise InputError(
                    f"point {k + 1}: the stress is {y[k]:.6g} MPa at the strain {x[k]:.6g}; "
                    "allowed is one of the same sign"
                )
            if k and x[k] <= x[k - 1]:
                raise InputError(
                    f"point {k + 1}: {x[k]:.6g} comes after {x[k - 1]:.6g}; "
                    "allowed are strains that rise strictly"
                )
        if len(x) < MIN_POINTS:
            raise InputError(f"the curve has {len(x)} points; allowed is {MIN_POINTS} or more")
        zero = np.flatnonzero(x == 0)
        if len(zero) != 1 or y[zero[0]] != 0:
            raise InputError(
                "the curve has no point (0, 0); "
                "allowed is one that is free of stress at zero strain"
            )
        if self.extrapolation not in EXTRAPOLATION:
            raise InputError(
                f"extrapolation is {shown(self.extrapolation)}; allowed is "
                f"{' or '.join(EXTRAPOLATION)}"
            )
        from scipy.interpolate import PchipInterpolator  # takes long to import

        inner = PchipInterpolator(x, y)
        left, right = (0.0, 0.0)
        if self.extrapolation == LINEAR:  # but never towards 0 and beyond
            left, right = np.maximum(inner.derivative()(x[[0, -1]]), 0) * [x[0] < 0, x[-1] > 0]
        # stress of [left tail, pieces.., right tail]
        c = np.column_stack([[0, 0, left, y[0]], inner.c, [0, 0, right, y[-1]]])
        object.__setattr__(self, "_pieces", _energies(np.concatenate([x[:1], x]), c))

    def __call__(self, e: ArrayLike) -> np.ndarray:
        """Stress [MPa] at strains `e`, of their shape."""
        return self.derivatives(e)[1]

    def derivatives(self, e: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy, stress and tangent [MPa] at strains `e`, each of their shape."""
        e = np.asarray(e, float)
        start, w4, w3, w2, w1, w0 = self._pieces[:, np.searchsorted(self.x, e, side="right")]
        t = e - start
        energy = (((w4 * t + w3) * t + w2) * t + w1) * t + w0
        stress = ((4 * w4 * t + 3 * w3) * t + 2 * w2) * t + w1
        return energy, stress, (12 * w4 * t + 6 * w3) * t + 2 * w2

    def energy(self, e: Any) -> Any:
        """Energy [MPa] at strains of any kind that a law's energy takes."""

        # picks constants, so that the choice is not differentiated; halves, to nest log2(n) deep
        def pick(values):
            if len(values) == 1:
                return values[0][1]
            half = len(values) // 2
            return where(e < values[half][0], pick(values[:half]), pick(values[half:]))

        starts, *rows = self._pieces
        start, w4, w3, w2, w1, w0 = (pick(list(zip(starts, row))) for row in (starts, *rows))
        t = e - start
        return (((w4 * t + w3) * t + w2) * t + w1) * t + w0

    def symbols(self, make: Callable[[float], Any]) -> Self:
        """A copy for `energy` alone, with make(v) for each number v."""
        new = super().symbols(make)
        object.__setattr__(new, "_pieces", [[make(v) for v in row] for row in self._pieces])
        return new


def _energies(starts: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Starts and coefficients of the energy (6, n + 1), continuous, zero at zero strain, of pieces
    that begin at `starts`, where the stress has the coefficients c (4, n + 1)."""
    W = np.vstack([c / np.array([4.0, 3.0, 2.0, 1.0])[:, None], np.zeros(c.shape[1])])
    for k in range(2, c.shape[1]):
        W[4, k] = np.polyval(W[:, k - 1], starts[k] - starts[k - 1])
    rest = np.searchsorted(starts[1:], 0.0, side="right")
    W[4] -= np.polyval(W[:, rest], 0.0 - starts[rest])
    return np.vstack([starts, W])


@dataclass(frozen=True)
class TabulatedFabric(Law):
    """FABRIC from tables: curves of warp and weft over nominal strain, of shear over the shear
    angle. Shear is the same in both senses, so its table begins at 0.

    Raises InputError for a shear table that begins below 0, and for a thickness [mm] or density
    [g/cm3] not above 0.
    """

    law = "tabulated"

    warp: Curve
    weft: Curve
    shear: Curve
    _both: Curve = field(init=False, repr=False, compare=False)  # senses of shear

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shear.x[0] < 0:
            raise InputError(
                f"shear begins at {self.shear.x[0]:.6g}; allowed is to begin at 0; "
                "the other sense is its mirror image"
            )
        x, y = np.array(self.shear.x), np.array(self.shear.y)
        mirrored = [tuple(np.concatenate([-v[:0:-1], v])) for v in (x, y)]
        both = Curve(mirrored[0], mirrored[1], self.shear.extrapolation)
        object.__setattr__(self, "_both", both)

    def energy(self, eps_a: Any, eps_b: Any, gamma: Any) -> tuple[Any, Any, Any]:
        r"""The areas under the curves: $W = \int_0^{\epsilon_a} \sigma_a\,d\epsilon
        + \int_0^{\epsilon_b} \sigma_b\,d\epsilon + \int_0^\gamma \tau\,d\gamma$."""
        return self.warp.energy(eps_a), self.weft.energy(eps_b), self._both.energy(gamma)

    def derivatives(
        self, eps_a: np.ndarray, eps_b: np.ndarray, gamma: np.ndarray, second: bool = True
    ) -> Derivatives:
        """In closed form."""
        (A, A_a, A_aa), (B, B_b, B_bb), (H, H_g, H_gg) = (
            curve.derivatives(v)
            for curve, v in zip((self.warp, self.weft, self._both), (eps_a, eps_b, gamma))
        )
        zero = np.zeros_like(A)
        tangent = np.stack([A_aa, zero, B_bb, zero, zero, H_gg]) if second else None
        return Derivatives(np.stack([A, B, H], -1), np.stack([A_a, B_b, H_g]), tangent)

    def ranges(self) -> tuple[Range, ...]:
        """What the tables cover. Yarns of a table without compression have none, which
        `plausibility_warnings` tells."""
        found = []
        for strain, name in zip(("eps_a", "eps_b", "gamma"), CURVES):
            curve = getattr(self, name)
            low = curve.x[0] if curve.x[0] < 0 else -math.inf
            beyond = _BEYOND[curve.extrapolation]
            found.append(Range(strain, f"the table of {name}", low, curve.x[-1], beyond))
        return tuple(found)

    def plausibility_warnings(self) -> list[str]:
        """As of any law, and of tables without compression, or in which the stress falls."""
        found = super().plausibility_warnings()
        for name in CURVES:
            curve, words = getattr(self, name), f"the table of {name} of material {self.name}"
            if name != "shear" and curve.x[0] == 0:
                found.append(
                    f"{words} begins at 0, so the yarns have no stress and no stiffness in "
                    "compression; rows below 0 would give them one"
                )
            falls = np.flatnonzero(np.diff(curve.y) < 0)
            if falls.size:
                start = (
                    math.degrees(curve.x[falls[0]]) if name == "shear" else 100 * curve.x[falls[0]]
                )
                found.append(
                    f"{words} falls from {start:.4g} {'deg' if name == 'shear' else '%'} on, where "
                    "the fabric is unstable: strains gather in rows of cells"
                )
        return found

    def table(self) -> dict[str, Any]:
        """All of it; a material file names CSV files in the place of the points."""
        curves = {name: getattr(self, name) for name in CURVES}
        tables = {
            name: {"x": list(c.x), "y": list(c.y), "extrapolation": c.extrapolation}
            for name, c in curves.items()
        }
        return {"model": "fabric"} | self.sheet_table() | tables

    @classmethod
    def from_document(cls, document: dict[str, Any], folder: Path) -> Self:
        """The fabric of a TOML document in `folder` with `law = "tabulated"` or `model = "fabric"`.

        Top level: name, thickness, density as in any material file, and `warp`, `weft`, `shear`:
        CSV files beside it with the headers `eps [%], sigma [MPa]` and `gamma [deg], tau [MPa]`,
        and `extrapolation` of all, see `Curve`. Raises InputError by file and row.
        """
        files = {key: document.pop(key, None) for key in CURVES}
        beyond = document.pop("extrapolation", CONSTANT)
        for key in ("law", "model"):
            document.pop(key, None)
        fields = sheet_fields(
            document, take_units(document), ("law", "model", "extrapolation", *files)
        )
        for key, name in files.items():
            if not isinstance(name, str):
                raise InputError(
                    f"{key} is {name!r}; allowed is the name of a CSV file beside this one"
                )
            curve = read_table(folder / name, "shear" if key == "shear" else "yarn")
            fields[key] = dataclasses.replace(curve, extrapolation=beyond)
        return cls(**fields)


def read_table(path: str | os.PathLike[str], kind: str) -> Curve:
    """Curve from a CSV file with a header of names and units; kind: "yarn" or "shear".

    Raises InputError by file and row.
    """
    try:
        return _curve(read_lines(path), _COLUMNS[kind])
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _curve(lines, columns):
    """The curve in the lines of a file; InputError by row."""
    wanted = ", ".join(f"{name} [{'|'.join(units)}]" for name, units in columns)
    table = table_of(rows_of(lines), lambda name: name in dict(columns))
    if len(table.names) != 2:
        raise InputError(f"row {table.top} is no header of two columns; allowed is {wanted}")
    factors = {}
    for i, (name, unit, (column, units)) in enumerate(zip(table.names, table.units, columns)):
        if name != column or unit not in units:
            told = name if unit is None else f"{name} [{unit}]"
            raise InputError(f"row {table.top} has the column {told!r}; allowed is {wanted}")
        factors[i] = name, units[unit]
    problems = Problems()
    x, y = values_of(table, factors, problems).values()
    if len(x) > MAX_POINTS:
        problems.append(
            f"has {len(x)} points; allowed are {MIN_POINTS} to {MAX_POINTS}, so thin it out"
        )
    problems.stop()
    try:
        return Curve(tuple(x.tolist()), tuple(y.tolist()))
    except InputError as error:
        message = str(error)
        if match := re.match(r"point (\d+)", message):
            message = message.replace(match[0], f"row {table.rows[int(match[1]) - 1]}", 1)
        raise InputError(message) from None
