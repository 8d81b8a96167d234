"""Hard cases of the solver: each must end in a true local minimum of the energy, or in a plain reason."""

import math
import textwrap
import time

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from fabric_fenicsx.blank import Blank
from fabric_fenicsx.errors import InputError, SolverFailure
from fabric_fenicsx.material import stability
from fabric_fenicsx.mechanics.load import DeadPressure
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.scene import Scene, Support, edge_of, framed, grips
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.stepping import march
from fabric_fenicsx.study import parser
from fabric_fenicsx.study import run as run_study

TOLERANCE = 1e-8
SQUEEZE = -0.005  # eps_b of the frame in which bands are looked for
# out of any plane z = const, so that a blank becomes a manifold in space
TILT = np.array([[1, 0, 0], [0, math.cos(0.3), -math.sin(0.3)], [0, math.sin(0.3), math.cos(0.3)]])


class Run:
    """A scene marched to its end. `faults` names accepted states whose residual, assembled anew, is above the tolerance
    or whose tangent, factored anew, has negative pivots."""

    def __init__(self, scene, steps=20, tolerance=TOLERANCE, **options):
        self.scene, self.comm, self.faults = scene, scene.comm, []
        self.size = np.ptp(scene.blank.extent(), axis=0).max()
        self.newton = Newton(scene, tolerance)
        self.outcome = march(self.newton, steps, on_accept=self._accept, **options)
        self.energy = scene.energy()

    def _accept(self, accepted):
        if accepted.load == 0:
            return
        newton, scene = self.newton, self.scene
        r, correction = scene.u.duplicate(), scene.u.duplicate()
        scene.residual(r)
        scene.tangent(newton.A)
        norm, scale = r.norm(), scene.force_scale()
        newton.snes.ksp.setOperators(newton.A)
        newton.snes.ksp.solve(r, correction)
        rounding = 2.0**-52 * self.size * newton.A.getDiagonal().norm()  # of positions, through the tangent
        at_rounding = norm <= rounding or correction.norm(PETSc.NormType.NORM_INFINITY) <= 1e-14 * self.size
        if norm > newton.tolerance * scale and not at_rounding:
            self.faults.append(f"residual {norm:.1e} N of {scale:.1e} N at load {accepted.load:.4g}")
        negative = newton.snes.ksp.pc.getFactorMatrix().getInertia()[0]
        if negative:
            self.faults.append(
                f"{negative} negative pivots ({accepted.report.negative_pivots} told) at load {accepted.load:.4g}"
            )

    @property
    def reached(self):
        return not self.outcome.reason

    @property
    def u(self):
        """Displacement of this rank's owned nodes, (nodes, gdim) [mm]."""
        owned = self.scene.blank.V.dofmap.index_map.size_local
        return self.scene.blank.nodal_displacement()[:owned]

    def largest(self, values):
        return self.comm.allreduce(float(np.abs(values).max(initial=0.0)), MPI.MAX)


def blank_of(study, length=200.0, width=50.0, nx=40, ny=None, angle=0.0, pattern="crossed", warp=None, **options):
    arrays = (None, None, None)
    if study.comm.rank == 0:
        points, cells, kind = specimen(length, width, nx, ny or max(1, round(nx * width / length)), pattern)
        arrays = (warp(points) if warp else points), cells, kind
    return Blank.from_arrays(study.comm, *arrays, a=math.radians(angle), **options)


def pull(study, strain=0.03, fabric=None, angle=0.0, clamped=True, steps=20, march_options=None, **shape):
    blank = blank_of(study, angle=angle, **shape)
    low, high = blank.extent()
    scene = Scene(blank, [study.membrane(blank, fabric)], grips(blank, strain * (high - low)[0], clamped))
    return Run(scene, steps, **(march_options or {}))


def shear_of(run):
    return run.scene.terms[0].state()[0].invariants[:, :, 3]


def strains_of(run):
    return np.sqrt(run.scene.terms[0].state()[0].invariants[:, :, (0, 2)]) - 1


def a_bias_to_the_end(study):
    """bias extension to 45 % and on: sound states up to a plain reason; 60 deg of shear are passed"""
    run = pull(study, 0.6, angle=45, steps=60)
    shear = math.degrees(run.largest(shear_of(run)))
    ended = run.reached or bool(run.outcome.reason)
    return (
        [run],
        ended and shear > 60,
        f"{100 * 0.6 * run.outcome.reached:.1f} % reached, shear {shear:.1f} deg; {run.outcome.reason or 'whole load'}",
    )


def spread_of_eps_b(run):
    eps_b = strains_of(run)[:, :, 1]
    return run.comm.allreduce(eps_b.max(initial=-1.0), MPI.MAX) + run.comm.allreduce(-eps_b.min(initial=0.0), MPI.MAX)


def squeezed(study, fabric, largest, nx):
    """A frame squeezed to eps_b = SQUEEZE and then drawn to eps_a = `largest`; eps_a of the first band, width of bands [mm]."""
    first = [math.inf]

    def deformation(load):
        return np.diag([1 + largest * max(0.0, (load - 0.1) / 0.9), 1 + SQUEEZE * min(1.0, load / 0.1)])

    class Watched(Run):
        def _accept(self, accepted):
            super()._accept(accepted)
            if accepted.load and spread_of_eps_b(self) > 1e-5:
                first[0] = min(first[0], deformation(accepted.load)[0, 0] - 1)

    blank = blank_of(study, 50, 50, nx)
    run = Watched(Scene(blank, [study.membrane(blank, fabric)], framed(blank, deformation)), 30, milestones=(0.1,))
    eps_b = strains_of(run)[:, :, 1].mean(1)
    in_band = eps_b < (SQUEEZE - run.largest(eps_b)) / 2
    area = study.mean(np.ones(len(eps_b)) * in_band, np.ones(len(eps_b), bool)) * 50**2
    return run, first[0], area / math.hypot(50, 50)


def b_tension_compression_bands(study):
    """tensile with p_min = 0, 0.1, 0.25, 0.75: bands for 0 only; in a squeezed frame from the strain on where the map has them"""
    runs, words, good = [], [], True
    for p_min in (0.0, 0.1, 0.25, 0.75):
        run = pull(study, 0.03, study.fabric.replace(p_min=p_min), clamped=False, steps=20, nx=24)
        spread = spread_of_eps_b(run)
        good &= run.reached and (spread > 1e-2 if p_min == 0 else spread < 1e-6)
        words.append(f"pulled, p_min {p_min}: spread of eps_b {spread:.2g}")
        runs.append(run)
    for p_min in (0.0, 0.1, 0.25, 0.4):
        fabric = study.fabric.replace(p_min=p_min)
        lost = stability.first_loss(
            lambda e, fabric=fabric: stability.evaluate(fabric, stability.invariants(e, SQUEEZE)).ellipticity,
            1e-6,
            0.03,
        )[0]
        found = [squeezed(study, fabric, 2.5 * lost if lost > 0 else 0.02, nx) for nx in (12, 24)]
        runs += [run for run, *_ in found]
        coarse, fine = (first for _, first, _ in found)
        good &= all(run.reached for run, *_ in found)
        if lost > 0:
            good &= lost <= fine <= coarse and fine < 1.5 * lost
            words.append(
                f"squeezed, p_min {p_min}: map {100 * lost:.3f} %, bands from {100 * coarse:.3f} % on 12 and {100 * fine:.3f} % on 24 rectangles, "
                f"{found[0][2]:.2g} and {found[1][2]:.2g} mm wide"
            )
        else:
            good &= math.isinf(min(coarse, fine))
            words.append(f"squeezed, p_min {p_min}: none on the map, {'none' if math.isinf(fine) else 'some'} found")
    return runs, good, "; ".join(words)


def c_biaxial_beyond_convexity(study):
    """biaxial tension to 8 % with p_min = 0.5 and 0.75: sound states"""
    runs = []
    for p_min in (0.5, 0.75):
        blank = blank_of(study, 50, 50, 20)
        scene = Scene(
            blank,
            [study.membrane(blank, study.fabric.replace(p_min=p_min))],
            framed(blank, lambda s: np.eye(2) * (1 + 0.08 * s)),
        )
        runs.append(Run(scene, 16))
    return (
        runs,
        all(run.reached or run.outcome.reason for run in runs),
        "; ".join(run.outcome.reason or "whole load" for run in runs),
    )


def d_in_plane_compression(study):
    """a clamped sheet compressed to -20 %, E_C = 2 d from 0.13 to 1300 MPa: sound states"""
    runs = []
    for E_C in (0.13, 1.3, 13.0, 130.0, 1300.0):
        run = pull(study, -0.2, study.fabric.replace(d=E_C / 2), length=50, nx=16)
        runs.append(run)
    return (
        runs,
        all(run.reached or run.outcome.reason for run in runs),
        ", ".join(f"{100 * run.outcome.reached:.0f} %" for run in runs) + " of the load",
    )


def e_compression_and_shear(study):
    """compression by 10 % with shear to 20 deg in a frame, s_C from 10 to 1000: sound states"""

    def sheared(load):
        return (1 - 0.1 * load) * np.array([[1, math.sin(0.35 * load)], [0, math.cos(0.35 * load)]])

    runs = []
    for s_C in (10.0, 100.0, 1000.0):
        blank = blank_of(study, 50, 50, 16)
        runs.append(Run(Scene(blank, [study.membrane(blank, study.fabric.replace(s_C=s_C))], framed(blank, sheared))))
    return (
        runs,
        all(run.reached or run.outcome.reason for run in runs),
        ", ".join(f"{100 * run.outcome.reached:.0f} %" for run in runs) + " of the load",
    )


def f_huge_steps(study):
    """the whole load in one step and in steps ten times the default: the same state to 1e-6"""
    runs = [
        pull(study, strain, angle=angle, steps=steps)
        for strain, angle in ((0.03, 0), (0.1, 45))
        for steps in (1, 2, 20)
    ]
    gaps = [abs(run.energy / runs[3 * (k // 3) + 2].energy - 1) for k, run in enumerate(runs)]
    return runs, all(run.reached for run in runs) and max(gaps) < 1e-6, f"largest difference in energy {max(gaps):.1e}"


def g_perturbed_start(study):
    """start from a random perturbation of 10 % of the cell size: the same state to 1e-6"""
    plain = pull(study)
    blank = blank_of(study)
    scene = Scene(blank, [study.membrane(blank)], grips(blank, 6.0))
    blank.u.x.array[:] = np.random.default_rng(study.comm.rank).uniform(-0.5, 0.5, len(blank.u.x.array))
    scene.u.array[scene.held] = 0
    scene.set(scene.u.copy())
    run = Run(scene)
    gap = abs(run.energy / plain.energy - 1)
    return [plain, run], run.reached and gap < 1e-6, f"difference in energy {gap:.1e}"


def h_bad_cells(study):
    """cells of aspect 50 and angles of 5 deg, yarns at every 15 deg: whole load, sound states"""
    runs = []
    for shape in ({"nx": 4, "ny": 50, "width": 50}, {"nx": 23, "ny": 66, "pattern": "left"}):
        runs += [pull(study, 0.02, angle=angle, steps=10, **shape) for angle in range(0, 90, 15)]
    return runs, all(run.reached for run in runs), f"{sum(run.reached for run in runs)} of {len(runs)} reached the load"


def i_slack_membrane(study):
    """a flat clamped 3D membrane without pretension under transverse pressure: sound states"""
    blank = blank_of(study, 100, 100, 12, warp=lambda x: x @ TILT.T, frame=TILT.T, up=TILT[:, 2])
    scene = Scene(
        blank,
        [study.membrane(blank), DeadPressure(blank, 0.01, TILT[:, 2])],
        [Support("edge", edge_of(blank), (0, 1, 2))],
    )
    run = Run(scene, 10)
    rise = run.largest(blank.u.x.array.reshape(-1, 3)[:, 2])
    return [run], run.reached and rise > 1, f"rises by {rise:.3g} mm; {run.outcome.reason or 'whole load'}"


def j_compressed_strip_in_space(study):
    """a 3D strip shortened by 1 %: it leaves its plane, or a plain reason"""
    nx = 8 if study.args.quick else 16  # folds without bending are as fine as the mesh, and iterations as many
    blank = blank_of(study, 100, 25, nx, warp=lambda x: x @ TILT.T, frame=TILT.T, up=TILT[:, 2])
    scene = Scene(blank, [study.membrane(blank)], grips(blank, -1.0))
    run = Run(scene, 10)
    out = run.largest(blank.u.x.array.reshape(-1, 3)[:, 2])
    return (
        [run],
        run.reached or bool(run.outcome.reason),
        f"out of plane by {out:.3g} mm; {run.outcome.reason or 'whole load'}",
    )


def k_scaled_parameters(study):
    """p_min, d and s1 scaled by 1e-3 and 1e3 (p_min to 1 at most): sound states up to a plain reason"""
    fabric, runs, words = study.fabric, [], []
    for name in ("p_min", "d", "s1"):
        for factor in (1e-3, 1e3):
            value = (fabric.s1 if name == "s1" else getattr(fabric.warp, name)) * factor
            changed = fabric.replace(**{name: min(value, 1.0) if name == "p_min" else value})
            runs += [pull(study, 0.03, changed, nx=24), pull(study, 0.1, changed, angle=45, nx=24)]
            words += [
                f"{name} x {factor:g}: {100 * runs[-2].outcome.reached:.0f} and {100 * runs[-1].outcome.reached:.0f} %"
            ]
    return runs, all(run.reached or run.outcome.reason for run in runs), "; ".join(words)


def l_scales(study):
    """thickness 1e-3 and lengths times 1e3 and 1e-3: results scale to 1e-8"""
    base = pull(study, nx=24)
    force = base.scene.reaction("moving grip")[0]
    thin = pull(study, fabric=study.fabric.replace(thickness=1e-3 * study.fabric.thickness), nx=24)
    runs, gaps = [base, thin], [abs(thin.scene.reaction("moving grip")[0] / (1e-3 * force) - 1)]
    for scale in (1e3, 1e-3):
        run = pull(study, length=200 * scale, width=50 * scale, nx=24)
        runs.append(run)
        gaps.append(abs(run.scene.reaction("moving grip")[0] / (scale * force) - 1))
    return runs, all(run.reached for run in runs) and max(gaps) < 1e-8, f"largest difference {max(gaps):.1e}"


def m_load_and_unload(study):
    """cyclic load and unload: back at the start to 1e-8 of the length"""
    runs, ends = [], []
    for angle, stroke in ((0, 6.0), (45, 20.0)):
        blank = blank_of(study, angle=angle)
        fixed, moving = grips(blank, stroke)
        cycle = Support(
            moving.name,
            moving.where,
            moving.components,
            lambda x, s, d=stroke: np.outer([d * min(2 * s, 2 - 2 * s), 0], np.ones(x.shape[1])),
        )
        runs.append(Run(Scene(blank, [study.membrane(blank)], [fixed, cycle]), 40))
        ends.append(runs[-1].largest(runs[-1].u) / 200)
    return runs, all(run.reached for run in runs) and max(ends) < 1e-8, f"left over {max(ends):.1e} of the length"


def n_reversed_shear(study):
    """sheared one way and the other: mirror images to 1e-10"""
    runs = []
    for sign in (1, -1):
        blank = blank_of(study, 50, 50, 12, pattern="crossed")
        low, high = blank.extent()
        supports = [
            Support("bottom", lambda x, at=low[1]: np.abs(x[1] - at) < 1e-6, (0, 1)),
            Support("top", lambda x, at=high[1]: np.abs(x[1] - at) < 1e-6, (0, 1), (sign * 15.0, 0.0)),
        ]
        runs.append(Run(Scene(blank, [study.membrane(blank)], supports), 20, tolerance=1e-11))
    energies = abs(runs[0].energy / runs[1].energy - 1)
    mirrored = []
    for run, sign in zip(runs, (1, -1)):
        x = run.scene.blank.coordinates()[: len(run.u), :2]
        everything = np.concatenate(
            study.comm.allgather(
                np.column_stack([25 + sign * (x[:, 0] - 25), x[:, 1], sign * run.u[:, 0], run.u[:, 1]])
            )
        ).round(12)
        mirrored.append(everything[np.lexsort(everything[:, :2].round(6).T)])
    gap = np.abs(mirrored[0] - mirrored[1]).max() / 15
    return (
        runs,
        all(run.reached for run in runs) and max(gap, energies) < 1e-10,
        f"energies differ by {energies:.1e}, displacements by {gap:.1e}",
    )


CASES = {f.__name__[0]: f for f in (
    a_bias_to_the_end, b_tension_compression_bands, c_biaxial_beyond_convexity, d_in_plane_compression, e_compression_and_shear,
    f_huge_steps, g_perturbed_start, h_bad_cells, i_slack_membrane, j_compressed_strip_in_space, k_scaled_parameters, l_scales,
    m_load_and_unload, n_reversed_shear,
)}  # fmt: skip


def options():
    p = parser("hard_cases", __doc__, element="P1")
    p.add_argument_group("test").add_argument("--only", metavar="LETTERS", default="".join(CASES), help="cases to run")
    return p


def tried(study, letter):
    """The row of one case."""
    case, began = CASES[letter], time.perf_counter()
    runs, holds, words = case(study)
    faults = [fault for run in runs for fault in run.faults]
    return {
        "case": letter, "must_hold": case.__doc__, "holds": bool(holds and not faults), "found": words, "faults": faults,
        "runs": len(runs), "steps": sum(run.outcome.accepted for run in runs), "rejected": sum(run.outcome.rejected for run in runs),
        "iterations": sum(run.outcome.iterations for run in runs), "wall_s": round(time.perf_counter() - began, 2),
    }  # fmt: skip


def main(study):
    unknown = set(study.args.only) - set(CASES)
    if unknown:
        raise InputError(f"--only {study.args.only} names case {min(unknown)}; allowed are letters of {''.join(CASES)}")
    folder, rows = study.folder(), []
    for letter in study.args.only:
        row = study.once(letter, lambda: tried(study, letter))
        rows.append(row)
        study.say(
            f"{letter}  {'holds' if row['holds'] else 'FAILS'}  {row['wall_s']:7.1f} s  {row['steps']:4d} steps {row['rejected']:3d} rejected {row['iterations']:5d} iterations  {row['must_hold']}\n     {row['found']}{'; not sound: ' + '; '.join(row['faults'][:3]) if row['faults'] else ''}"
        )
    good = all(row["holds"] for row in rows)
    study.summarise(folder, converged=good, stroke_reached=1.0, quantities={row["case"]: row for row in rows})
    study.write_table(folder / "cases.csv", rows)
    if study.comm.rank == 0 and not study.args.no_pictures:
        from fabric_fenicsx.results import pictures

        effort = {
            f"{r['case']}  {textwrap.shorten(r['must_hold'].split(':')[0], 60, placeholder=' ...')}": (
                r["iterations"], f"{r['steps']} steps, {r['wall_s']:.0f} s", "#5aa469" if r["holds"] else "#b83a3a",
            )
            for r in rows
        }  # fmt: skip
        pictures.bars(folder / "cases.png", effort, "Newton iterations (green: holds)")
    if not good:
        raise SolverFailure(
            f"cases {', '.join(row['case'] for row in rows if not row['holds'])} do not hold; see {folder}/cases.csv"
        )


if __name__ == "__main__":
    run_study("hard_cases", options(), main)
