"""Newton and load stepping: every start, every angle, every solver, and a reason where it ends."""

import gc
import re
import weakref
from dataclasses import replace

import numpy as np
import pytest
import ufl
from builders import COMM, march, sheet
from mpi4py import MPI
from petsc4py import PETSc
from scipy.optimize import minimize

import fabric_fenicsx as ff
from fabric_fenicsx.solve import linear
from fabric_fenicsx.solve.linear import LINEAR_SOLVERS, is_there
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.progress import Viscosity
from fabric_fenicsx.solve.tangent import Preconditioner

KOMEILI = ff.load("komeili")
NO_MINIMUM = KOMEILI.replace(p_min=0.0)  # bands: the homogeneous state of a strip is none


def strip(angle=0.0, stroke=6.0, fabric=KOMEILI, ends=ff.clamped_ends, nx=16, further=(), **shape):
    blank = sheet(200.0, 50.0, nx, nx // 4, a=np.radians(angle), **shape)
    return ff.Scene(blank, [ff.Membrane(fabric), *further], ends(stroke))


def negative_pivots(newton):
    """Of the tangent at the present state, factored anew."""
    newton.tangent.assemble()
    return newton.tangent.negative_pivots()


@pytest.mark.mpi
@pytest.mark.versions
def test_orderings_of_the_factors():
    """PORD, which orders a strip, ends the process where all unknowns are coupled, as in one cell;
    the user's own options have a prefix."""
    cell = sheet(10.0, 10.0, 1, 1, "left", cell="quadrilateral")
    one = ff.Scene(cell, [ff.Membrane(KOMEILI)], ff.rolling_ends(0.1))
    crossed, bending = sheet(10, 10, 1, 1, spatial=True), ff.Bending(modulus=100.0)
    bent = ff.Scene(crossed, [ff.Membrane(KOMEILI), bending], ff.clamped_ends(0.1))
    options = PETSc.Options("fabric_")
    scenes = (strip(nx=4), None, 4), (one, None, 0), (bent, None, 0), (strip(nx=4), 6, 6)
    for scene, own, ordering in scenes:
        options.delValue("mat_mumps_icntl_7")
        if own:
            options["mat_mumps_icntl_7"] = own
        linear._users_options.cache_clear()
        newton = Newton(scene)
        assert newton.solve(newton.x).converged
        assert newton.tangent.ksp.pc.getFactorMatrix().getMumpsIcntl(7) == ordering
    options.delValue("mat_mumps_icntl_7")
    linear._users_options.cache_clear()


# the angle is a matter of points; one will do to see that ranks find the minimum
@pytest.mark.parametrize("angle", [pytest.param(30, marks=pytest.mark.mpi), 0, 10, 45, 60, 85])
def test_strips_with_yarns_at_every_angle(angle):
    shape = {"degree": 2, "pattern": "unstructured"} if angle % 30 else {}
    scene = strip(angle, **shape)
    newton = Newton(scene)
    outcome = march(newton, steps=4)
    assert outcome.reached == 1 and outcome.rejected == 0, outcome.reason
    assert newton.report.residuals[-1] <= 1e-8 * newton.report.scale
    assert negative_pivots(newton) == 0
    scene.set_load(1.01)  # a solve of few iterations is gone on with
    newton.x.array[scene.fixed_dofs] = scene.supports.values(1.01)
    report = newton.solve(newton.x, minimum=False, most=1)
    assert report.converged and report.residuals[-1] > newton.tolerance * report.scale
    assert newton.solve(newton.x).residuals[-1] <= newton.tolerance * newton.report.scale


@pytest.mark.versions
@pytest.mark.parametrize(
    "solver",
    [pytest.param(each, marks=pytest.mark.mpi) for each in LINEAR_SOLVERS if is_there(each)],
)
def test_linear_solvers_agree(solver):
    found = []
    for name in ("mumps-cholesky", solver):
        newton = Newton(scene := strip(), linear_solver=name)
        assert march(newton, steps=5).reached == 1
        found.append((scene.energy(), scene.reaction("moving grip")[0]))
    assert (newton.report.negative_pivots is None) == (solver != "mumps-cholesky")
    assert found[1] == pytest.approx(found[0], rel=1e-8)


@pytest.mark.versions
@pytest.mark.mpi
def test_no_saddle_is_accepted():
    newton, left = Newton(strip(fabric=NO_MINIMUM, ends=ff.rolling_ends)), []
    keep = lambda state: left.append(negative_pivots(newton) if state.load else 0)  # noqa: E731
    outcome = march(newton, steps=10, on_accept=keep)
    assert outcome.accepted > 0 and set(left) == {0} and (outcome.reached == 1 or outcome.reason)


@pytest.mark.versions
@pytest.mark.mpi
def test_inverted_cells_are_never_accepted():
    scene = strip(45, stroke=100.0)
    newton, turned = Newton(scene), []

    def accept(accepted):
        F, _, _ = scene.terms[0].at_points()
        turned.append(np.linalg.det(F[:, :, :2]).min(initial=1.0))

    outcome = march(newton, steps=10, on_accept=accept)
    assert min(turned) > 0
    assert outcome.reached == 1 or (outcome.reason and outcome.rejected > 0)


def test_a_run_that_the_law_ends_says_so():
    """Where it ends, waves of some direction lower the energy of the worst cell: by second
    differences of W."""
    scene = ff.Scene(sheet(50.0, 50.0, 6, 6), [ff.Membrane(KOMEILI)], ff.clamped_ends(-15.0))
    reason = march(Newton(scene), steps=10).reason
    told = re.search(r"inside out, where the law is unstable \(ellipticity (.*);", reason)
    assert told, reason

    def stiffness(angles, F, h=1e-4):
        """d2W along m N for angles of m and N (2, n), (n,)."""
        m, N = (np.stack([np.cos(x), np.sin(x)], -1) for x in angles)
        change = h * m[:, :, None] * N[:, None]

        def W(F):
            a, b = np.linalg.norm(F, axis=-2).T
            gamma = np.arctan2((F[..., 0] * F[..., 1]).sum(-1), np.linalg.det(F))
            return KOMEILI.derivatives(a - 1, b - 1, gamma, second=False).parts.sum(-1)

        return (W(F + change) + W(F - change) - 2 * W(np.tile(F, (len(m), 1, 1)))) / h**2

    grid, found = np.mgrid[0:60, 0:60].reshape(2, -1) * np.pi / 60, []
    for F in scene.terms[0].at_points()[0][:, 0, :2]:
        values = stiffness(grid, F)
        found.append((values.min(), tuple(grid[:, values.argmin()]), F.tolist()))
    least = min(
        minimize(lambda x, F=F: stiffness(x[:, None], np.array(F))[0], start, method="Powell").fun
        for _, start, F in sorted(found)[:6]
    )
    assert float(told[1]) == pytest.approx(least / KOMEILI.s1, rel=0.01)


class Brittle(Newton):
    """Fails without drag until the load is past a gate."""

    gate = (0.3, 0.5)

    def solve(self, x, *given, **named):
        report = super().solve(x, *given, **named)
        load = COMM.allreduce(x.array[self.scene.fixed_dofs].max(initial=0.0), MPI.MAX) / 6.0
        self.drags.append((load, self.scene.drag))
        if self.gate[0] < load < self.gate[1] and not self.scene.drag:
            report.reject("brittle")
        return report


@pytest.mark.mpi
def test_drag_comes_when_cutting_does_not_help_and_fades():
    plain = Newton(strip(), 1e-11)
    assert march(plain, steps=10).reached == 1
    newton, accepted = Brittle(strip(), 1e-11), []
    newton.drags = []
    outcome = march(newton, steps=10, on_accept=accepted.append)
    assert outcome.reached == 1 and outcome.reason == "" and outcome.rejected > 0
    loads, drags = np.array(newton.drags).T
    assert not drags[loads < 0.3].any() and drags[loads > 0.3].max() > 0 == drags[-1]
    energies = accepted[-1].energies
    assert 0 < energies["viscous"] < 1e-2 * energies["strain"]
    # the last state is in equilibrium without drag
    assert newton.scene.energy() == pytest.approx(plain.scene.energy(), rel=1e-9)

    newton = Brittle(strip())
    newton.drags = []
    outcome = march(newton, steps=10, viscosity="off")
    assert outcome.reached < 0.31 and "brittle" in outcome.reason


@pytest.mark.mpi
def test_a_march_goes_on_from_a_state_under_drag():
    """Under way and at full load; it ends with a reason where the sheet creeps for ever."""
    newton, states = Newton(strip(), 1e-11), []

    def keep(accepted):
        at = accepted.progress
        states.append(replace(at, x=at.x.copy(), previous=at.previous.copy()))

    assert march(newton, steps=10, on_accept=keep).reason == ""
    energy = newton.scene.energy()
    for start in (states[5], states[-1]):
        start.viscosity = Viscosity(drag=1e-3, stiffness=1.0)
        outcome = march(newton, steps=10, start=start)
        assert outcome.reached == 1 and outcome.reason == "" and start.viscosity.drag == 0
        assert newton.scene.energy() == pytest.approx(energy, rel=1e-9)
    start.viscosity = Viscosity(drag=1e20, stiffness=1.0)
    outcome = march(newton, steps=10, start=start)
    assert outcome.reached == 1 and "still creeps after 40 steps at constant load" in outcome.reason


class Torn(ff.Term):
    """No energy up to a displacement of 3 mm, not a number beyond."""

    name, energy_kind = "torn", "strain"

    def set_up(self, scene):
        blank, u = scene.blank, scene.blank.displacement
        self.energy = 1e-12 * ufl.sqrt(9 - ufl.dot(u, u)) * ufl.dx(blank.mesh)


@pytest.mark.versions
@pytest.mark.mpi
def test_a_material_that_is_not_a_number_ends_at_the_last_sound_state():
    scene, kept = strip(further=[Torn()]), []
    keep = lambda state: kept.append((state.load, state.progress.x.copy()))  # noqa: E731
    outcome = march(Newton(scene), steps=10, on_accept=keep)
    assert 0.4 < outcome.reached < 0.51 and "not a number" in outcome.reason
    assert kept[-1][0] == outcome.reached and (scene.u - kept[-1][1]).norm() == 0
    assert np.isfinite(scene.energy())


@pytest.mark.versions
def test_a_scene_that_was_solved_is_freed():
    """Its communicators too, of which MPICH has 2048 a process."""
    assert march(Newton(scene := strip()), steps=2).reached == 1
    known = weakref.ref(scene)
    del scene
    gc.collect()
    assert known() is None


@pytest.mark.versions
@pytest.mark.mpi
def test_loose_solves_by_the_narrow_tangent_lead_to_the_same_state(monkeypatch):
    solved, narrow = [], Preconditioner.solve
    noted = lambda *given: solved.append(narrow(*given)) or solved[-1]  # noqa: E731
    monkeypatch.setattr(Preconditioner, "solve", noted)
    forces = []
    for unknowns in (np.inf, 0):
        monkeypatch.setattr(Preconditioner, "UNKNOWNS", unknowns)
        solved.clear()
        job = ff.Press.read("hemisphere", ["blank.nx=4"]).build().job(steps=2)
        forces.append(job.run().number("reaction_N"))
        assert (np.mean(solved) > 0.8) == (unknowns == 0)
    assert forces[1] == pytest.approx(forces[0], rel=1e-5)


def test_a_strip_has_no_narrow_tangent(monkeypatch):
    """Each iteration factors once, and no state is verified by factors of the same matrix."""
    monkeypatch.setattr(Preconditioner, "UNKNOWNS", 0)
    newton = Newton(strip())
    assert march(newton, steps=2, path_tolerance=1e-4).reached == 1
    assert not newton.directions._narrow._pays and newton.report.negative_pivots == 0
