"""Newton and load stepping: every start, every angle, every solver, and a reason where it ends."""

import numpy as np
import pytest
from mpi4py import MPI

from fabric_fenicsx.blank import Blank
from fabric_fenicsx.errors import InputError
from fabric_fenicsx.material.presets import PRESETS
from fabric_fenicsx.mechanics.membrane import Membrane
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.scene import Scene, grips
from fabric_fenicsx.solve.newton import LINEAR_SOLVERS, Newton
from fabric_fenicsx.solve.stepping import march

COMM = MPI.COMM_WORLD
KOMEILI = PRESETS["komeili"]


def strip(angle=0.0, stroke=6.0, fabric=KOMEILI, clamped=True, nx=16, pattern="crossed", cell="triangle", **options):
    arrays = specimen(nx=nx, ny=nx // 4, pattern=pattern, cell=cell) if COMM.rank == 0 else (None,) * 3
    blank = Blank.from_arrays(COMM, *arrays, a=np.radians(angle), **options)
    return Scene(blank, [Membrane(blank, fabric)], grips(blank, stroke, clamped))


def negative_pivots(newton):
    """Of the tangent at the present state, factored anew."""
    newton.scene.tangent(newton.A)
    newton.snes.ksp.setOperators(newton.A)
    newton.snes.ksp.setUp()
    return newton.snes.ksp.pc.getFactorMatrix().getInertia()[0]


@pytest.mark.mpi
@pytest.mark.parametrize("angle", [0, 10, 30, 45, 60, 85])
@pytest.mark.parametrize(
    "shape", [{}, {"degree": 2, "pattern": "unstructured"}, {"cell": "quadrilateral", "degree": 2}]
)
def test_strips_with_yarns_at_every_angle(angle, shape):
    scene = strip(angle, **shape)
    newton = Newton(scene)
    outcome = march(newton, steps=4)
    assert outcome.reached == 1 and outcome.rejected == 0, outcome.reason
    assert newton.report.residuals[-1] <= 1e-8 * newton.report.scale
    assert negative_pivots(newton) == 0


@pytest.mark.mpi
@pytest.mark.parametrize("solver", LINEAR_SOLVERS)
def test_linear_solvers_agree(solver):
    found = []
    for name in ("mumps-cholesky", solver):
        scene = strip()
        newton = Newton(scene, linear_solver=name)
        assert march(newton, steps=5).reached == 1
        found.append((scene.energy(), scene.reaction("moving grip")[0]))
    assert (newton.report.negative_pivots is None) == (solver != "mumps-cholesky")
    assert found[1] == pytest.approx(found[0], rel=1e-8)


def test_unknown_solver_is_named():
    with pytest.raises(InputError, match="'magic'; allowed are mumps-cholesky"):
        Newton(strip(), linear_solver="magic")


@pytest.mark.mpi
@pytest.mark.parametrize("tolerance", [1e-12, 1e-15])
def test_a_tolerance_below_rounding_ends_at_rounding(tolerance):
    newton = Newton(strip(), tolerance)
    assert march(newton, steps=4).reached == 1
    assert newton.report.residuals[-1] <= 1e-11 * newton.report.scale


@pytest.mark.mpi
def test_no_saddle_is_accepted():
    fabric = KOMEILI.replace(p_min=0.0)  # tension-compression bands: the homogeneous state is no minimum
    scene = strip(fabric=fabric, clamped=False)
    newton = Newton(scene)
    left = []
    outcome = march(newton, steps=10, on_accept=lambda a: left.append(negative_pivots(newton) if a.load else 0))
    assert outcome.accepted > 0 and set(left) == {0}
    assert outcome.reached == 1 or outcome.reason


@pytest.mark.mpi
def test_a_start_on_a_saddle_is_left_or_refused():
    scene = strip(fabric=KOMEILI.replace(p_min=0.0), clamped=False)
    blind = Newton(scene, linear_solver="mumps-lu")  # does not tell inertia, so stays on the homogeneous branch
    assert march(blind, steps=10).reached == 1
    x, energy = scene.u.copy(), scene.energy()
    newton = Newton(scene)
    assert negative_pivots(newton) > 0
    report = newton.solve_for(x)
    if report.converged:
        assert negative_pivots(newton) == 0 and scene.energy() < energy
    else:
        assert "saddle" in report.reason or "no convergence" in report.reason or "line search" in report.reason


@pytest.mark.mpi
def test_a_start_inside_out_is_named():
    scene = strip()
    x = scene.u.duplicate()
    x.array[:] = (scene.blank.coordinates()[: len(x.array) // 2, :2] * [-2.5, 0]).ravel()
    report = Newton(scene).solve_for(x)
    assert not report.converged and report.reason == "a cell is turned inside out"


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


@pytest.mark.mpi
def test_one_huge_step_arrives_where_small_steps_do():
    ends = []
    for steps in (1, 12):
        scene = strip()
        assert march(Newton(scene, 1e-10), steps=steps).reached == 1
        ends.append((scene.energy(), scene.reaction("moving grip")[0]))
    assert ends[0] == pytest.approx(ends[1], rel=1e-9)


class Stubborn(Newton):
    """Fails every step that is larger than a limit."""

    limit = 0.06

    def solve_for(self, x):
        report = super().solve_for(x)
        load = self.scene.reaction("moving grip")[0] and x.array[self.scene.held].max(initial=0.0) / 6.0
        taken = COMM.allreduce(load, MPI.MAX) - self.done
        if taken > self.limit:
            report.converged, report.reason = False, "too large for me"
        else:
            self.done += taken
        return report


@pytest.mark.mpi
def test_steps_are_cut_and_grow_again():
    newton, loads, rejected = Stubborn(strip()), [], []
    newton.done = 0.0
    outcome = march(
        newton,
        steps=5,
        on_accept=lambda a: loads.append(a.load),
        on_reject=lambda load, report: rejected.append(report.reason),
    )
    assert outcome.reached == 1 and outcome.rejected == len(rejected) > 0 and set(rejected) == {"too large for me"}
    steps = np.diff(loads)
    assert steps.max() <= 0.06 and steps.max() > 1.4 * steps.min() and loads[-1] == 1

    newton = Stubborn(strip())
    newton.done, newton.limit = 0.0, 0.0
    outcome = march(newton, steps=5)
    assert outcome.reached == 0 and "gave up at load factor 0: too large for me" in outcome.reason


@pytest.mark.mpi
@pytest.mark.parametrize(
    "options, words",
    [({"steps": 0}, "steps is 0"), ({"steps": float("nan")}, "steps is nan"), ({"max_step": 0}, "max-step is 0")],
)
def test_bad_steps_are_named(options, words):
    with pytest.raises(InputError, match=words):
        march(Newton(strip()), **options)
