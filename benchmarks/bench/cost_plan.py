"""Which runs speed_vs_error.py compares: one factor at a time, varied from a baseline."""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any


@dataclass(frozen=True)
class Configuration:
    """One run of the strip `scene`, or of forming, with yarns at `fibre_angle` [deg]; `sweep` says
    which factor it varies."""

    scene: str
    sweep: str = "baseline"
    element: str = "P1"
    pattern: str = "crossed"
    nx: int = 96
    integration: str = "full"
    steps: int = 20
    tolerance: float = 1e-8
    path_tolerance: float = 1e-5
    linear_solver: str = "mumps-cholesky"
    ranks: int = 1
    fibre_angle: float | None = None

    def __str__(self) -> str:
        return " ".join(str(v) for k, v in asdict(self).items() if v is not None and k != "sweep")


# factors whose values are pairs, of these two
PAIRED = {"element_nx": ("element", "nx"), "pattern_nx": ("pattern", "nx")}


def varied(sweep: str, **factors: Any) -> Iterator[dict[str, Any]]:
    """Changes of a `Configuration` for all combinations of the factors' values, the last factor the
    fastest. A value that is no list holds for all; values of the factors in PAIRED are pairs."""
    values = [each if isinstance(each, list) else [each] for each in factors.values()]
    for combination in product(*values):
        change: dict[str, Any] = {"sweep": sweep}
        for name, value in zip(factors, combination):
            change |= dict(zip(PAIRED[name], value)) if name in PAIRED else {name: value}
        yield change


UNSTRUCTURED_NX = [("P1", 133), ("P2", 66), ("P3", 42)]
COARSE_NX = [("P1", 66), ("P2", 33), ("P3", 21)]
INNER = {"element": "P2", "integration": "inner"}
REDUCED_NX = [
    ("left", 76),
    ("unstructured", 33),
    ("unstructured", 66),
    ("crossed", 48),
    ("graded", 32),
]
LEAN_20 = ["P1 24", "P1 120", "P2 12", "P2 24", "P2 48", "P3 16", "P3 32"]


def _pairs(*words):
    """Pairs of an element and a number of rectangles, from words such as "P2 24"."""
    return [(word.split()[0], int(word.split()[1])) for word in words]


QUICK = [
    *varied("mesh", nx=48),
    *varied("pattern", nx=48, pattern="unstructured"),
    *varied("pattern", element="P2", pattern="unstructured"),
    *varied("solver", linear_solver="cg-gamg"),
    *varied("ranks", ranks=2),
]
FULL = [
    *varied("mesh", nx=[24, 48, 120, 192]),
    *varied("mesh", element="P2", nx=[12, 24, 48, 96]),
    *varied("mesh", element="P3", nx=[12, 16, 24, 32]),
    *varied("mesh", element="Q1", nx=[48, 96]),
    *varied("mesh", element="Q2", nx=[24, 48]),
    *varied("pattern", pattern="left", element_nx=_pairs("P1 150", "P2 76", "P3 50")),
    *varied("pattern", pattern=["unstructured", "yarns"], element_nx=UNSTRUCTURED_NX),
    *varied("pattern", pattern=["unstructured", "yarns"], element_nx=COARSE_NX),
    *varied(
        "graded",
        pattern="graded",
        steps=20,
        path_tolerance=1e-3,
        element_nx=_pairs("P1 24", "P1 48", "P1 96", "P2 24", "P2 48"),
    ),
    *varied(
        "graded",
        pattern="graded",
        steps=15,
        path_tolerance=1e-2,
        element_nx=_pairs("P1 48", "P2 24"),
    ),
    *varied(
        "graded",
        pattern="graded",
        steps=20,
        path_tolerance=1e-4,
        element_nx=_pairs("P2 24", "P2 32", "P2 48"),
    ),
    *varied("integration", **INNER, pattern_nx=REDUCED_NX),
    *varied(
        "integration", **INNER, pattern="unstructured", nx=[33, 50], steps=15, path_tolerance=1e-2
    ),
    *varied("integration", **INNER, pattern="unstructured", nx=50, steps=20, path_tolerance=1e-3),
    *varied("steps", steps=[1, 5, 10, 40]),
    *varied("tolerance", tolerance=[1e-2, 1e-11]),
    *varied("path", path_tolerance=[1e-2, 1e-3]),
    *varied("solver", linear_solver=["mumps-lu", "cg-gamg", "cg-hypre"]),
    *varied("ranks", ranks=2),
    *(
        change
        for tolerance, steps, meshes in (
            (1e-2, 5, ["P1 24", "P2 12"]),
            (1e-3, 5, ["P1 24", "P2 12", "P2 24"]),
            (1e-3, 10, ["P1 24", "P2 12", "P2 48", "P3 16"]),
            (1e-2, 20, ["P1 120", "P2 48"]),
            (1e-3, 20, LEAN_20),
            (1e-4, 20, ["P2 12", "P2 24", "P2 32"]),
        )
        for change in varied(
            "lean", path_tolerance=tolerance, steps=steps, element_nx=_pairs(*meshes)
        )
    ),
]
SIZES = [
    *varied(
        "size", nx=[96, 208, 448, 1000], linear_solver=["mumps-cholesky", "cg-gamg", "cg-hypre"]
    ),
    *varied("size", nx=[96, 448], ranks=2),
]
FORMING = [
    *varied("mesh", element_nx=_pairs("P1 12", "P1 24", "P1 47", "P2 6", "P2 12", "P2 24")),
    *varied("steps", steps=[20, 80]),
]
QUICK_SIZES = [*varied("size", nx=[24, 48]), *varied("size", nx=48, ranks=2)]


def plan(scenes: list[str], quick: bool) -> list[Configuration]:
    """The runs of each of the strips `scenes`, the baseline first."""
    runs = []
    for scene in scenes:
        base = Configuration(scene, nx=24, steps=5) if quick else Configuration(scene)
        runs += [base, *(replace(base, **change) for change in (QUICK if quick else FULL))]
    return runs


def plan_sizes(quick: bool) -> list[Configuration]:
    """The sizes and solvers of which one tangent and its solution are measured."""
    base = Configuration("tensile", "size", steps=0)
    return [replace(base, **change) for change in (QUICK_SIZES if quick else SIZES)]


def plan_forming(angles: Iterable[float], quick: bool) -> list[Configuration]:
    """Runs of the double dome with yarns at each of the `angles` [deg], with the element that is
    the default there; the baseline first, a finer run as a reference last."""
    runs = []
    for angle in angles:
        element, finest = ("P2", 47) if angle % 45 else ("P1", 94)
        base = Configuration(
            f"{angle:g} deg", element=element, nx=24, steps=40, path_tolerance=1e-6
        )
        base, changes = replace(base, fibre_angle=angle), [*FORMING, *varied("finest", nx=finest)]
        if quick:
            base, changes = replace(base, nx=6, steps=8), [*varied("finest", nx=8)]
        varying = (replace(base, **change) for change in changes)
        runs += [base, *(c for c in varying if str(c) != str(base))]
    return runs
