"""Estimated errors of runs beside true ones: which runs, and how good the estimates are."""

import statistics
from dataclasses import dataclass

import numpy as np

from fabric_fenicsx.results import measures
from fabric_fenicsx.results.error import field_differences

from .strips import curve_distance

ANGLES = 90.0, 90.0, 60.0, 75.0, 105.0  # between yarns [deg]
USUAL = [(None, None)] * 2  # the defaults, twice as often
CELLS = [*USUAL, ("P1", "crossed"), ("P1", "unstructured"), ("P2", "left"), ("P2", "unstructured")]
OUTLINE_CELLS = [("P1", "along"), ("P2", "along"), ("P2", "unstructured")]
# a strip with a notch and a hole [mm]
RINGS = (
    [(0, 0), (200, 0), (200, 50), (120, 50), (110, 40), (90, 40), (80, 50), (0, 50)],
    [(55, 15), (65, 15), (65, 25), (55, 25)],
)


@dataclass(frozen=True)
class Case:
    """A run of `test` with these options; all other options have their defaults."""

    test: str
    options: dict

    def __str__(self) -> str:
        words = (f"{name} {value}" for name, value in self.options.items() if value is not None)
        return ", ".join([self.test, *words])


def cases(seed, strips=32, domes=8):
    """Strips of any yarn angles, strains, meshes and outlines, and double domes, by a seed."""
    rng = np.random.default_rng(seed)
    return [_strip(rng) for _ in range(strips)] + [_dome(rng) for _ in range(domes)]


def _strip(rng):
    test, between = str(rng.choice(["tensile", "bias"])), float(rng.choice(ANGLES))
    if test == "tensile":
        angle = float(rng.choice([0.0, round(rng.uniform(2, 45))]))
    else:
        angle = 45.0 if rng.random() < 0.3 else float(round(rng.uniform(25, 65)))
    off = min(abs((yarn + 90) % 180 - 90) for yarn in (angle, angle + between))
    most = 0.03 if off < 1 or 15 <= off < 25 else 0.006 if off < 15 else 0.12
    strain = round(float(most * rng.uniform(0.2, 1)), 4)
    has_outline = rng.random() < 0.2
    known = OUTLINE_CELLS if has_outline else CELLS
    element, pattern = known[rng.integers(len(known))]
    options = {"fibre_angle": angle, "yarn_angle": between, "strain": strain}
    options |= {"element": element, "pattern": pattern}
    sizes = ("size", [4, 6, 8]) if has_outline else ("nx", [24, 32, 48])
    return Case(test, options | {sizes[0]: int(rng.choice(sizes[1]))})


def _dome(rng):
    angle = float(rng.choice([0.0, 45.0, round(rng.uniform(1, 89))]))
    element, sizes = [("P1", (8, 12, 16)), ("P2", (6, 8))][rng.integers(2)]
    return Case("dome", {"fibre_angle": angle, "element": element, "nx": int(rng.choice(sizes))})


def finer(case, quick=False):
    """The runs that are the truth of a case, the finest last: cubic cells along the yarns, those of
    an outline, or a finer dome; quick: of a coarse one."""
    if case.test == "dome":
        return [Case("dome", {**case.options, "element": "P2", "nx": nx}) for nx in (12, 16)]
    if size := case.options.get("size"):
        change = [{"pattern": "along", "size": size / by} for by in (2, 3)]
    else:
        change = [{"pattern": "yarns", "nx": nx} for nx in ((8, 12) if quick else (16, 24))]
    return [Case(case.test, {**case.options, "element": "P3"} | each) for each in change]


def compare(case, result, truth):
    """A row for each quantity of a run with estimated errors: true error, to the last run of the
    `truth`; estimated one; what the true one is known to, by the run before; and whether the
    estimate covers it."""
    found, roots = dict[str, tuple](), dict[str, list]()
    runs, (before, finest) = (result, *truth), truth
    for name in result.summary["error"]:  # -> true error, and what it is known to
        values = [run.number(name) for run in runs]
        if None not in values:
            found[name] = values[0] - values[2], values[1] - values[2]
    curves = [np.array([(r["load"], r["reaction_N"]) for r in run.rows]).T for run in runs]
    last = abs(curves[2][1, -1])
    found["curve_N"] = tuple(last * curve_distance(curve, curves[2]) for curve in curves[:2])
    for run in (result, before):
        comm, areas = run.scene.comm, run.scene.blank.areas()
        for name, off in field_differences(run, finest).items():
            root = np.sqrt(measures.mean(comm, off**2, areas) or 0.0)
            in_deg = name == "shear_angle"
            own = roots.setdefault(f"{name}_rms_deg" if in_deg else f"{name}_rms", [])
            own.append(np.degrees(root) if in_deg else root)
    rows = []
    for quantity, pair in (found | roots).items():
        error, (true, bar) = result.summary["error"][quantity], map(float, np.abs(pair))
        row = {"case": str(case), "test": case.test, "quantity": quantity, "true": true}
        covered = error is not None and error + bar >= true
        rows.append(row | {"estimated": error, "known_to": bar, "covered": covered})
    return rows


def judge(rows):
    """For each quantity, and for all: number of cases, share whose error is unknown, share of the
    others that estimates cover, and sharpness, the median of estimated over true errors, of those
    that are known well enough to tell."""
    judged = []
    for name in ["all", *dict.fromkeys(row["quantity"] for row in rows)]:
        mine = [row for row in rows if name in ("all", row["quantity"])]
        told = [row for row in mine if row["estimated"] is not None]
        sharp = [r["estimated"] / r["true"] for r in told if r["true"] > 2 * r["known_to"]]
        row = {"quantity": name, "cases": len(mine), "unknown": 1 - len(told) / len(mine)}
        row["covered"] = sum(row["covered"] for row in told) / len(told) if told else None
        judged.append(row | {"estimated_over_true": statistics.median(sharp) if sharp else None})
    return judged
