"""Kinds of tests with their columns and units; what a test measured, and the sheet.

Shear forces and the stress that does the same work, with thickness t and shear angle g:

- Frame of side L_f with fabric of side L: its diagonal 2 L_f cos(pi/4 - g/2) is pulled by F, so F
  L_f sin(pi/4 - g/2) = tau t L^2. With F_s = F / (2 cos(pi/4 - g/2)) and F_sh = F_s L_f / L^2 that
  is tau t = F_sh cos g.
- Bias strip: F (H - W)/2 (cos g/2 - sin g/2) = t [tau(g) W (2H - 3W)/2 + tau(g/2) W^2/2], which is
  the formula of Cao et al. (2008) with the same tau t = F_sh cos g. F_sh / t is the part of the
  traction along the yarn (S_12), and only at small g also the stress conjugate to g.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.errors import InputError
from ...io.text_tables import some
from ...io.units import ANGLE, PER_WIDTH, STRAIN, factors, stresses

MIN_POINTS = 5
STRAINS = ("eps_a", "eps_b", "gamma")

_STRESS = stresses(math.nan)
_UNIT = {  # first unit of each: the one used inside
    **dict.fromkeys(("eps_a", "eps_b", "exx", "eyy", "exy"), STRAIN),
    "gamma": ANGLE,
    **dict.fromkeys(("sigma_a", "sigma_b", "tau"), _STRESS),
    "F_sh": PER_WIDTH,
    "F": {"N": 1.0, "kN": 1e3},
    "displacement": factors("length"),
    "pressure": factors("stress") | {"bar": 0.1},
    "thickness": factors("length"),
    "fibre_volume_fraction": STRAIN,
}
COLUMNS = tuple(_UNIT)
ALL_UNITS = {unit for known in _UNIT.values() for unit in known}
# what machines call columns, in lower case
_ALIASES = {
    "displacement": "extension, stroke, travel, crosshead, weg, standardweg, traversenweg",
    "F": "f, force, load, kraft, standardkraft, prüfkraft",
    "gamma": "shear angle, scherwinkel",
    "pressure": "druck",
    "thickness": "dicke",
}
_KNOWN = {column.casefold(): column for column in COLUMNS}
_KNOWN |= {alias: c for c, aliases in _ALIASES.items() for alias in aliases.split(", ")}

# right Cauchy-Green of principal strains
MEASURES = {
    "green": lambda e: np.maximum(1 + 2 * e, 1e-9),
    "hencky": lambda e: np.exp(2 * e),
    "biot": lambda e: np.maximum(1 + e, 1e-9) ** 2,
}


def column_of(name: str) -> str:
    """The column that a name in a header means, the name itself if it means none."""
    return _KNOWN.get(name.casefold(), name)


def units(column: str, thickness: float = math.nan) -> Mapping[str, float]:
    """Factor from each unit that a column may have to the first, which is used inside. A stress may
    also be a force per width, which is divided by `thickness` [mm]."""
    return stresses(thickness) if _UNIT[column] is _STRESS else _UNIT[column]


def unit_inside(column: str) -> str:
    """The unit in which values of a column are kept."""
    return next(iter(_UNIT[column]))


class Kind(NamedTuple):
    """The columns and keys of a kind of test."""

    strains: tuple[str, ...]  # columns that must be there
    optional: tuple[str, ...]  # strains that are 0 if their column is not there
    measured: tuple[str, ...]  # one of these at least
    keys: tuple[str, ...] = ()  # that must be there
    more: tuple[str, ...] = ()  # keys that may be there, besides `noise`
    sign: int = 0  # that the first strain and what is measured have; 0: either
    # what a machine writes -> the column that it becomes, and the key of the specimen it needs
    raw: Mapping[str, tuple[str, str]] = {}

    @property
    def image(self) -> tuple[str, ...]:
        """Columns of image correlation that the test may have instead of gamma."""
        return ("exx", "eyy", "exy") if self.strains == ("gamma",) else ()


_LOADED, _FRAME = ("slack", "zero"), ("frame_length", "fabric_length")
_MOVED = {"displacement": ("gamma", "height")}


def _strip(strain: str, stress: str) -> Kind:
    raw = {"displacement": (strain, "length"), "F": (stress, "width")}
    return Kind((strain,), (), (stress,), ("lateral",), ("length", "width", *_LOADED), 1, raw)


TESTS = {
    "uniaxial_a": _strip("eps_a", "sigma_a"),
    "uniaxial_b": _strip("eps_b", "sigma_b"),
    "biaxial": Kind(("eps_a", "eps_b"), (), ("sigma_a", "sigma_b")),
    "compression_a": Kind(("eps_a",), ("gamma",), ("sigma_a",), sign=-1),
    "compression_b": Kind(("eps_b",), ("gamma",), ("sigma_b",), sign=-1),
    "shear": Kind(("gamma",), ("eps_a", "eps_b"), ("tau", "F_sh"), (), ("strain", "slack"), 1),
    "picture_frame": Kind(("gamma",), ("eps_a", "eps_b"), ("F",), _FRAME, ("strain", *_LOADED), 1),
    "bias_extension": Kind(
        ("gamma",), (), ("F",), ("height", "width"), ("strain", *_LOADED), 1, _MOVED
    ),
    "compaction": Kind(("pressure",), (), ("thickness", "fibre_volume_fraction"), sign=1),
}
KEYS = ("test", "noise", *dict.fromkeys(k for t in TESTS.values() for k in (*t.keys, *t.more)))


class Table(NamedTuple):
    """A file's columns {name: (n,)} in inner units, the unit of each in the file, line numbers (n,)
    of the rows, and that of the header. noise: of its range, by which a column may go back or begin
    below 0."""

    columns: dict[str, np.ndarray]
    header: dict[str, str]
    rows: list[int]
    top: int
    noise: float = 0.01

    def kept(self, which: np.ndarray) -> "Table":
        """The rows by numbers or flags `which`."""
        columns = {name: values[which] for name, values in self.columns.items()}
        return self._replace(columns=columns, rows=np.array(self.rows)[which].tolist())

    def from_zero(self, column: str, sign: int) -> tuple["Table", list[str]]:
        """It without rows of a column that is by noise beyond 0, and words on these."""
        values = sign * self.columns[column]
        below = (values < 0) & (values >= -self.noise * values.max(initial=0.0))
        rows = some([f"row {row}" for row in np.array(self.rows)[below]])
        words = [f"{rows} left out, because noise puts {column} beyond 0 there"]
        return (self.kept(~below), words) if below.any() else (self, [])

    def loading_branch(self, column: str) -> tuple["Table", list[str]]:
        """The rows up to the first turn of the column, and sentences on those behind it and on
        those in which it goes back by no more than noise. InputError if that ends before its
        largest value."""
        x = self.columns[column]
        size = x - x[:1]
        if not size.any():
            flaw = f"{column} is {x[0]:.4g} {unit_inside(column)} in every row"
            raise InputError(f"row {self.rows[-1]}: {flaw}; expected to rise or fall")
        size = size * np.sign(size[np.abs(size).argmax()])
        top = np.maximum.accumulate(size)
        stop = int(np.argmax(np.append(top - size > self.noise * size.max(), True)))
        if top[stop - 1] < 0.99 * size.max():
            turn = f"{x[stop]:.4g} {unit_inside(column)} after {x[stop - 1]:.4g}"
            allowed = "to rise or fall throughout (keep one loading branch)"
            raise InputError(f"row {self.rows[stop]}: {column} is {turn}; expected {allowed}")
        end, rows, remarks = int(size[:stop].argmax()), self.rows, []
        if end + 1 < len(size):
            loop = f"{column} reverses after row {rows[end]}: of the loop the loading branch"
            remarks.append(f"{loop} is fitted, rows {rows[0]} to {rows[end]}")
        if (still := np.flatnonzero(np.diff(size[: end + 1]) <= 0) + 1).size:
            places = some([f"row {rows[k]}" for k in still])
            remarks.append(f"{column} does not increase in {places}; treated as scatter")
        return self.kept(np.arange(end + 1)), remarks

    def way_back(self, column: str, turn: int) -> "Table":
        """The rows from the row `turn` of the file on, down to the next turn of the column."""
        table = self.kept(np.flatnonzero(np.array(self.rows) >= turn))
        x = table.columns[column]
        up = x - np.minimum.accumulate(x) > self.noise * np.ptp(x)
        stop = int(np.argmax(np.append(up, True)))
        return table.kept(np.arange(x[:stop].argmin() + 1))


@dataclass(frozen=True)
class Response:
    """A measured column: `values` (n,) in `unit`, and how the law predicts it.

    It predicts gain * s, plus half * tau(gamma/2) if `half` is given, where s is the stress
    conjugate to eps_a, eps_b or gamma, or the lateral strain; if `linear` (n, 4) is given instead
    linear @ (1, s1, s2, s3), as of a simulated specimen."""

    column: str
    unit: str
    values: np.ndarray
    gain: np.ndarray
    half: np.ndarray | None = None
    linear: np.ndarray | None = None

    @property
    def component(self) -> int:
        """0: sigma_a, 1: sigma_b, 2: tau, 3: lateral strain."""
        return {"sigma_a": 0, "sigma_b": 1, "eps_a": 3, "eps_b": 3}.get(self.column, 2)

    @property
    def peak(self) -> float:
        """Largest magnitude, in `unit`."""
        return float(np.abs(self.values).max())

    def deviation(self, noise: tuple[str, float], values: np.ndarray) -> np.ndarray:
        """Standard deviations (n,) by the noise of a `Curve` about `values` (n,)."""
        kind, size = noise
        return size * {"absolute": 1.0, "maximum": self.peak}.get(kind, values) + 0 * values


@dataclass(frozen=True)
class Curve:
    """One test. strains: (n, 3) eps_a, eps_b [-], gamma [rad] as prescribed; rows: (n,) line
    numbers in the file; free: 0 or 1 if the yarns across a tension along a or b are free of stress;
    noise: ("maximum" | "value" | "absolute", number) or None; abscissa: the column of `strains`
    that runs; keys: further keys of the file, lengths [mm]; remarks: sentences on what was left
    out; back: of a loop in shear the angles (m,) [rad] and what was measured on the way back;
    displacement (n,) of the clamp [mm], if the file has it."""

    file: str
    test: str
    strains: np.ndarray
    responses: tuple[Response, ...]
    rows: np.ndarray
    abscissa: int
    free: int | None = None
    noise: tuple[str, float] | None = None
    keys: dict[str, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    back: tuple[np.ndarray, Response] | None = None
    displacement: np.ndarray | None = None

    @property
    def is_raw(self) -> bool:
        """True for a bias test of force over displacement."""
        return self.test == "bias_extension" and self.displacement is not None


@dataclass(frozen=True)
class CompactionTest:
    """A ply that plates pressed: pressure (n,) [MPa], rising, and the measured thickness [mm] or
    fibre volume fraction [-] in `response`; noise, remarks: as of a `Curve`."""

    file: str
    pressure: np.ndarray
    response: Response
    noise: tuple[str, float] | None = None
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sheet:
    """The content of `sheet.toml`: thickness [mm], density [g/cm3], whether warp and weft are tied
    (`balanced`), values to assume for parameters that the data don't determine, as {"p_min": ..} or
    {"warp.p_min": ..}, the areal weight [g/m2] if the density is from one, and the fibre density
    [g/cm3] and share of the mass if known. compaction: tests across the thickness. Of the CSV
    files: keys {file: {key: text}}, columns {name in a header: column, maybe with a unit in
    brackets}, and csv, their delimiter, decimal and encoding as far as stated."""

    name: str
    thickness: float
    density: float
    balanced: bool
    assumed: dict[str, float] = field(default_factory=dict)
    areal_weight: float | None = None
    fibre_density: float | None = None
    fibre_share: float | None = None
    compaction: tuple[CompactionTest, ...] = field(default=(), compare=False)  # has arrays
    keys: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=dict)
    csv: Mapping[str, str] = field(default_factory=dict)

    def measured_thickness(self, test: CompactionTest) -> np.ndarray:
        """Thickness of one ply at each point of a test, (n,) [mm]."""
        if test.response.column == "thickness":
            return test.response.values
        mass = self.density * self.thickness * (self.fibre_share or 1.0)
        fibres = mass / (self.fibre_density or math.nan)
        return fibres / test.response.values


def response(
    column: str,
    values: np.ndarray,
    gamma: np.ndarray,
    test: str,
    lengths: Mapping[str, float],
    t: float,
) -> Response:
    """The response of `values` (n,) of a column, in its inner unit, at shear angles gamma (n,)
    [rad]; lengths: keys of the test [mm], t: thickness [mm]."""
    gain: np.ndarray = np.ones_like(values)
    half = None
    if column == "F_sh":
        gain = t / np.cos(gamma)
    elif test == "picture_frame":
        arm = lengths["frame_length"] * np.sin(math.pi / 4 - gamma / 2)
        gain = t * lengths["fabric_length"] ** 2 / arm
    elif test == "bias_extension":
        H, W = lengths["height"], lengths["width"]
        arm = (H / W - 1) * (np.cos(gamma / 2) - np.sin(gamma / 2))
        gain, half = t * (2 * H - 3 * W) / arm, t * W / arm
    return Response(column, unit_inside(column), values, gain, half)


def image_angle(strains: np.ndarray, measure: str, test: str) -> np.ndarray:
    """Shear angle (n,) [rad] by exx, eyy and exy (n, 3) of image correlation, of a measure of
    `MEASURES`; x and y are along and across the pull of a bias test or a frame, or along the
    yarns of a plain shear test."""
    tensors = strains[:, [0, 2, 2, 1]].reshape(-1, 2, 2)
    values, axes = np.linalg.eigh(tensors)
    a, b = np.eye(2) if test == "shear" else np.array([[1, 1], [1, -1]]) / math.sqrt(2)
    C = np.einsum("nij,nj,nkj->nik", axes, MEASURES[measure](values), axes)
    sine = (C @ b @ a) / np.sqrt((C @ a @ a) * (C @ b @ b))
    return np.arcsin(sine * np.sign(sine[np.abs(sine).argmax()]))


def bias_angle(displacement: ArrayLike, height: float, width: float) -> np.ndarray:
    """Shear angle (n,) [rad] in the middle of a bias strip whose yarns, at 45 deg, do not stretch,
    at displacements of the clamp [mm]; 90 deg where these are more than such yarns allow."""
    e = np.asarray(displacement, float) / (height - width)
    return np.arcsin(np.minimum(e * (2 + e), 1.0))  # 0 at 0, where an arc cosine is off by 1e-16


def bias_normalised(gamma: ArrayLike, force: ArrayLike, height: float, width: float) -> np.ndarray:
    """Normalised shear force F_sh (n,) [N/mm] of a bias test, by the formula of Cao et al. (2008).

    gamma: (n,) [rad], rising from above 0; force: (n,) [N]; height, width [mm] of the strip.
    F_sh(gamma/2) is interpolated linearly, from 0 at 0, so the formula is one linear system.
    """
    g, H, W = np.asarray(gamma, float), height, width
    at_half = np.array([np.interp(g / 2, np.r_[0, g], np.r_[0, hat]) for hat in np.eye(len(g))]).T
    A = np.diag((2 * H - 3 * W) * np.cos(g)) + (W * np.cos(g / 2))[:, None] * at_half
    arm = (H / W - 1) * (np.cos(g / 2) - np.sin(g / 2))
    return np.linalg.solve(A, arm * np.asarray(force))
