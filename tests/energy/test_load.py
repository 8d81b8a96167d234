"""Dead loads on blanks in a plane and in space."""

import numpy as np
import pytest
from builders import Elastic, everywhere, march, near, rotation, run, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.scene import output as reports
from fabric_fenicsx.solve.newton import Newton

LENGTH, WIDTH, TENSION = 40.0, 10.0, 8.0
FLAT = np.eye(3)


def strip(spatial, turn=FLAT, cell="triangle", **options):
    """In its plane, in space along x and y, or turned in space with its frame."""
    options |= {"turn": turn, "a": turn[:, 0]} if spatial else {}
    return sheet(LENGTH, WIDTH, 8, 2, "left", cell=cell, spatial=spatial, **options)


def end(blank, position):
    return lambda x: np.abs(blank.along(x)[0] - position) < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["P2", "Q1", "turned"])
def test_edge_tension_is_the_stress_of_a_strip(kind):
    """Pulled at both ends by T [N/mm], free across: stress T / t along, in each cell; the grips'
    work is its energy."""
    spatial = kind == "turned"
    turn, cell = rotation() if spatial else FLAT, "quadrilateral" if kind == "Q1" else "triangle"
    blank = strip(spatial, turn, cell, degree=2 if kind == "P2" else 1)
    fabric = ff.load("komeili").without("biaxial")
    membrane = ff.Membrane(fabric)
    gdim = blank.mesh.geometry.dim
    pulls = [
        ff.EdgeTension(lambda load: load * TENSION, s * turn[:gdim, 0], end(blank, p))
        for s, p in ((-1, 0.0), (1, LENGTH))
    ]
    held = [ff.Support("corner", lambda x: np.abs(blank.along(x)[:2]).max(0) < 1e-6, (0,))]
    held += [ff.Support("side", lambda x: np.abs(blank.along(x)[1]) < 1e-6, (1,))]
    if spatial:
        held.append(ff.Support("plane", everywhere, (2,)))
    scene, states = ff.Scene(blank, [membrane, *pulls], held), []
    outcome = march(Newton(scene), 20, on_accept=states.append)
    assert not outcome.reason, outcome.reason
    state = membrane.state()[0]
    # P = F S, on the undeformed width
    nominal = np.sqrt(state.invariants[..., 0, None, None]) * state.S * fabric.thickness
    assert nominal == pytest.approx(
        np.broadcast_to(np.diag([TENSION, 0]), nominal.shape), abs=1e-6 * TENSION
    )
    assert sum(states[-1].energies.values()) == pytest.approx(states[-1].external_work, rel=1e-3)


@pytest.mark.mpi
def test_dead_pressure_on_a_tilted_patch():
    """Held at all its nodes: reaction p A, whatever the tilt, no energy."""
    Q = rotation()
    load_, held = ff.DeadPressure(0.1, Q[:, 2]), ff.Support("all", everywhere, (0, 1, 2))
    scene = ff.Scene(strip(True, Q), [ff.Membrane(ff.load("komeili")), load_], [held])
    scene.set_load(0.5)
    scene.residual(scene.u.duplicate())
    total = 0.05 * LENGTH * WIDTH
    assert scene.reaction("all") == pytest.approx([0, 0, -total], abs=1e-9)
    assert scene.energies() == pytest.approx({"strain": 0.0}, abs=1e-12)
    # beside which a support that only locates the sheet and a residual are judged
    (applied,) = scene.applied_forces()
    given = scene.comm.allreduce(applied.reshape(-1, 3).sum(0))
    assert given == pytest.approx([0, 0, total])
    assert reports.outer_forces(scene)[""] == pytest.approx(total)


@pytest.mark.mpi
def test_loads_on_one_sheet_of_a_stack():
    """The other one feels nothing."""
    stack = ff.Stack([(strip(True), 1.0, each) for each in ("lower", "upper")])
    low = near(0, 0.0)
    terms = ff.DeadPressure(TENSION, (1, 0, 0)), ff.EdgeTension(5.0, (1, 0, 0), low)
    springs, total = ff.Springs(low, 3.0, 2.0, arm=(5, 0, 0)), TENSION * WIDTH * LENGTH + 52.0
    held = [
        ff.Support("lower", lambda x: x[2] < 0.5, (0, 1, 2)),
        ff.Support("upper", lambda x: x[2] > 0.5, (0, 1, 2)),
    ]
    scene = ff.Scene(stack, [Elastic(), *(term.on("upper") for term in (*terms, springs))], held)
    run(scene, 1)
    assert scene.reaction("upper") == pytest.approx([-total, 0, 0], rel=1e-12)
    assert not scene.reaction("lower").any()
