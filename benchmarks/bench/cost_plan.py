"""Which runs speed_vs_error.py compares: one factor at a time, varied from a baseline."""

from dataclasses import asdict, dataclass, replace


@dataclass(frozen=True)
class Configuration:
    """One run of the strip `scene`, or of forming, with yarns at `fibre_angle` [deg]; `mesh`:
    element, pattern and rectangles along the length."""

    scene: str
    mesh: str = "P1 crossed 96"
    integration: str = "full"
    steps: int = 20
    tolerance: float = 1e-8
    path_tolerance: float = 1e-5
    linear_solver: str = "mumps-cholesky"
    fibre_angle: float | None = None

    def __str__(self) -> str:
        return " ".join(str(v) for v in asdict(self).values() if v is not None)


def on(meshes, **more):
    """Changes of a `Configuration`, one a mesh: "P1 left 4 8, P2 left 4" are three."""
    kinds = (words.split() for words in meshes.split(","))
    return [{"mesh": f"{e} {pattern} {n}"} | more for e, pattern, *nx in kinds for n in nx]


OFF = "P1 {0} 133 66, P2 {0} 66 33, P3 {0} 42 21"
INNER = {"integration": "inner"}
QUICK = on("P1 crossed 48, P1 unstructured 48, P2 unstructured 24")
QUICK += [{"linear_solver": "cg-gamg"}]
FULL = [
    *on("P1 crossed 24 48 120 192, P2 crossed 12 24 48 96, P3 crossed 12 16 24 32"),
    *on("Q1 crossed 48 96, Q2 crossed 24 48, P1 left 150, P2 left 76, P3 left 50"),
    *on(f"{OFF.format('unstructured')}, {OFF.format('yarns')}"),
    *on("P1 graded 24 48 96, P2 graded 24 48", path_tolerance=1e-3),
    *on("P1 graded 48, P2 graded 24", steps=15, path_tolerance=1e-2),
    *on("P2 graded 24 32 48", path_tolerance=1e-4),
    *on("P2 left 76, P2 unstructured 33 66, P2 crossed 48, P2 graded 32", **INNER),
    *on("P2 unstructured 33 50", steps=15, path_tolerance=1e-2, **INNER),
    *on("P2 unstructured 50", path_tolerance=1e-3, **INNER),
    *({"steps": steps} for steps in (1, 5, 10, 40)),
    *({"tolerance": tolerance} for tolerance in (1e-2, 1e-11)),
    *({"path_tolerance": tolerance} for tolerance in (1e-2, 1e-3)),
    *({"linear_solver": solver} for solver in ("mumps-lu", "cg-gamg", "cg-hypre")),
    *on("P1 crossed 24, P2 crossed 12", steps=5, path_tolerance=1e-2),
    *on("P1 crossed 24, P2 crossed 12 24", steps=5, path_tolerance=1e-3),
    *on("P1 crossed 24, P2 crossed 12 48, P3 crossed 16", steps=10, path_tolerance=1e-3),
    *on("P1 crossed 120, P2 crossed 48", path_tolerance=1e-2),
    *on("P1 crossed 24 120, P2 crossed 12 24 48, P3 crossed 16 32", path_tolerance=1e-3),
    *on("P2 crossed 12 24 32", path_tolerance=1e-4),
]


def plan(scenes, quick):
    """The runs of each of the strips `scenes`, the baseline first."""
    changes = [{}, *(QUICK if quick else FULL)]
    quickly = {"mesh": "P1 crossed 24", "steps": 5} if quick else {}
    return [Configuration(scene, **quickly | change) for scene in scenes for change in changes]


def plan_forming(angles, quick):
    """Runs of the double dome with yarns at each of the `angles` [deg], the baseline, with the
    element that is the default there, first; a finer run as a reference last."""
    runs: list[Configuration] = []
    for angle in angles:
        kind, finest = ("P2 crossed", 47) if angle % 45 else ("P1 crossed", 94)
        nx, steps, last = (6, 8, 8) if quick else (24, 40, finest)
        base = Configuration(f"{angle:g} deg", f"{kind} {nx}", steps=steps, fibre_angle=angle)
        varied = on("P1 crossed 12 24 47, P2 crossed 6 12 24") + [{"steps": 20}, {"steps": 80}]
        changes = [{}, *([] if quick else varied), {"mesh": f"{kind} {last}"}]
        runs += dict.fromkeys(replace(base, path_tolerance=1e-6, **each) for each in changes)
    return runs
