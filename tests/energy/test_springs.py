"""Springs and loads."""

import numpy as np
import pytest
from builders import Elastic, alone, everywhere, march, near, off_differences, rotation, run, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.io.field import Field
from fabric_fenicsx.scene import output as reports
from fabric_fenicsx.solve.newton import Newton

LENGTH, WIDTH = 40.0, 10.0
END = near(0, LENGTH)


def held(blank, stroke=0.0):
    """Two ends of a strip along its length, of which the low one is drawn by `stroke` [mm]."""
    axes = tuple(range(blank.mesh.geometry.dim))
    grip = ff.Support("grip", near(0, 0.0), axes, (-stroke, 0, 0))
    return [grip, ff.Support("rest", everywhere, axes[1:])]


@pytest.mark.parametrize("nx, degree", [(9, 1), (5, 2)])
def test_parallel_springs_and_the_strip_share_the_stroke(nx, degree):
    """In series: k = E h b / l of the strip, 60 N/mm of the springs, at any mesh."""
    blank = sheet(LENGTH, WIDTH, nx, 3, "crossed", degree=degree)
    springs = ff.Springs(END, 60.0, arm=(30.0, 0))
    scene = ff.Scene(blank, [Elastic(1e3), springs], held(blank, 1e-3))
    states = run(scene, 2)
    k = 1e3 * WIDTH / LENGTH
    pull = 1e-3 * k * 60 / (k + 60)
    assert scene.reaction("grip")[0] == pytest.approx(-pull, rel=1e-4)
    assert springs.pull() == pytest.approx(pull, rel=1e-4)
    assert states[-1].energies["springs"] == pytest.approx(pull**2 / 120, rel=1e-3)
    assert sum(states[-1].energies.values()) == pytest.approx(states[-1].external_work, rel=1e-6)


def test_a_preload_pulls_from_the_start_and_a_slack_spring_does_nothing():
    blank = sheet(LENGTH, WIDTH, 8, 2, "left")
    springs = ff.Springs(END, 5.0, 20.0, arm=(30.0, 0), name="clamp 1")
    scene = ff.Scene(blank, [Elastic(1e6), springs], held(blank, -10.0))
    history = [reports.history(scene)["clamp_1_pull_N"]]
    run(scene, 4)
    history.append(reports.history(scene)["clamp_1_pull_N"])
    assert history == [pytest.approx(20), 0.0]  # 10 mm nearer take 50 N
    assert scene.energies()["springs"] == pytest.approx(-(20**2) / (2 * 5))
    assert scene.reaction("grip")[0] == pytest.approx(0, abs=1e-6)
    told = reports.summary(scene)["springs"]["clamp 1"]
    assert told["pull_N"] == 0 and told["largest_elongation_mm"] == pytest.approx(-10, rel=1e-4)


def test_springs_to_a_point_pull_towards_it():
    """Each of two nodes by half, 9 mm off and 12 mm up, though the blank's axes are turned; then
    one is 5 mm further away, and the other is slack."""
    turn = rotation()
    blank = sheet(LENGTH, WIDTH, 8, 2, "left", spatial=True, turn=turn, a=turn[:, 0])
    local = lambda x: turn.T @ x  # noqa: E731
    corners = lambda x: (local(x)[0] > LENGTH - 1e-6) & (abs(local(x)[1] - 5) > 4.9)  # noqa: E731
    anchor = turn @ (LENGTH + 9, WIDTH / 2, 12)
    springs = alone(blank, ff.Springs(corners, 2.0, 7, anchor=anchor))
    size, ways = np.sqrt(9**2 + 5**2 + 12**2), np.array([[9.0, 5, 12], [9, -5, 12]])
    assert springs.pull() == pytest.approx(7)
    assert springs.force() == pytest.approx(7 * (turn @ (9, 0, 12)) / size)
    x = local(blank.coordinates().T).T
    ends = [np.flatnonzero(np.linalg.norm(x - (LENGTH, y, 0), axis=1) < 1e-6)[0] for y in (0, 10)]
    u = blank.u.x.array.reshape(-1, 3)
    u[ends] = -5 / size * ways[0], 0.8 * ways[1]
    assert springs.pull() == pytest.approx((7 + 2 * 5) / 2)
    assert springs.force() == pytest.approx(8.5 * (turn @ ways[0]) / size)
    told = springs.summary()["springs"].value["springs"]
    assert told["pull_N"] == pytest.approx(8.5)
    assert told["largest_elongation_mm"] == pytest.approx(5)
    energy = (17**2 - 7**2) / (2 * 2) / 2 - 7**2 / (2 * 2) / 2
    assert springs.stored() == pytest.approx(energy)


@pytest.mark.mpi
@pytest.mark.parametrize("degree", [1, 2])
def test_an_edge_counts_by_its_length(degree):
    """Of cells that differ in size: the resultant is in the middle of the edge."""
    uneven = lambda x: x * (1, 1, 0) * (x / WIDTH) ** (0, 1, 0)  # noqa: E731
    blank = sheet(LENGTH, WIDTH, 4, 6, "right", shape=uneven, spatial=True, degree=degree)
    springs = alone(blank, ff.Springs(END, 1.0, 12.0, arm=(0, 0, 8.0)))
    f = springs.applied_forces().reshape(-1, 3)
    y = blank.coordinates()[: len(f), 1]
    moment, force = (blank.mesh.comm.allreduce(each) for each in (y @ f[:, 2], f[:, 2].sum()))
    assert force == pytest.approx(12) and moment == pytest.approx(12 * WIDTH / 2)


@pytest.mark.mpi
@pytest.mark.parametrize("options", [{"arm": (3, 1.0, 8)}, {"anchor": (LENGTH + 2, 3, -4)}])
def test_forces_and_tangent_are_derivatives(options):
    blank = sheet(LENGTH, WIDTH, 8, 2, "left", spatial=True)
    springs = ff.Springs(lambda x: x[0] > LENGTH / 2, 3.0, 2.0, **options)
    scene = ff.Scene(blank, [Elastic(), springs], held(blank))
    assert "agree" in ff.check_derivatives(springs, scene, size=0.2)
    if blank.mesh.comm.size == 1:
        assert off_differences(springs, 2.0) < 1e-6  # some are slack


TENSION, FLAT = 8.0, np.eye(3)


def strip(spatial, turn=FLAT, **options):
    """In its plane, in space along x and y, or turned in space with its frame."""
    options |= {"turn": turn, "a": turn[:, 0]} if spatial else {}
    return sheet(LENGTH, WIDTH, 8, 2, "left", spatial=spatial, **options)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", ["P2", "Q1", "turned"])
def test_edge_tension_is_the_stress_of_a_strip(kind):
    """Pulled at both ends by T [N/mm], free across: stress T / t along, in each cell; the grips'
    work is its energy."""
    spatial = kind == "turned"
    turn, cell = rotation() if spatial else FLAT, "quadrilateral" if kind == "Q1" else "triangle"
    blank = strip(spatial, turn, cell=cell, degree=2 if kind == "P2" else 1)
    fabric = ff.load("komeili").without("biaxial")
    membrane, gdim = ff.Membrane(fabric), blank.mesh.geometry.dim
    held = [ff.Support("corner", lambda x: np.abs(blank.along(x)[:2]).max(0) < 1e-6, (0,))]
    held += [ff.Support("side", lambda x: np.abs(blank.along(x)[1]) < 1e-6, (1,))]
    pulls = []
    for s, p in ((-1, 0.0), (1, LENGTH)):
        end = lambda x, p=p: np.abs(blank.along(x)[0] - p) < 1e-6  # noqa: E731
        pulls.append(ff.EdgeTension(lambda load: load * TENSION, s * turn[:gdim, 0], end))
    if spatial:
        held.append(ff.Support("plane", everywhere, (2,)))
    scene, states = ff.Scene(blank, [membrane, *pulls], held), []
    outcome = march(Newton(scene), 20, on_accept=states.append)
    assert not outcome.reason, outcome.reason
    state = membrane.state()[0]
    # P = F S, on the undeformed width
    nominal = np.sqrt(state.invariants[..., 0, None, None]) * state.S * fabric.thickness
    right = np.broadcast_to(np.diag([TENSION, 0]), nominal.shape)
    assert nominal == pytest.approx(right, abs=1e-6 * TENSION)
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
@pytest.mark.parametrize("thin", [False, True])
def test_a_strip_hangs_by_its_weight(thin):
    """w L b at the clamp, and w (L x - x^2 / 2) / (E h) down from it: w = rho t g, 2.5 kg/m^2 at
    1e3 m/s^2, or half of it in the far half."""
    half = Field(lambda x, y: np.where(x < LENGTH / 2, 2.0, 1.0)) if thin else None
    fabric = ff.load("komeili").replace(thickness=2.0, density=1.25)
    strong = type("OfFabric", (Elastic,), {"material": fabric, "thickness_field": half})(500.0)
    blank, clamp = sheet(LENGTH, WIDTH, 8, 2, "crossed"), ff.Support("clamp", near(0, 0.0), (0, 1))
    scene = ff.Scene(blank, [strong, ff.Gravity((1e3, 0))], [clamp])
    run(scene, 1)
    weight = 2.5e-3 * LENGTH * WIDTH * (0.75 if thin else 1.0)
    assert scene.reaction("clamp") == pytest.approx([-weight, 0], abs=1e-9)
    x, u = blank.coordinates()[:, 0], blank.nodal_displacement()[:, 0]
    assert thin or u == pytest.approx(2.5e-3 / 500 * (LENGTH * x - x**2 / 2), abs=4e-6)  # of 4e-3


@pytest.mark.mpi
def test_loads_on_one_sheet_of_a_stack():
    """The other one feels nothing."""
    stack = ff.Stack([(strip(True), 1.0, each) for each in ("lower", "upper")])
    low = near(0, 0.0)
    terms = ff.DeadPressure(TENSION, (1, 0, 0)), ff.EdgeTension(5.0, (1, 0, 0), low)
    springs, total = ff.Springs(low, 3.0, 2.0, arm=(5, 0, 0)), TENSION * WIDTH * LENGTH + 52.0
    held = [ff.Support("lower", lambda x: x[2] < 0.5, (0, 1, 2))]
    held.append(ff.Support("upper", lambda x: x[2] > 0.5, (0, 1, 2)))
    scene = ff.Scene(stack, [Elastic(), *(term.on("upper") for term in (*terms, springs))], held)
    run(scene, 1)
    assert scene.reaction("upper") == pytest.approx([-total, 0, 0], rel=1e-12)
    assert not scene.reaction("lower").any()
