"""Hard cases of the solver: each must end in a true local minimum of the energy, or in a plain
reason."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.optimize import brentq

from fabric_fenicsx.material import stability
from fabric_fenicsx.material.laws.coupled import WovenFabric
from fabric_fenicsx.mechanics.load import DeadPressure
from fabric_fenicsx.mechanics.shell.membrane import Membrane
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.results import measures
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.scene.supports import Support, clamped_ends, frame, on_edge, rolling_ends
from fabric_fenicsx.sheets.blank import Blank

from .audited_run import AuditedRun

SQUEEZE = -0.005  # eps_b of the frame in which bands are looked for
COSINE, SINE = math.cos(0.3), math.sin(0.3)
# out of any plane z = const, so that a blank becomes a manifold in space
TILT = np.array([[1, 0, 0], [0, COSINE, -SINE], [0, SINE, COSINE]])
TILTED: dict[str, Any] = {"warp": lambda x: x @ TILT.T, "frame": TILT.T, "up": TILT[:, 2]}


@dataclass(frozen=True)
class Setting:
    """What all cases share: ranks, fabric, the law's integration, and whether coarser meshes do."""

    comm: MPI.Comm
    fabric: WovenFabric
    integration: str = "full"
    quick: bool = False

    def blank(
        self,
        length: float = 200.0,
        width: float = 50.0,
        nx: int = 40,
        ny: int | None = None,
        angle: float = 0.0,
        pattern: str = "crossed",
        warp: Callable[[np.ndarray], np.ndarray] | None = None,
        **options: Any,
    ) -> Blank:
        """Rectangle of nx x ny cells (ny: as makes them square) with yarns a at `angle` [deg];
        warp: of the points (n, 3); options: of `Blank`."""
        arrays: tuple[Any, Any, Any] = (None, None, None)
        if self.comm.rank == 0:
            across = ny or max(1, round(nx * width / length))
            points, cells, kind = specimen(length, width, nx, across, pattern)
            arrays = (warp(points) if warp else points), cells, kind
        return Blank.from_arrays(self.comm, *arrays, a=math.radians(angle), **options)

    def membrane(self, fabric: WovenFabric | None = None) -> Membrane:
        """Membrane of `blank`, of the setting's fabric or of `fabric`."""
        return Membrane(fabric or self.fabric, integration=self.integration)

    def pulled(
        self,
        strain: float = 0.03,
        fabric: WovenFabric | None = None,
        clamped: bool = True,
        steps: int = 20,
        **shape: Any,
    ) -> AuditedRun:
        """A strip pulled to `strain` by grips; shape: of `blank`."""
        blank = self.blank(**shape)
        low, high = blank.extent()
        ends = clamped_ends if clamped else rolling_ends
        supports = ends(strain * (high - low)[0])
        return AuditedRun(Scene(blank, [self.membrane(fabric)], supports), steps)

    def in_frame(
        self,
        deformation: Callable[[float], np.ndarray],
        nx: int,
        fabric: WovenFabric | None = None,
        steps: int = 20,
        **options: Any,
    ) -> AuditedRun:
        """A square of 50 mm whose edge follows `deformation` (2, 2) of the load; options: of
        `AuditedRun`."""
        blank = self.blank(50, 50, nx)
        scene = Scene(blank, [self.membrane(fabric)], frame(deformation))
        return AuditedRun(scene, steps, **options)


class Found(NamedTuple):
    """Runs of a case, whether it holds as far as they are sound, and what was found in words."""

    runs: list[AuditedRun]
    holds: bool
    words: str


def reached_words(runs: list[AuditedRun]) -> str:
    """How far the runs came, in words."""
    return ", ".join(f"{100 * run.outcome.reached:.0f} %" for run in runs) + " of the load"


def bias_to_the_end(s: Setting) -> Found:
    """bias extension to 45 % and on: sound states up to a plain reason; 60 deg of shear are
    passed"""
    run = s.pulled(0.6, angle=45, steps=60)
    shear = math.degrees(run.largest(run.shear))
    reached = f"{100 * 0.6 * run.outcome.reached:.1f} % reached"
    return Found(
        [run], run.ended_plainly and shear > 60, f"{reached}, shear {shear:.1f} deg; {run.ending}"
    )


def squeezed(
    s: Setting, fabric: WovenFabric, largest: float, nx: int
) -> tuple[AuditedRun, float, float]:
    """A frame squeezed to eps_b = SQUEEZE and then drawn to eps_a = `largest`; eps_a of the first
    band, inf without one; width of bands [mm]."""
    first = [math.inf]

    def deformation(load):
        drawn, pressed = max(0.0, (load - 0.1) / 0.9), min(1.0, load / 0.1)
        return np.diag([1 + largest * drawn, 1 + SQUEEZE * pressed])

    def note(run, accepted):
        if accepted.load and run.spread_of_eps_b() > 1e-5:
            first[0] = min(first[0], deformation(accepted.load)[0, 0] - 1)

    run = s.in_frame(deformation, nx, fabric, 30, milestones=(0.1,), on_accept=note)
    eps_b = run.eps_b.mean(1)
    in_band = eps_b < (SQUEEZE - run.largest(eps_b)) / 2
    share = measures.mean(s.comm, in_band * 1.0, np.ones(len(eps_b)))
    assert share is not None
    return run, first[0], share * 50**2 / math.hypot(50, 50)


def tension_compression_bands(s: Setting) -> Found:
    """tensile with p_min = 0, 0.1, 0.25, 0.75: bands for 0 only; in a squeezed frame from the
    strain on where the map has them"""
    runs, words, good = [], [], True
    for p_min in (0.0, 0.1, 0.25, 0.75):
        run = s.pulled(0.03, s.fabric.replace(p_min=p_min), clamped=False, nx=24)
        spread = run.spread_of_eps_b()
        good &= run.reached and (spread > 1e-2 if p_min == 0 else spread < 1e-6)
        words.append(f"pulled, p_min {p_min}: spread of eps_b {spread:.2g}")
        runs.append(run)
    for p_min in (0.0, 0.1, 0.25, 0.4):
        fabric = s.fabric.replace(p_min=p_min)

        def ellipticity(e, fabric=fabric):
            return stability.evaluate(fabric, stability.invariants(e, SQUEEZE)).ellipticity

        e = np.linspace(1e-6, 0.03, 500)
        k = (ellipticity(e) < 0).argmax()
        lost = brentq(ellipticity, e[k - 1], e[k]) if k else math.nan
        found = [squeezed(s, fabric, 2.5 * lost if lost > 0 else 0.02, nx) for nx in (12, 24)]
        runs += [run for run, *_ in found]
        (_, coarse, width), (_, fine, finer_width) = found
        good &= all(run.reached for run, *_ in found)
        if lost > 0:
            good &= lost <= fine <= coarse and fine < 1.5 * lost
            words.append(
                f"squeezed, p_min {p_min}: map {100 * lost:.3f} %, bands from {100 * coarse:.3f} % "
                f"on 12 and {100 * fine:.3f} % on 24 rectangles, "
                f"{width:.2g} and {finer_width:.2g} mm wide"
            )
        else:
            good &= math.isinf(min(coarse, fine))
            some = "none" if math.isinf(fine) else "some"
            words.append(f"squeezed, p_min {p_min}: none on the map, {some} found")
    return Found(runs, bool(good), "; ".join(words))


def biaxial_beyond_convexity(s: Setting) -> Found:
    """biaxial tension to 8 % with p_min = 0.5 and 0.75: sound states"""

    def stretched(load):
        return np.eye(2) * (1 + 0.08 * load)

    fabrics = [s.fabric.replace(p_min=p_min) for p_min in (0.5, 0.75)]
    runs = [s.in_frame(stretched, 20, fabric, 16) for fabric in fabrics]
    return Found(
        runs, all(run.ended_plainly for run in runs), "; ".join(run.ending for run in runs)
    )


def in_plane_compression(s: Setting) -> Found:
    """a clamped sheet compressed to -20 %, E_C = 2 d from 0.13 to 1300 MPa: sound states"""
    fabrics = [s.fabric.replace(d=E_C / 2) for E_C in (0.13, 1.3, 13.0, 130.0, 1300.0)]
    runs = [s.pulled(-0.2, fabric, length=50, nx=16) for fabric in fabrics]
    return Found(runs, all(run.ended_plainly for run in runs), reached_words(runs))


def compression_and_shear(s: Setting) -> Found:
    """compression by 10 % with shear to 20 deg in a frame, s_C from 10 to 1000: sound states"""

    def sheared(load):
        angle = 0.35 * load
        return (1 - 0.1 * load) * np.array([[1, math.sin(angle)], [0, math.cos(angle)]])

    fabrics = [s.fabric.replace(s_C=s_C) for s_C in (10.0, 100.0, 1000.0)]
    runs = [s.in_frame(sheared, 16, fabric) for fabric in fabrics]
    return Found(runs, all(run.ended_plainly for run in runs), reached_words(runs))


def huge_steps(s: Setting) -> Found:
    """the whole load in one step and in steps ten times the default: the same state to 1e-6"""
    tests, counts = ((0.03, 0), (0.1, 45)), (1, 2, 20)
    runs = [s.pulled(e, angle=angle, steps=n) for e, angle in tests for n in counts]
    gaps = [abs(run.energy / runs[3 * (k // 3) + 2].energy - 1) for k, run in enumerate(runs)]
    holds = all(run.reached for run in runs) and max(gaps) < 1e-6
    return Found(runs, holds, f"largest difference in energy {max(gaps):.1e}")


def noise(x: np.ndarray) -> np.ndarray:
    """Numbers from -0.5 to 0.5, (n, 2), at places x (n, 3) [mm]: without order, but the same on any
    number of ranks."""
    places = x[:, :2].round(6)
    phases = places @ [[12.9898, 39.3468], [78.233, 11.1351]]
    return (43758.5453 * np.sin(phases)) % 1.0 - 0.5


def perturbed_start(s: Setting) -> Found:
    """start from a random perturbation of 10 % of the cell size: the same state to 1e-6"""
    plain, blank = s.pulled(), s.blank()
    scene = Scene(blank, [s.membrane()], clamped_ends(6.0))
    blank.u.x.array[:] = noise(blank.coordinates()).ravel()
    scene.u.array[scene.fixed_dofs] = 0
    scene.set(scene.u.copy())
    run = AuditedRun(scene)
    gap = abs(run.energy / plain.energy - 1)
    return Found([plain, run], run.reached and gap < 1e-6, f"difference in energy {gap:.1e}")


def bad_cells(s: Setting) -> Found:
    """cells of aspect 50 and angles of 5 deg, yarns at every 15 deg: whole load, sound states"""
    shapes = {"nx": 4, "ny": 50, "width": 50}, {"nx": 23, "ny": 66, "pattern": "left"}
    angles = range(0, 90, 15)
    runs = [s.pulled(0.02, angle=a, steps=10, **shape) for shape in shapes for a in angles]
    reached = sum(run.reached for run in runs)
    return Found(runs, reached == len(runs), f"{reached} of {len(runs)} reached the load")


def slack_membrane(s: Setting) -> Found:
    """a flat clamped 3D membrane without pretension under transverse pressure: sound states"""
    blank = s.blank(100, 100, 12, **TILTED)
    terms: list[Any] = [s.membrane(), DeadPressure(0.01, TILT[:, 2])]
    run = AuditedRun(Scene(blank, terms, [Support("edge", on_edge(blank), (0, 1, 2))]), 10)
    rise = run.largest(blank.u.x.array.reshape(-1, 3)[:, 2])
    return Found([run], run.reached and rise > 1, f"rises by {rise:.3g} mm; {run.ending}")


def compressed_strip_in_space(s: Setting) -> Found:
    """a 3D strip shortened by 1 %: it leaves its plane, or a plain reason"""
    # folds without bending are as fine as the mesh, and as many iterations
    nx = 8 if s.quick else 16
    blank = s.blank(100, 25, nx, **TILTED)
    run = AuditedRun(Scene(blank, [s.membrane()], clamped_ends(-1.0)), 10)
    out = run.largest(blank.u.x.array.reshape(-1, 3)[:, 2])
    return Found([run], run.ended_plainly, f"out of plane by {out:.3g} mm; {run.ending}")


def scaled_parameters(s: Setting) -> Found:
    """p_min, d and s1 scaled by 1e-3 and 1e3 (p_min to 1 at most): sound states up to a plain
    reason"""
    fabric, words = s.fabric, []
    runs: list[AuditedRun] = []
    given = {"p_min": fabric.warp.p_min, "d": fabric.warp.d, "s1": fabric.s1}
    for name, value in given.items():
        for factor in (1e-3, 1e3):
            scaled = min(value * factor, 1.0) if name == "p_min" else value * factor
            changed = fabric.replace(**{name: scaled})
            pair = s.pulled(0.03, changed, nx=24), s.pulled(0.1, changed, angle=45, nx=24)
            runs += pair
            first, second = (f"{100 * run.outcome.reached:.0f}" for run in pair)
            words.append(f"{name} x {factor:g}: {first} and {second} %")
    return Found(runs, all(run.ended_plainly for run in runs), "; ".join(words))


def scales(s: Setting) -> Found:
    """thickness 1e-3 and lengths times 1e3 and 1e-3: results scale to 1e-8"""

    def force(run):
        return run.scene.reaction("moving grip")[0]

    base = s.pulled(nx=24)
    thin = s.pulled(fabric=s.fabric.replace(thickness=1e-3 * s.fabric.thickness), nx=24)
    runs, gaps = [base, thin], [abs(force(thin) / (1e-3 * force(base)) - 1)]
    for scale in (1e3, 1e-3):
        runs.append(s.pulled(length=200 * scale, width=50 * scale, nx=24))
        gaps.append(abs(force(runs[-1]) / (scale * force(base)) - 1))
    holds = all(run.reached for run in runs) and max(gaps) < 1e-8
    return Found(runs, holds, f"largest difference {max(gaps):.1e}")


def load_and_unload(s: Setting) -> Found:
    """cyclic load and unload: back at the start to 1e-8 of the length"""
    runs, ends = [], []
    for angle, stroke in ((0, 6.0), (45, 20.0)):
        blank = s.blank(angle=angle)
        fixed, moving = clamped_ends(stroke)(blank)

        def there_and_back(x, load, stroke=stroke):
            return np.outer([stroke * min(2 * load, 2 - 2 * load), 0], np.ones(x.shape[1]))

        cycle = Support(moving.name, moving.where, moving.components, there_and_back)
        runs.append(AuditedRun(Scene(blank, [s.membrane()], [fixed, cycle]), 40))
        ends.append(runs[-1].largest(runs[-1].u) / 200)
    holds = all(run.reached for run in runs) and max(ends) < 1e-8
    return Found(runs, holds, f"left over {max(ends):.1e} of the length")


def at_height(y: float) -> Callable[[np.ndarray], np.ndarray]:
    """Function of places (3, n) that tells which lie at the height `y` [mm]."""
    return lambda x: np.abs(x[1] - y) < 1e-6


def reversed_shear(s: Setting) -> Found:
    """sheared one way and the other: mirror images to 1e-10"""
    runs = []
    for sign in (1, -1):
        blank = s.blank(50, 50, 12, pattern="crossed")
        low, high = blank.extent()
        supports = [
            Support("bottom", at_height(low[1]), (0, 1)),
            Support("top", at_height(high[1]), (0, 1), (sign * 15.0, 0.0)),
        ]
        scene = Scene(blank, [s.membrane()], supports)
        runs.append(AuditedRun(scene, 20, tolerance=1e-11))
    energies = abs(runs[0].energy / runs[1].energy - 1)
    mirrored = []
    for run, sign in zip(runs, (1, -1)):
        x = run.scene.blank.coordinates()[: len(run.u), :2]
        place, u = [25 + sign * (x[:, 0] - 25), x[:, 1]], [sign * run.u[:, 0], run.u[:, 1]]
        rows = np.concatenate(s.comm.allgather(np.column_stack([*place, *u]))).round(12)
        mirrored.append(rows[np.lexsort(rows[:, :2].round(6).T)])
    gap = np.abs(mirrored[0] - mirrored[1]).max() / 15
    holds = all(run.reached for run in runs) and max(gap, energies) < 1e-10
    return Found(runs, holds, f"energies differ by {energies:.1e}, displacements by {gap:.1e}")


CASES: dict[str, Callable[[Setting], Found]] = {
    "a": bias_to_the_end,
    "b": tension_compression_bands,
    "c": biaxial_beyond_convexity,
    "d": in_plane_compression,
    "e": compression_and_shear,
    "f": huge_steps,
    "g": perturbed_start,
    "h": bad_cells,
    "i": slack_membrane,
    "j": compressed_strip_in_space,
    "k": scaled_parameters,
    "l": scales,
    "m": load_and_unload,
    "n": reversed_shear,
}


def run_case(letter: str, setting: Setting) -> dict[str, Any]:
    """Run a case of CASES; its row of the table. A case's docstring is what must hold."""
    case, began = CASES[letter], time.perf_counter()
    runs, holds, words = case(setting)
    faults = [fault for run in runs for fault in run.faults]
    return {
        "case": letter,
        "must_hold": " ".join((case.__doc__ or "").split()),
        "holds": bool(holds and not faults),
        "found": words,
        "faults": faults,
        "runs": len(runs),
        "steps": sum(run.outcome.accepted for run in runs),
        "rejected": sum(run.outcome.rejected for run in runs),
        "iterations": sum(run.outcome.iterations for run in runs),
        "wall_s": round(time.perf_counter() - began, 2),
    }
