"""Estimated errors of runs beside true ones: which runs, and how good the estimates are."""

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fabric_fenicsx.results import measures
from fabric_fenicsx.results.error import field_differences
from fabric_fenicsx.results.result import Result

from .reference import curve_distance

Row = dict[str, Any]
ANGLES = 90.0, 90.0, 60.0, 75.0, 105.0  # between yarns [deg]
CELLS: Sequence[tuple[str | None, str | None]] = (
    (None, None),  # the defaults, twice as often
    (None, None),
    ("P1", "crossed"),
    ("P1", "unstructured"),
    ("P2", "left"),
    ("P2", "unstructured"),
)
OUTLINE_CELLS = ("P1", "along"), ("P2", "along"), ("P2", "unstructured")
# a strip with a notch and a hole [mm]
RINGS = (
    [(0, 0), (200, 0), (200, 50), (120, 50), (110, 40), (90, 40), (80, 50), (0, 50)],
    [(55, 15), (65, 15), (65, 25), (55, 25)],
)


@dataclass(frozen=True)
class Case:
    """A run of `test` with these options; all other options have their defaults."""

    test: str
    options: Mapping[str, Any]

    def __str__(self) -> str:
        words = (f"{name} {value}" for name, value in self.options.items() if value is not None)
        return ", ".join([self.test, *words])


def cases(seed: int, strips: int = 32, domes: int = 8) -> list[Case]:
    """Strips of any yarn angles, strains, meshes and outlines, and double domes, by a seed."""
    rng = np.random.default_rng(seed)
    return [_strip(rng) for _ in range(strips)] + [_dome(rng) for _ in range(domes)]


def _strip(rng):
    test = rng.choice(["tensile", "bias"])
    between = float(rng.choice(ANGLES))
    if test == "tensile":
        angle = float(rng.choice([0.0, round(rng.uniform(2, 45))]))
    else:
        angle = 45.0 if rng.random() < 0.3 else float(round(rng.uniform(25, 65)))
    off = min(abs((yarn + 90) % 180 - 90) for yarn in (angle, angle + between))
    most = 0.03 if off < 1 or 15 <= off < 25 else 0.006 if off < 15 else 0.12
    strain = round(most * rng.uniform(0.2, 1), 4)
    has_outline = rng.random() < 0.2
    known = OUTLINE_CELLS if has_outline else CELLS
    element, pattern = known[rng.integers(len(known))]
    options = {"fibre_angle": angle, "yarn_angle": between, "strain": strain}
    options |= {"element": element, "pattern": pattern}
    options |= {"size": rng.choice([4, 6, 8])} if has_outline else {"nx": rng.choice([24, 32, 48])}
    return Case(str(test), {k: getattr(v, "item", lambda v=v: v)() for k, v in options.items()})


def _dome(rng):
    angle = float(rng.choice([0.0, 45.0, round(rng.uniform(1, 89))]))
    element, sizes = [("P1", (8, 12, 16)), ("P2", (6, 8))][rng.integers(2)]
    return Case("dome", {"fibre_angle": angle, "element": element, "nx": int(rng.choice(sizes))})


def finer(case: Case) -> list[Case]:
    """The runs that are the truth of a case, the finest last: cubic cells along the yarns, those of
    an outline, or a finer dome."""
    if case.test == "dome":
        return [Case("dome", {**case.options, "element": "P2", "nx": nx}) for nx in (12, 16)]
    if size := case.options.get("size"):
        cells = {"element": "P3", "pattern": "along"}
        return [Case(case.test, {**case.options, **cells, "size": s}) for s in (size / 2, size / 3)]
    cells = {"element": "P3", "pattern": "yarns"}
    return [Case(case.test, {**case.options, **cells, "nx": nx}) for nx in (24, 36)]


def compare(case: Case, result: Result, truth: Sequence[Result]) -> list[Row]:
    """A row for each quantity of a run with estimated errors: true error, to the last run of the
    `truth`; estimated one; what the true one is known to, by the run before; and whether the
    estimate covers it."""
    errors, (coarse, finest), rows = result.summary["error"], truth, []

    def add(quantity, true, bar):
        row = {"case": str(case), "test": case.test, "quantity": quantity, "true": float(abs(true))}
        row |= {"estimated": errors[quantity], "known_to": float(abs(bar))}
        rows.append(row | {"covered": bool(errors[quantity] + abs(bar) >= abs(true))})

    for name in errors:
        mine, theirs, before = (run.number(name) for run in (result, finest, coarse))
        if mine is not None and theirs is not None and before is not None:
            add(name, mine - theirs, before - theirs)
    fine = _curve(finest)
    off, bar = (abs(fine[1, -1]) * curve_distance(_curve(run), fine) for run in (result, coarse))
    add("curve_N", off, bar)
    bars = field_differences(coarse, finest)
    for name, apart in field_differences(result, finest).items():
        root, bar = _root(result, apart), _root(coarse, bars[name])
        shear = name == "shear_angle"
        quantity = "shear_angle_rms_deg" if shear else f"{name}_rms"
        add(quantity, *(np.degrees([root, bar]) if shear else (root, bar)))
    return rows


def _curve(run):
    return np.array([(row["load"], row["reaction_N"]) for row in run.rows]).T


def _root(run, values):
    """Root mean square over the area of cells."""
    blank = run.scene.blank
    return float(np.sqrt(measures.mean(run.scene.comm, values**2, blank.areas()) or 0.0))


def judge(rows: Sequence[Row]) -> list[Row]:
    """For each quantity, and for all: number of cases, share that estimates cover, and sharpness,
    the median of estimated over true errors, of those that are known well enough to tell."""
    found = []
    for name in ["all", *dict.fromkeys(row["quantity"] for row in rows)]:
        mine = [row for row in rows if name in ("all", row["quantity"])]
        sharp = [r["estimated"] / r["true"] for r in mine if r["true"] > 2 * r["known_to"]]
        covered = sum(row["covered"] for row in mine)
        found.append(
            {
                "quantity": name,
                "cases": len(mine),
                "covered": covered / len(mine),
                "estimated_over_true": statistics.median(sharp) if sharp else None,
            }
        )
    return found


def line(row: Row) -> str:
    """A row of `judge` as text."""
    ratio = row["estimated_over_true"]
    words = "-" if ratio is None else f"{ratio:.2g}"
    return (
        f"{row['quantity']:34s} {row['cases']:4d} cases, {100 * row['covered']:5.1f} % covered, "
        f"estimated over true error {words} (median)"
    )


def draw(path: Path, rows: Sequence[Row]) -> None:
    """Estimated errors over true ones, both relative to the largest true one of the quantity and
    test; above the line estimates cover the truth."""
    from fabric_fenicsx.plot.pictures import curves

    largest: dict[tuple[str, str], float] = {}
    for row in rows:
        key = row["test"], row["quantity"]
        largest[key] = max(largest.get(key, 1e-300), row["true"])
    series: dict[str, Sequence] = {}
    for test, style in zip(
        dict.fromkeys(row["test"] for row in rows), ("C0o", "C1s", "C2^", "C3D")
    ):
        for local, shape in ((False, style), (True, style[:2] + "x")):
            mine = [r for r in rows if r["test"] == test]
            mine = [r for r in mine if (r["quantity"] not in WHOLE) == local]
            scale = [largest[test, r["quantity"]] for r in mine]
            true = [max(r["true"] / s, 1e-6) for r, s in zip(mine, scale)]
            bars = [max(r["estimated"] / s, 1e-6) for r, s in zip(mine, scale)]
            label = f"{test}, {'strains' if local else 'force, energy, curve'}"
            series[label] = true, bars, shape
    series["estimated = true"] = [1e-4, 1], [1e-4, 1], "k-"
    labels = "true error, of the test's largest", "estimated error, of the same"
    curves(path, series, *labels, scale="log")


WHOLE = "reaction_N", "strain_energy_Nmm", "curve_N", "nominal_stress_MPa", "punch_force_N"
