"""Hard cases of the solver: each must end in a true local minimum of the energy, or in a plain
reason."""

import math
import time
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import fabric_fenicsx as ff
from fabric_fenicsx.material import stability
from fabric_fenicsx.results import measures
from fabric_fenicsx.scene.supports import on_edge
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.stepping import LoadStepping

SQUEEZE = -0.005  # eps_b of the frame in which bands are looked for


class AuditedRun:
    """A scene taken to its end: `outcome` there, `faults` of accepted states on the way. on_accept:
    is also called with this run and each load factor; options: of `Settings`."""

    def __init__(self, scene, on_accept=None, **options):
        self.scene, self.faults, self._on_accept = scene, list[str](), on_accept
        self.newton = Newton(scene, 1e-8)
        settings = Settings(path_tolerance=None, **options)
        self.outcome = LoadStepping(self.newton, settings, on_accept=self._audit).run()
        self.reached = not self.outcome.reason

    def _audit(self, accepted):
        """Name a residual, assembled anew, that is above the tolerance, and negative pivots of a
        tangent that is factorised anew."""
        scene, tangent, load = self.scene, self.newton.tangent, accepted.load
        if load:
            size = np.ptp(scene.blank.extent(), axis=0).max()
            r, correction = scene.u.duplicate(), scene.u.duplicate()
            scene.residual(r)
            tangent.assemble()
            norm, scale, negative = r.norm(), scene.force_scale(), tangent.negative_pivots()
            tangent.solve_with_last_factors(r, correction)
            # of positions, through the tangent
            rounding = 2.0**-52 * size * tangent.A.getDiagonal().norm()
            moved = correction.norm(PETSc.NormType.NORM_INFINITY)
            if norm > max(self.newton.tolerance * scale, rounding) and moved > 1e-14 * size:
                self.faults.append(f"residual {norm:.1e} N of {scale:.1e} N at load {load:.4g}")
            if negative:
                self.faults.append(f"{negative} negative pivots at load {load:.4g}")
        if self._on_accept:
            self._on_accept(self, load)

    def spread_of_eps_b(self):
        """Largest less smallest strain of yarns b on all ranks."""
        stretch = np.sqrt(self.scene.terms[0].invariants_at_points()[..., 2])
        return float(np.diff(measures.extremes(self.scene.comm, stretch))[0])

    def largest(self, values):
        """Largest magnitude of the `values` of all ranks; 0 of none."""
        return self.scene.comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)

    def displacement(self, *components):
        """Largest displacement of a node along these axes on all ranks [mm]."""
        owned = self.scene.blank.V.dofmap.index_map.size_local
        return self.largest(self.scene.blank.nodal_displacement()[:owned, components])


@dataclass(frozen=True)
class Setting:
    """What all cases share: ranks, fabric, the law's integration, and whether coarser meshes do."""

    comm: MPI.Comm
    fabric: ff.WovenFabric
    integration: str = "full"
    quick: bool = False

    def blank(self, length=200.0, width=50.0, nx=40, **more):
        """Rectangle of linear triangles."""
        return ff.Blank.rectangle(length, width, nx=nx, element="P1", comm=self.comm, **more)

    def scene(self, blank, supports, fabric=None, *terms):
        """Scene of a membrane of the setting's fabric, or of another."""
        membrane = ff.Membrane(fabric or self.fabric, integration=self.integration)
        return ff.Scene(blank, [membrane, *terms], supports)

    def pulled(self, strain=0.03, fabric=None, steps=20, **shape):
        """A strip pulled to `strain` by clamps; shape: of `blank`."""
        stroke = ff.clamped_ends(strain * shape.get("length", 200.0))
        return AuditedRun(self.scene(self.blank(**shape), stroke, fabric), steps=steps)

    def in_frame(self, deformation, nx, fabric, **options):
        """A square of 50 mm whose edge follows `deformation` (2, 2) of the load."""
        scene = self.scene(self.blank(50, 50, nx), ff.frame(deformation), fabric)
        return AuditedRun(scene, **options)


# A case returns its runs, whether it holds as far as they are sound, and what was found in words.
def sound(runs):
    """Found of runs that may end early, if that is said."""
    reached = (f"{100 * run.outcome.reached:.0f} %" for run in runs)
    reasons = {run.outcome.reason: 0 for run in runs if run.outcome.reason}
    return runs, True, "; ".join([f"{', '.join(reached)} of the load", *reasons])


def bias_to_the_end(s):
    """bias extension to 45 % and on: sound states up to a plain reason; 60 deg of shear are
    passed"""
    run = s.pulled(0.6, fibre_angle=45, steps=60)
    shear = math.degrees(run.largest(run.scene.terms[0].invariants_at_points()[..., 3]))
    words = f"{60 * run.outcome.reached:.1f} % reached, shear {shear:.1f} deg; {run.outcome.reason}"
    return [run], shear > 60, words


def squeezed(s, fabric, largest, nx):
    """A frame squeezed to eps_b = SQUEEZE and then drawn to eps_a = `largest`; eps_a of the first
    band, inf without one."""
    first = [math.inf]

    def deformation(load):
        drawn, pressed = max(0.0, (load - 0.1) / 0.9), min(1.0, load / 0.1)
        return np.diag([1 + largest * drawn, 1 + SQUEEZE * pressed])

    def note(run, load):
        if load and run.spread_of_eps_b() > 1e-5:
            first[0] = min(first[0], deformation(load)[0, 0] - 1)

    run = s.in_frame(deformation, nx, fabric, steps=30, milestones=(0.1,), on_accept=note)
    return run, first[0]


def tension_compression_bands(s):
    """tensile with p_min = 0, 0.1, 0.25, 0.75: bands for 0 only; in a squeezed frame from the
    strain on where the map has them"""
    runs, words, good = [], [], True
    for p_min in (0.0, 0.1, 0.25, 0.75):
        fabric, ends = s.fabric.replace(p_min=p_min), ff.rolling_ends(6.0)
        runs.append(run := AuditedRun(s.scene(s.blank(nx=24), ends, fabric)))
        spread = run.spread_of_eps_b()
        good &= run.reached and (spread > 1e-2 if p_min == 0 else spread < 1e-6)
        words.append(f"pulled, p_min {p_min}: spread of eps_b {spread:.2g}")
    strains = np.linspace(1e-6, 0.03, 30_000)
    for p_min in (0.0, 0.1, 0.25, 0.4):
        fabric = s.fabric.replace(p_min=p_min)
        found = stability.evaluate(fabric, stability.invariants(strains, SQUEEZE))
        is_lost = found.ellipticity < 0
        lost = float(strains[max(int(is_lost.argmax()) - 1, 0)]) if is_lost.any() else math.inf
        drawn = 2.5 * lost if is_lost.any() else 0.02
        pair, (coarse, fine) = zip(*(squeezed(s, fabric, drawn, nx) for nx in (12, 24)))
        runs += pair
        good &= all(run.reached for run in pair)
        good &= lost <= fine <= coarse and (fine < 1.5 * lost or fine == lost)
        words.append(
            f"squeezed, p_min {p_min}: map {100 * lost:.3f} %, bands from {100 * coarse:.3f} % "
            f"on 12 and {100 * fine:.3f} % on 24 rectangles"
        )
    return runs, bool(good), "; ".join(words)


def biaxial_beyond_convexity(s):
    """biaxial tension to 8 % with p_min = 0.5 and 0.75: sound states"""
    fabrics = [s.fabric.replace(p_min=p_min) for p_min in (0.5, 0.75)]
    return sound(
        [s.in_frame(lambda load: np.eye(2) * (1 + 0.08 * load), 20, f, steps=16) for f in fabrics]
    )


def in_plane_compression(s):
    """a clamped sheet compressed to -20 %, E_C = 2 d from 0.13 to 1300 MPa: sound states"""
    fabrics = [s.fabric.replace(d=E_C / 2) for E_C in (0.13, 1.3, 13.0, 130.0, 1300.0)]
    return sound([s.pulled(-0.2, fabric, length=50, nx=16) for fabric in fabrics])


def compression_and_shear(s):
    """compression by 10 % with shear to 20 deg in a frame, s_C from 10 to 1000: sound states"""

    def sheared(load):
        angle = 0.35 * load
        return (1 - 0.1 * load) * np.array([[1, math.sin(angle)], [0, math.cos(angle)]])

    fabrics = [s.fabric.replace(s_C=s_C) for s_C in (10.0, 100.0, 1000.0)]
    return sound([s.in_frame(sheared, 16, fabric) for fabric in fabrics])


def noise(x):
    """Numbers from -0.5 to 0.5, (n, 2), at places x (n, 3) [mm]: without order, but the same on any
    number of ranks."""
    phases = x[:, :2].round(6) @ [[12.9898, 39.3468], [78.233, 11.1351]]
    return (43758.5453 * np.sin(phases)) % 1.0 - 0.5


def perturbed_start(s):
    """start from a random perturbation of 10 % of the cell size: the same state to 1e-6"""
    plain, blank = s.pulled(), s.blank()
    scene = s.scene(blank, ff.clamped_ends(6.0))
    blank.u.x.array[:] = noise(blank.coordinates()).ravel()
    scene.u.array[scene.fixed_dofs] = 0
    scene.set(scene.u.copy())
    run = AuditedRun(scene)
    gap = abs(scene.energy() / plain.scene.energy() - 1)
    return [plain, run], run.reached and gap < 1e-6, f"difference in energy {gap:.1e}"


def bad_cells(s):
    """cells of aspect 50 and angles of 5 deg, yarns at every 15 deg: whole load, sound states"""
    shapes = {"nx": 4, "ny": 50, "width": 50}, {"nx": 23, "ny": 66, "pattern": "left"}
    angles = range(0, 90, 15)
    runs = [s.pulled(0.02, fibre_angle=a, steps=10, **shape) for shape in shapes for a in angles]
    reached = sum(run.reached for run in runs)
    return runs, reached == len(runs), f"{reached} of {len(runs)} reached the load"


def slack_membrane(s):
    """a flat clamped 3D membrane without pretension under transverse pressure: sound states"""
    blank = s.blank(100, 100, 12, spatial=True)
    edge = [ff.Support("edge", on_edge(blank), (0, 1, 2))]
    run = AuditedRun(s.scene(blank, edge, None, ff.DeadPressure(0.01, (0, 0, 1))), steps=10)
    rise = run.displacement(2)
    return [run], run.reached and rise > 1, f"rises by {rise:.3g} mm; {run.outcome.reason}"


def compressed_strip_in_space(s):
    """a 3D strip shortened by 1 %: it leaves its plane, or a plain reason"""
    # folds without bending are as fine as the mesh, and as many iterations
    blank = s.blank(100, 25, 8 if s.quick else 16, spatial=True)
    run = AuditedRun(s.scene(blank, ff.clamped_ends(-1.0)), steps=10)
    out = run.displacement(2)
    holds = out > 0.1 or not run.reached
    return [run], holds, f"out of plane by {out:.3g} mm; {run.outcome.reason}"


def scaled_parameters(s):
    """p_min, d and s1 scaled by 1e-3 and 1e3 (p_min to 1 at most): sound states up to a plain
    reason"""
    fabric, runs = s.fabric, list[AuditedRun]()
    given = {"p_min": fabric.warp.p_min, "d": fabric.warp.d, "s1": fabric.s1}
    for name, value in given.items():
        for scaled in (1e-3 * value, 1.0 if name == "p_min" else 1e3 * value):
            changed = fabric.replace(**{name: scaled})
            runs += [s.pulled(0.03, changed, nx=24), s.pulled(0.1, changed, nx=24, fibre_angle=45)]
    return sound(runs)


def scales(s):
    """thickness 1e-3 and lengths times 1e3 and 1e-3: results scale to 1e-8"""
    thin = s.fabric.replace(thickness=1e-3 * s.fabric.thickness)
    scaled = [(1.0, s.pulled(nx=24)), (1e-3, s.pulled(fabric=thin, nx=24))]
    scaled += [(k, s.pulled(length=200 * k, width=50 * k, nx=24)) for k in (1e3, 1e-3)]
    forces = [run.scene.reaction("moving grip")[0] / k for k, run in scaled]
    gap, runs = np.abs(np.array(forces) / forces[0] - 1).max(), [run for _, run in scaled]
    return runs, all(run.reached for run in runs) and gap < 1e-8, f"largest difference {gap:.1e}"


def load_and_unload(s):
    """cyclic load and unload: back at the start to 1e-8 of the length"""
    runs, ends = [], []
    for angle, stroke in ((0, 6.0), (45, 20.0)):
        blank = s.blank(fibre_angle=angle)
        fixed, moving = ff.clamped_ends(stroke)(blank)

        def there_and_back(x, load, stroke=stroke):
            return np.outer([stroke * min(2 * load, 2 - 2 * load), 0], np.ones(x.shape[1]))

        cycle = ff.Support(moving.name, moving.where, moving.components, there_and_back)
        runs.append(AuditedRun(s.scene(blank, [fixed, cycle]), steps=40))
        ends.append(runs[-1].displacement(0, 1) / 200)
    holds = all(run.reached for run in runs) and max(ends) < 1e-8
    return runs, holds, f"left over {max(ends):.1e} of the length"


ALL = (
    *(bias_to_the_end, tension_compression_bands, biaxial_beyond_convexity, in_plane_compression),
    *(compression_and_shear, perturbed_start, bad_cells, slack_membrane),
    *(compressed_strip_in_space, scaled_parameters, scales, load_and_unload),
)
CASES = dict(zip("abcdefghijkl", ALL))


def run_case(letter, setting):
    """Run a case of CASES; its row of the table. A case's docstring is what must hold."""
    case, began = CASES[letter], time.perf_counter()
    runs, holds, words = case(setting)
    faults = [fault for run in runs for fault in run.faults]
    return {
        "case": letter,
        "must_hold": " ".join(str(case.__doc__).split()),
        "holds": bool(holds and not faults),
        "found": words,
        "faults": faults,
        "steps": sum(run.outcome.accepted for run in runs),
        "iterations": sum(run.outcome.iterations for run in runs),
        "wall_s": round(time.perf_counter() - began, 2),
    }
