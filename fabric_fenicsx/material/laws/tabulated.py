"""The decoupled baseline as users of Abaqus' FABRIC know it: tables for warp, weft and shear."""

import dataclasses
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import InputError
from ...core.formatting import percent
from ...core.rules import check_complete
from ...io.text_tables import columns_of, read_lines, table_of
from ...io.units import ANGLE, REACH, STRAIN, stresses
from ..energy import Derivatives, Range
from ..files import OWN_UNITS, Document, take_units
from ..functions import Number, curve_through, where
from ..material import Parameters
from .base import Law, sheet_fields

# in a file: compiling the form takes the square of their number, half a minute at 100
MAX_POINTS = 40
_BEYOND = {
    "constant": "there the last stress is kept, without stiffness",
    "linear": "there the last slope continues",
}


@dataclass(frozen=True)
class Curve(Parameters):
    """Nominal stress y [MPa] over rising strain x [- or rad] through 3 points or more and (0, 0), a
    monotone cubic (SciPy's PCHIP), so that the energy is C2.

    extrapolation: `constant` holds the first and the last stress beyond the points, `linear` goes
    on with the slopes there, but holds a stress that falls towards 0. A curve that begins at 0 has
    no stress below. Raises InputError, which names the point, for others.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]
    extrapolation: str = "constant"
    # energy, stress and tangent, piecewise polynomials
    _functions: tuple = field(init=False, repr=False, compare=False)
    # for each piece of the energy where it starts, and its coefficients, highest power first
    _pieces: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        x, y = np.asarray(self.x, float), np.asarray(self.y, float)
        flaws = [
            f"point {k + 1} is ({e:.6g}, {stress:.6g}); expected increasing strains, and stresses "
            "of their sign"
            for k, (e, stress) in enumerate(zip(x, y))
            if not (abs(stress) < math.inf and e * stress >= 0 and (not k or e > x[k - 1]))
        ]
        if len(x) < 3 or (0.0, 0.0) not in zip(x, y):
            flaws += [f"the curve has {len(x)} points; expected 3 or more, with (0, 0)"]
        if (beyond := self.extrapolation) not in [*_BEYOND]:
            flaws += [f"extrapolation is {beyond!r}; expected {' or '.join(_BEYOND)}"]
        for flaw in flaws[:1]:
            raise InputError(flaw)
        on = (self.extrapolation == "linear") & np.array([x[0] < 0, x[-1] > 0])
        energy, *slopes = curve_through(x, y, on)
        object.__setattr__(self, "_functions", (energy, *slopes))
        object.__setattr__(self, "_pieces", np.vstack([energy.x[:-1], energy.c]))

    def __rmul__(self, factor: float) -> Self:
        """The curve with its stresses times a factor."""
        return dataclasses.replace(self, y=tuple(factor * stress for stress in self.y))

    def __call__(self, e: ArrayLike) -> np.ndarray:
        """Stress [MPa] at strains `e`, of their shape."""
        return self._functions[1](e)

    def derivatives(self, e: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Energy, stress and tangent [MPa] at strains `e`, each of their shape."""
        energy, stress, tangent = self._functions
        return energy(e), stress(e), tangent(e)

    def energy(self, e: Number) -> Number:
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

    def symbols(self, make: Callable[[float], Number]) -> Self:
        """A copy for `energy` alone, with make(v) for each number v."""
        new = super().symbols(make)
        object.__setattr__(new, "_pieces", [[make(v) for v in row] for row in self._pieces])
        object.__setattr__(new, "_functions", None)
        return new


@dataclass(frozen=True)
class TabulatedFabric(Law):
    """A fabric without couplings, from curves for warp, weft and shear.

    Raises InputError for a shear table that begins below 0, and for a value out of its range.

    Parameters
    ----------
    warp, weft : Curve
        Nominal stress [MPa] against strain [-] along the yarns.
    shear : Curve
        Shear stress [MPa] against shear angle [rad] from 0 on, mirrored for negative angles.
    thickness, density, name, compaction, fibre_density, fibre_share, assumed
        As in `Law`.

    Examples
    --------
    >>> from fabric_fenicsx.material.laws.tabulated import Curve
    >>> yarn = Curve((-0.1, 0.0, 0.01, 0.03), (-0.1, 0.0, 9.0, 45.0))
    >>> shear = Curve((0.0, 0.4, 0.8), (0.0, 0.01, 0.09))
    >>> fabric = ff.TabulatedFabric(yarn, yarn, shear, thickness=0.5)
    >>> fabric.warp(0.03).item()
    45.0
    """

    law = "tabulated"
    factors = {"shear_factor": ("shear",), "yarn_factor": ("warp", "weft")}
    strain_of: ClassVar = {"warp": "eps_a", "weft": "eps_b", "shear": "gamma"}

    warp: Curve
    weft: Curve
    shear: Curve
    _both: Curve = field(init=False, repr=False, compare=False)  # senses of shear

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.shear.x[0] < 0:
            raise InputError("shear begins below 0; expected 0, because the curve is mirrored")
        x, y = ((*(-u for u in v[:0:-1]), *v) for v in (self.shear.x, self.shear.y))
        object.__setattr__(self, "_both", Curve(x, y, self.shear.extrapolation))

    def energy(self, eps_a: Number, eps_b: Number, gamma: Number) -> tuple[Number, ...]:
        r"""The areas under the curves: $W = \int_0^{\epsilon_a} \sigma_a\,d\epsilon
        + \int_0^{\epsilon_b} \sigma_b\,d\epsilon + \int_0^\gamma \tau\,d\gamma$."""
        return self.warp.energy(eps_a), self.weft.energy(eps_b), self._both.energy(gamma)

    def derivatives(
        self, eps_a: np.ndarray, eps_b: np.ndarray, gamma: np.ndarray, second: bool = True
    ) -> Derivatives:
        if self.warp._functions is None:  # of `symbols`
            return super().derivatives(eps_a, eps_b, gamma, second)
        pairs = (self.warp, eps_a), (self.weft, eps_b), (self._both, gamma)
        (A, A_a, A_aa), (B, B_b, B_bb), (H, H_g, H_gg) = (c.derivatives(e) for c, e in pairs)
        zero = np.zeros_like(A)
        tangent = np.stack([A_aa, zero, B_bb, zero, zero, H_gg]) if second else None
        return Derivatives(np.stack([A, B, H], -1), np.stack([A_a, B_b, H_g]), tangent)

    def ranges(self) -> tuple[Range, ...]:
        ranges = []
        for name, strain in self.strain_of.items():
            (first, *_, last), beyond = getattr(self, name).x, getattr(self, name).extrapolation
            low = first if first < 0 else -math.inf
            ranges.append(Range(strain, f"the table of {name}", low, last, _BEYOND[beyond]))
        return tuple(ranges)

    def plausibility_warnings(self) -> list[str]:
        warnings = super().plausibility_warnings()
        for name in self.strain_of:
            curve, table = getattr(self, name), f"the table of {name} of material {self.label}"
            low, high = REACH[self.strain_of[name].split("_")[0]]
            if not low <= (end := float(max(np.abs(curve.x)))) <= high:
                reach = f"{math.degrees(end):.4g} deg" if name == "shear" else f"{100 * end:.4g} %"
                warnings.append(f"{table} reaches {reach}; is the unit in its header right?")
            if name != "shear" and curve.x[0] == 0:
                warnings.append(f"{table} begins at 0: yarns have no stiffness in compression")
            for k in np.flatnonzero(np.diff(curve.y) < 0)[:1]:
                x = curve.x[k]
                start = f"{math.degrees(x):.4g} deg" if name == "shear" else percent(x, 4)
                warnings.append(f"{table} decreases from {start} on, where the fabric is unstable")
        return warnings

    def table(self) -> Document:
        """The curves and the sheet; a user's file names CSV files in the place of the points."""
        tables: Document = {"law": self.law, **self.sheet_table(), "units": OWN_UNITS}
        for name in self.strain_of:
            curve = getattr(self, name)
            points = {"x": list(curve.x), "y": list(curve.y)}
            tables[name] = points | {"extrapolation": curve.extrapolation}
        return tables

    @classmethod
    def from_document(cls, document: Document, folder: Path) -> Self:
        """The fabric of a TOML document in `folder`, in which `warp`, `weft` and `shear` are CSV
        files with the headers `eps [%], sigma [MPa]` and `gamma [deg], tau [MPa]`, or such."""
        found = [document.get(key) for key in cls.strain_of]
        if all(isinstance(each, dict) and "extrapolation" in each for each in found):  # of `table`
            own = {key: document.pop(key) for key in ("law", *cls.strain_of)}
            fields = sheet_fields(cls, document, take_units(document), (), {})
            for k in cls.strain_of:
                fields[k] = Curve(tuple(own[k]["x"]), tuple(own[k]["y"]), own[k]["extrapolation"])
            return cls(**fields)
        keys = "law", "model", "extrapolation", *cls.strain_of
        files = {key: document.pop(key) for key in keys if key in document}
        fields = sheet_fields(cls, document, take_units(document), keys, {})
        check_complete(files, cls.strain_of, "", "CSV files beside this one")
        stress, beyond = stresses(fields["thickness"]), files.get("extrapolation", "constant")
        yarn, shear = {"eps": STRAIN, "sigma": stress}, {"gamma": ANGLE, "tau": stress}
        for key in cls.strain_of:
            if not isinstance(files[key], str):
                raise InputError(f"{key} is {files[key]!r}; expected the name of a CSV file")
            fields[key] = read_table(folder / files[key], shear if key == "shear" else yarn, beyond)
        return cls(**fields)


def read_table(
    path: Path, columns: Mapping[str, Mapping], extrapolation: str = "constant"
) -> Curve:
    """The curve in a CSV file with two `columns`, {name: factors of its units}, in any order.
    InputError by file and row."""
    try:
        table = table_of(read_lines(path), columns.__contains__)
        x, y = columns_of(table, columns).values()
        if len(x) > MAX_POINTS:
            raise InputError(f"has {len(x)} points; expected up to {MAX_POINTS}: remove some")
        return Curve(tuple(x.tolist()), tuple(y.tolist()), extrapolation)
    except InputError as error:
        message = str(error)
        if match := re.match(r"point (\d+)", message):
            message = f"row {table.rows[int(match[1]) - 1]}{message[match.end() :]}"
        raise InputError(f"{path}: {message}") from None
