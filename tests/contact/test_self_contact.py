"""Contact of a sheet with itself."""

import re

import numpy as np
import pytest
from builders import COMM, Elastic, march, near, nodal_forces, off_differences
from builders import sheet as rectangle
from mpi4py import MPI
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import fabric_fenicsx as ff
from fabric_fenicsx.solve.newton import Newton

T, PENALTY, LENGTH, WIDTH = 4.0, 20.0, 60.0, 8.0


def folded(turns, gap=0.0):
    """Shape of a strip that is folded by half a turn at each {place along it: 1 up or -1 down},
    with layers at a `gap` between their faces [mm]."""
    r = (T + gap) / 2
    s = np.linspace(0, LENGTH, 100001)
    turned = lambda at: np.clip((s - at) / r, -np.pi / 2, np.pi / 2) + np.pi / 2  # noqa: E731
    angle = 0 * s + sum(way * turned(at) for at, way in turns.items())
    middle = 0.5 * (angle[1:] + angle[:-1])
    x, z = (np.append(0, np.cumsum(f(middle) * s[1])) for f in (np.cos, np.sin))
    return lambda X: np.array([np.interp(X[0], s, x), X[1], np.interp(X[0], s, z)])


def scene_of(turns, gap, comm=COMM, nx=30, degree=1, **options):
    """A folded strip that has accepted that, and its contact."""
    blank = rectangle(LENGTH, WIDTH, nx, 4, "crossed", comm, spatial=True, degree=degree)
    contact = ff.SelfContact(T, **{"penalty": PENALTY} | options)
    scene = ff.Scene(blank, [Elastic(), contact])
    lead(blank, folded(turns, gap))
    scene.accept()
    return scene, contact


def lead(blank, shape):
    X = blank.coordinates()
    blank.u.x.array[:] = (shape(X.T).T - X).ravel()


FOLDS = {
    "up": {LENGTH / 2: 1},
    "down": {LENGTH / 2: -1},
    "both": {LENGTH / 3: 1, 2 * LENGTH / 3: -1},
}


@pytest.mark.mpi
@pytest.mark.parametrize("fold, degree", [("both", 1), ("up", 2), ("down", 1)])
def test_layers_press_each_other_with_what_the_law_says(fold, degree):
    """Away from folds and ends the pressure is that of the overlap; a layer in the middle is
    pressed on both faces."""
    turns, depth = FOLDS[fold], 0.2
    _, contact = scene_of(turns, -depth, degree=degree, nx=30 // degree)
    points, known = contact.points, contact.state()
    pressure = points.of_all(contact.faces.now, known.pressure)
    pressure = pressure.reshape(len(points.part.cells), -1, 2, 3)
    x = contact.blank.midpoints()[0]
    off = np.min([abs(x - at) for at in (0, *turns, LENGTH)], axis=0) > 7
    expected = PENALTY * (depth - 0.3 * 0.0125 * T / 2)
    told = contact.cell_fields()["sheet_pressure"].value
    layer = (x[:, None] > np.array(list(turns))).sum(1)
    for k in range(len(turns) + 1):
        at = off & (layer == k)
        assert COMM.allreduce(int(at.sum())) > 10
        assert told[at] == pytest.approx(expected, rel=1e-3)  # by that face that is pressed more
        faces = [turns.get(side) for side in (list(turns)[k - 1 : k] + list(turns)[k : k + 1])]
        for face, way in enumerate((1, -1)):
            wanted = expected if way in faces else 0.0
            assert pressure[at][:, :, face] == pytest.approx(wanted, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("shape", [{}, {LENGTH / 2: 1}], ids=["flat", "round its thickness"])
def test_a_sheet_that_is_bent_no_further_than_it_can_be_is_free(shape):
    _, contact = scene_of(shape, 0.05 * T, nx=60)
    assert COMM.allreduce(len(contact.faces.now.points)) > 0 or not shape
    assert not contact.state().pressure.any() and contact.largest_depth() == 0.0


@pytest.mark.parametrize("way", [1, -1])
def test_a_limb_that_came_through_is_pressed_back(way):
    """As it lay on the other side in the accepted state."""
    scene, contact = scene_of({LENGTH / 2: way}, 0.2)
    u, (x, *_) = scene.blank.u.x.array.reshape(-1, 3), scene.blank.coordinates().T
    u[x > LENGTH / 2 + T, 2] -= way * (T + 1.0)
    assert scene.update_lagged()
    forces = -nodal_forces(contact)
    pushed = COMM.allreduce(forces[x[: len(forces)] > LENGTH / 2 + 2 * T].sum(0))
    assert way * pushed[2] > 0.9 * PENALTY * T * (LENGTH / 2 - 2 * T) * WIDTH


@pytest.mark.mpi
def test_ranks_share_what_one_finds(by_position):
    """Forces, that are action and reaction with their moment, and energy."""
    found = []
    for comm in (COMM, MPI.COMM_SELF):
        scene, contact = scene_of(FOLDS["both"], -0.2, comm, friction=0.3)
        scene.blank.u.x.array[:] *= 1.001
        scene.update_lagged()
        forces, X = nodal_forces(contact), scene.blank.coordinates()
        x = (X + scene.blank.nodal_displacement())[: len(forces)]
        total, moment = comm.allreduce(np.array([forces.sum(0), np.cross(x, forces).sum(0)]))
        size = comm.allreduce(contact.normal_forces().sum())
        assert size > 100 and abs(total).max() < 1e-12 * size
        assert abs(moment).max() < 0.01 * size * T  # triangles are flat, the face is not
        _, forces = by_position(comm, X[: len(forces)], forces)
        found.append((forces, comm.allreduce(contact.stored())))
    assert abs(found[0][0] - found[1][0]).max() < 1e-9 * abs(found[1][0]).max()
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-9)


@pytest.mark.parametrize(
    "fold, friction, degree", [("both", 0.0, 2), ("both", 0.3, 1), ("down", 0.3, 2)]
)
def test_forces_and_tangent_are_derivatives(fold, friction, degree):
    _, contact = scene_of(FOLDS[fold], -0.1, nx=30 // degree, degree=degree, friction=friction)
    assert off_differences(contact, 0.01) < 1e-6
    assert (contact.state().pressure > 0).any()


L, W, D = 100.0, 8.0, 8.33
START, END = 40.0, 17.0  # mm between the ends
EULER = (2 * np.pi / L) ** 2  # load of the flat strip over D
MIDDLE = near(0, L / 2)


def half(P, M, R=0.0):
    """Half of the elastica, from the force and the moment at its clamped end and the force R
    between the limbs at the neck, all over D: angle, its slope and place in the middle, and x of
    the neck."""

    def slope(s, y, force):
        return [y[1], -force * np.sin(y[0]), np.cos(y[0]), np.sin(y[0])]

    def upright(s, y, force):
        return y[0] - np.pi / 2

    upright.terminal = True
    how = {"rtol": 1e-9, "atol": 1e-9}
    first = solve_ivp(slope, (0, L / 2), [0, M, 0, 0], args=(P,), events=upright, **how)
    s, y = first.t[-1], first.y[:, -1]
    rest = solve_ivp(slope, (s, L / 2), y, args=(P - R,), dense_output=True, **how)
    return rest.y[:, -1], y[2]


def elastica(end):
    """Forces P at the ends, at the distance `end`, and R at the neck, over D; from where limbs of
    the thickness T begin to touch on."""
    unknown = [1.74 * EULER, 0.138, 0.0]
    for distance in np.linspace(19.98, end, 4):

        def missing(unknown, distance=distance):
            middle, neck = half(*unknown)
            return [middle[0], middle[2] - distance / 2, neck - (distance - T) / 2]

        unknown, _, found, words = fsolve(missing, unknown, full_output=True)
        assert found == 1, words
    return unknown[0], unknown[2]


def strip(nx, *terms, end=END, halved=False):
    """Job of that strip, or of half of it up to a plane of symmetry in its middle. It begins bent
    in a sine, which the first solve lets go."""
    length = L / 2 if halved else L
    blank = rectangle(length, W, nx, 1, "left" if halved else "crossed", spatial=True)
    lead(blank, lambda X: begun(X) - [[halved * (START - L) / 2], [0], [0]])
    sides = [near(0, 0.0), near(0, L)]

    def way(load):
        return L - START + load * (START - end)

    supports = [ff.Support("side", near(1, 0.0), (1,))]
    for name, where, components, share in (
        ("end", sides[0], (0, 2), 0.5 * halved),
        ("plane of symmetry", MIDDLE, (0,), -0.5 * (not halved)),
        *([] if halved else [("pushed end", sides[1], (0, 2), -1.0)]),
    ):
        moved = lambda x, load, s=share: np.array([s * way(load), 0, 0])[:, None] + 0 * x  # noqa: E731
        supports.append(ff.Support(name, where, components, *[moved][: share != 0]))
    symmetric = {"symmetric": MIDDLE} if halved else {}
    clamped = lambda x: sides[0](x) | sides[1](x)  # noqa: E731
    bending = ff.Bending(D, D_t=2 * D, clamped=clamped, **symmetric)
    return ff.Job(ff.Scene(blank, [Elastic(500.0), bending, *terms], supports), steps=12)


def begun(X):
    """A loop about as the strip lies at first."""
    s = np.linspace(0, L, 1001)
    angle = 1.7 * np.sin(2 * np.pi * s / L)
    steps = np.array([np.cos(angle), np.sin(angle)])[:, 1:] * s[1]
    x, z = np.column_stack([[0, 0], np.cumsum(steps, axis=1)])
    x *= START / x[-1]
    return np.array([np.interp(X[0], s, x), X[1], np.interp(X[0], s, z)])


@pytest.mark.parametrize("halved", [False, True])
def test_an_elastica_that_touches_itself(halved):
    """Forces at the ends, twice those of the strip as it begins to touch itself, and at the neck;
    half of it touches its image, without friction, as both slide alike."""
    P, R = elastica(END)
    options = {"symmetric": MIDDLE, "friction": 0.3} if halved else {}
    contact = ff.SelfContact(T, penalty=10.0, **options)
    result = strip(40 if halved else 80, contact, halved=halved).run()
    assert abs(result.rows[-1]["reaction_N"]) == pytest.approx(P * D * W, rel=0.005)
    assert contact.totals[3] == pytest.approx(R * D * W, rel=0.01)
    assert contact.largest_depth() < 0.0125 * T
    assert result.rows[-1]["energy_imbalance"] < 0.005
    assert not halved or off_differences(contact, 0.01) < 1e-6


def test_half_a_strip_that_goes_beyond_its_plane_of_symmetry_is_not_valid():
    with pytest.raises(ff.SolverFailure) as error:
        strip(40, ff.SelfContact(T, penalty=10.0), end=12.0, halved=True).run()
    words = "its image: 18 nodes lie up to (.*) mm beyond the plane of support 'plane of"
    assert float(re.search(words, str(error.value))[1]) == pytest.approx(1.31, rel=0.02)
    assert "or `SelfContact(symmetric=...)`" in str(error.value)


def test_a_strip_rolled_up_lies_on_itself():
    """A core pulls it in and lays it around itself; a smooth bar stands for the core, and the first
    cells turn. Turns are a thickness apart, and bending takes D / (2 R^2) of each length that is
    laid on the turn of radius R. Energies and work agree to a part of what the strip's end did."""
    T, CORE, PULL, D = 2.0, 10.0, 0.3, 8.33  # thickness, radius [mm], pull [N/mm], bending [N mm]
    LENGTH, WIDTH, NX, TURNS, STEPS = 120.0, 4.0, 60, 1.35, 36
    RADII = (CORE + T / 2) + np.array([0, T])  # radii of the middle surfaces of both turns
    blank = rectangle(LENGTH, WIDTH, NX, 1, "left", spatial=True)

    def turned(x, load):
        c, s = np.cos(2 * np.pi * TURNS * load), np.sin(2 * np.pi * TURNS * load)
        return np.array([(c - 1) * x[0] - s * RADII[0], 0 * x[1], s * x[0] + (c - 1) * RADII[0]])

    bar = ff.Tool(ff.Cylinder((0, 0, -RADII[0]), (0, 1, 0), CORE), name="bar")
    contact, states = ff.SelfContact(T, penalty=10.0, friction=0.3), []
    pull = ff.EdgeTension(PULL, (1, 0, 0), near(0, LENGTH))
    terms = [Elastic(500.0), ff.Bending(D, D_t=2 * D), ff.Contact(bar, T, 10.0), contact, pull]
    core = ff.Support("core", lambda x: x[0] < 1.001 * LENGTH / NX, (0, 2), turned)
    scene = ff.Scene(blank, terms, [core, ff.Support("side", near(1, 0.0), (1,))])
    outcome = march(Newton(scene), STEPS, on_accept=states.append, path_tolerance=1e-5)
    assert not outcome.reason
    X, u = scene.blank.coordinates(), scene.blank.nodal_displacement()
    _, row = np.unique(X[:, 0], return_index=True)
    x, z = (X + u)[row][:, ::2].T + [[0], [RADII[0]]]
    radius, angle = np.hypot(x, z), np.unwrap(np.arctan2(x, z))
    angle -= angle[0]
    under = angle < 0.25 * 2 * np.pi
    above = np.interp(angle[under] + 2 * np.pi, angle, radius)
    assert above - radius[under] == pytest.approx(T, rel=0.04)
    load, bending = np.array([[s.load, s.energies["bending"] / WIDTH] for s in states]).T
    for R, turns in zip(RADII, [(0.5, 0.9), (1.23, TURNS)]):
        ends = np.interp(turns, TURNS * load, bending)
        assert np.diff(ends) / np.diff(turns) / (2 * np.pi) == pytest.approx(D / (2 * R), rel=0.01)
    missing = sum(states[-1].energies.values()) - states[-1].external_work
    assert abs(missing) < 0.005 * PULL * WIDTH * (LENGTH - x[-1])
    assert off_differences(contact, 0.01) < 1e-6
