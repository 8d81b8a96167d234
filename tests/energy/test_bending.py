"""Bending of strips, plates and sheets in space."""

import math
from functools import partial

import builders
import numpy as np
import pytest
from builders import alone, near, nodal_forces, off_differences, rotation, run
from mpi4py import MPI
from scipy import sparse
from scipy.integrate import solve_bvp
from scipy.interpolate import PchipInterpolator
from scipy.sparse.linalg import spsolve

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.energy.bending import shortest_wave

COMM = MPI.COMM_WORLD
PATTERNS = ["crossed", "left", "unstructured"]
D = 100 / 12  # that of the paper
KOMEILI, DC04 = ff.load("komeili"), ff.load_metal("dc04")


def sheet(length, width, nx, ny, pattern="unstructured", comm=COMM, shape=None, **options):
    """A sheet in space, centred at 0 before it is formed by `shape`."""

    def centred(points):
        points = points - [length / 2, width / 2, 0]
        return shape(points) if shape else points

    options |= {"shape": centred, "spatial": True}
    return builders.sheet(length, width, nx, ny, pattern, comm, **options)


def displace(blank, field):
    """Give the blank the displacement `field` (3, n) along x, y, z of points (3, n)."""
    u = blank.along(np.asarray(field(blank.coordinates().T), float)).T
    blank.u.x.array[:] = u.ravel()


def matrix(bending):
    """Stiffness on one rank."""
    rows, columns, values = bending.tangent()
    return sparse.csr_matrix((values, (rows, columns)), (len(bending.blank.u.x.array),) * 2)


def wavy(x):
    """A smooth displacement, in all directions, of points (3, n)."""
    up = np.sin(x[0] / 4 + 0.3) * np.cos(x[1] / 7 + 0.2)
    return np.array([0.4 * np.sin(x[1] / 5), 0.3 * np.cos(x[0] / 6), up])


@pytest.mark.versions
@pytest.mark.mpi
@pytest.mark.parametrize("pattern", PATTERNS)
def test_curvature_of_quadratic_fields_is_exact(pattern):
    a, b = np.array([math.cos(0.4), math.sin(0.4), 0]), np.array([math.cos(1.7), math.sin(1.7), 0])
    blank = sheet(20, 20, 8, 8, pattern, a=a, b=b)
    H = np.random.default_rng(3).normal(size=(3, 2, 2))
    H += H.swapaxes(1, 2)
    displace(blank, lambda x: 0.5 * np.einsum("kij,in,jn->kn", H, x[:2], x[:2]) + 0.3 * x + 2)
    found = alone(blank, ff.Bending(D)).curvatures()
    inside = np.abs(blank.midpoints()[:2]).max(0) < 10 - 2 * 2.5 * 1.1
    assert COMM.allreduce(int(inside.sum())) > 10
    for k, (first, second) in enumerate(((a, a), (b, b), (a, b))):
        exact = np.einsum("kij,i,j->k", H, first[:2], second[:2])
        assert np.abs(found[inside, k] - exact).max(initial=0) < 1e-10 * np.abs(H).max()


@pytest.mark.mpi
@pytest.mark.parametrize("pattern, angle", [*zip(PATTERNS, (45, 0, 90))])
def test_strips_in_pure_bending(pattern, angle):
    """Along a, b and the bias: energy D kappa^2 / 2 of the middle, free at its sides, 1 / D being
    1 / 4 D_a + 1 / 4 D_b + 1 / D_t at 45 deg, and no force within it: cells do no work on a
    constant moment."""
    D_a, D_b, D_t, kappa = 3.0, 1.7, 0.9, 1e-4
    blank = sheet(60.0, 20.0, 18, 6, pattern, a=math.radians(angle))
    blank.divide({"middle": lambda x: np.abs(x[0]) < 18.0}, "ends")
    bending = alone(blank, ff.Bending(D_a, D_b, D_t).on("middle"))
    stiffness = {0: D_a, 90: D_b, 45: 1 / (0.25 / D_a + 0.25 / D_b + 1 / D_t)}[angle]
    across, twist = 0.0, 0.0  # by curvature along
    if angle == 45:  # where the moment's parts conjugate to these curvatures are 1/2, 1/2 and -1
        a, b, ab = (stiffness * c for c in (0.5 / D_a, 0.5 / D_b, -1 / D_t))
        across, twist = (a + b) / 2 + ab, (a - b) / 2
    w = lambda x: kappa * (x[0] ** 2 / 2 + across * x[1] ** 2 / 2 + twist * x[0] * x[1])  # noqa: E731
    displace(blank, lambda x: [0 * x[0], 0 * x[0], w(x)])
    area = COMM.allreduce(blank.areas()[bending.part.cells].sum())
    energy = COMM.allreduce(bending.stored())
    assert energy == pytest.approx(stiffness * kappa**2 / 2 * area, rel=1e-5)
    f, x = nodal_forces(bending)[:, 2], blank.coordinates()[:, 0]
    assert COMM.allreduce(np.abs(f).max(initial=0), MPI.MAX) > 0.05 * stiffness * kappa
    inside = np.abs(x[: len(f)]) < 18.0 - 3 * 3.4
    assert np.abs(f[inside]).max(initial=0) < 1e-5 * stiffness * kappa


def on_an_arc(kappa, bending, fabric=KOMEILI, angle=0.0, nx=8, **membrane):
    """Energies of the cells of 1 mm that a strip of 2 nx mm has more than one of nx, both on an
    arc by chords as long as the cells, sides in planes of symmetry, over their area [N/mm]."""
    found = []
    for n in (nx, 2 * nx):
        blank = builders.sheet(n, 2.0, n, 2, "left", a=math.radians(angle), spatial=True)
        term = ff.Bending(**bending, symmetric=[near(1, 0.0), near(1, 2.0)])
        scene = ff.Scene(blank, [ff.Membrane(fabric, **membrane), term])
        X, R = blank.coordinates(), 0.5 / np.sin(kappa / 2)
        turn = kappa * X[:, 0]
        arc = np.array([R * np.sin(turn), X[:, 1], R * (1 - np.cos(turn))])
        blank.u.x.array[:] = (arc.T - X).ravel()
        found.append(scene.energies())
    return {kind: (found[1][kind] - found[0][kind]) / (2.0 * nx) for kind in found[0]}, term


@pytest.mark.parametrize("angle, stiffness", [(0, 3.2), (90, 1.4), (30, 2.54375)])
def test_an_arc_takes_the_energy_of_its_curvature(angle, stiffness):
    """D k^2 / 2 per area; D = D_a c^4 + D_b s^4 + D_t c^2 s^2 of yarns whose curvatures are k c^2,
    k s^2 and k c s. Cells turn by 11 deg; slopes instead of angles would take 1.3 % less."""
    for kappa in (0.02, -0.2):
        found, _ = on_an_arc(kappa, {"D_a": 3.2, "D_b": 1.4, "D_t": 3.5}, angle=angle)
        assert found["bending"] == pytest.approx(stiffness * kappa**2 / 2, rel=1e-3)


@pytest.mark.parametrize("angle, stiffness", [(0, 4.266667), (90, 4.266667), (45, 3.413333)])
def test_stiffness_of_moduli(angle, stiffness):
    """E t^3 / 12 along yarns and G t^3 / 3 of twist, of 100 and 30 MPa and 0.8 mm; within the sheet
    a share of these, which normal curvature does not lose."""
    moduli, thin = {"modulus": 100.0, "twist_modulus": 30.0}, KOMEILI.replace(thickness=0.8)
    thick, field = KOMEILI.replace(thickness=1.6), {"thickness": lambda x, y: 0.8 + 0 * x}
    for fabric, more, in_plane in ((thin, {}, 0.0), (thin, {}, 0.3), (thick, field, 0.0)):
        given = moduli | {"in_plane": in_plane}
        found, bending = on_an_arc(0.02, given, fabric, angle, **more)
        assert found["bending"] == pytest.approx(stiffness * 0.02**2 / 2, rel=1e-3)
        if fabric is thin:
            assert bending.stiffnesses == pytest.approx([4.266667, 4.266667, 5.12])


@pytest.mark.parametrize("angle, share, threshold", [(0, 1.0, 0.05), (90, 0.5, 0.02)])
@pytest.mark.parametrize("in_plane", [0.0, 0.3])
def test_measured_bending_of_each_face_and_yarn(angle, share, threshold, in_plane):
    """Less thresholds, which friction takes beyond 2 % of the largest curvature, the fabric's
    moment is a monotone cubic, of b half of a's, whatever bending within the sheet takes."""
    moments = {"moment_a": (-0.85, -0.05, 0.05, 0.55), "moment_b": (-0.42, -0.02, 0.02, 0.27)}
    measured = ff.MeasuredBending(curvature=(-0.1, 0, 0, 0.1), **moments)
    curve = PchipInterpolator([-0.2, -0.1, 0, 0.1, 0.2], [-1.6, -0.8, 0, 0.5, 1.0])
    start = float(curve.derivative()(0.0))
    fabric, field = KOMEILI.replace(bending=measured), {"thickness": lambda x, y: 0.7 + 0 * x}
    given = {"modulus": 1.0, "in_plane": in_plane}
    for kappa in (0.03, -0.03):
        found, bending = on_an_arc(kappa, given, fabric, angle, **field)
        exact = curve.integrate(0, kappa)
        assert found["bending"] == pytest.approx(share * exact, rel=1e-3)
        assert found["yarn_friction"] == pytest.approx(threshold * 0.029, rel=1e-3)
    assert bending.stiffnesses[:2] == pytest.approx([start, start / 2])
    cantilevers = ff.MeasuredBending(cantilever_a=200.0, cantilever_b=160.0)
    _, bending = on_an_arc(0.01, given, KOMEILI.replace(bending=cantilevers, thickness=0.5))
    assert bending.stiffnesses[:2] == pytest.approx([3.67875, 1.88352])


def test_friction_of_both_yarns_that_are_bent():
    """At 45 deg each by half of the curvature, 0.05 / mm: f (k - f / 2 k_f) beyond f / k_f."""
    friction = ff.BendingFriction((4.0, 1.0), (0.1, 0.2))
    found, _ = on_an_arc(0.1, {"D_a": 1.0}, KOMEILI.replace(bending_friction=friction), 45)
    each = 0.1 * (0.05 - 0.0125) + 0.05**2 / 2
    assert found["yarn_friction"] == pytest.approx(2 * each, rel=2e-3)


def test_shortest_wave_of_a_yarn_that_buckles():
    """2 pi sqrt(D / (2 d t eps)), d = 0.65 MPa: 159 mm with the paper's numbers."""
    assert shortest_wave(KOMEILI, D, 0.01) == pytest.approx(159.1, abs=0.05)
    thin = KOMEILI.replace(thickness=0.5)
    assert shortest_wave(thin, 1.0, 0.02) == pytest.approx(55.11, abs=0.01)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_bending_of_yarns_in_the_sheet(pattern):
    """Yarns a take the shape of cosines between two planes of symmetry, the sides are free."""
    D_a, beta, L, errors = 2.0, 0.3, 20.0, []
    k = math.pi / L
    for n in (8, 16, 32):
        blank = builders.sheet(L, L, n, n, pattern, a=0.0, spatial=n != 16)  # or in a plane
        displace(blank, lambda x: [0 * x[0], np.cos(k * x[0]), 0 * x[0]][: 2 + (n != 16)])  # noqa: B023
        bending = ff.Bending(D_a, 0.7, 0.5, beta, symmetric=[near(0, 0.0), near(0, L)])
        alone(blank, bending)
        errors.append(abs(bending.stored() / (0.25 * beta * D_a * k**4 * L**2) - 1))
    assert errors[0] < 0.03 and errors[1] < 0.6 * errors[0] and errors[2] < 0.6 * errors[1]


def grid(length, width, nx, ny, pattern):
    """A plane sheet at 0/90; `alternate`: squares cut by one diagonal or the other in turn, which
    are `crossed` ones turned by 45 deg."""
    if pattern != "alternate":
        return builders.sheet(length, width, nx, ny, pattern, MPI.COMM_SELF)
    sides = np.linspace(0, length, nx + 1), np.linspace(0, width, ny + 1)
    x, (i, j) = np.stack(np.meshgrid(*sides), 2).reshape(-1, 2), np.indices((nx, ny)).reshape(2, -1)
    up = nx + 1
    ring = np.array([0, 1, up + 1, up])[:, None] + i + up * j
    a, b, c, d = np.where((i + j) % 2, np.roll(ring, -1, 0), ring)
    return ff.Blank.from_arrays(MPI.COMM_SELF, x, np.hstack([[a, b, c], [a, c, d]]).T, "triangle")


@pytest.mark.parametrize("pattern", ["crossed", "left", "alternate"])
def test_layer_of_shear_between_clamped_edges(pattern):
    """Of yarns b that hardly stretch, across it: gamma = g (1 - cosh(y / l) / cosh(H / 2 l)) from
    the middle, l = sqrt(B / G t), under the force G g t per length."""
    H, L, l, G = 40.0, 5.0, 6.0, 0.02506
    strip, moved = grid(L, H, 5, 40, pattern), 4e-4
    stiff = [ff.Yarn(b=E, d=E) for E in (2e4, 200.0)]
    membrane = ff.Membrane(ff.WovenFabric(*stiff, s1=G, thickness=1.0))
    ends = low, high = near(1, 0.0), near(1, H)
    bending = ff.Bending(D_a=0.0, in_plane_stiffness=G * l**2, clamped=ends)
    supports = [ff.Support("low", low, (0, 1)), ff.Support("high", high, (0,), (moved, 0.0, 0.0))]
    supports += [ff.Support("all", lambda x: x[1] > -1, (1,))]
    run(scene := ff.Scene(strip, [membrane, bending], supports), 1)
    g = moved / (H - 2 * l * np.tanh(H / 2 / l))
    assert sum(scene.energies().values()) == pytest.approx(0.5 * G * g * moved * L, rel=5e-3)
    y = strip.coordinates()[:, 1] - H / 2
    exact = moved / 2 + g * (y - l * np.sinh(y / l) / np.cosh(H / 2 / l))
    assert strip.nodal_displacement()[:, 0] == pytest.approx(exact, abs=3e-3 * moved)


@pytest.mark.parametrize("pattern", ["crossed", "left", "alternate"])
def test_yarns_on_arcs_within_the_sheet(pattern):
    """All alike along b, with a radius of 60 mm: B / (2 R^2) of an area, as of what a sheet of 70
    deg has more than one of 35. Middles of `crossed` squares, which yarns hold, are at the means of
    the corners. What is homogeneous, a large rotation among it, takes nothing."""
    B, R, h, energies = 2.0, 60.0, 36.65 / 16, []
    for n in (16, 32):
        bending = ff.Bending(D_a=0.0, in_plane_stiffness=B)
        alone(blank := grid(n * h, 20.0, n, 8, pattern), bending)
        X = blank.coordinates()[:, :2]
        arc = lambda s: np.array([R * np.sin(s / R), R * (1 - np.cos(s / R))])  # noqa: E731
        middle = abs(X[:, 0] / h % 1 - 0.5) < 0.1
        between = (arc(X[:, 0] - h / 2) + arc(X[:, 0] + h / 2)) / 2
        now = np.where(middle, between, arc(X[:, 0])).T + X * [0, 1]
        blank.u.x.array[:] = (now - X).ravel()
        energies.append(bending.stored())
    assert energies[1] - energies[0] == pytest.approx(B / (2 * R**2) * 36.65 * 20.0, rel=5e-3)
    for F in (rotation(1)[:2, :2] + np.eye(2), [[1.1, 0.3], [0.1, 0.9]], [[0, -1], [1, 0]]):
        blank.u.x.array[:] = (X @ np.transpose(F) - X).ravel()
        assert abs(bending.stored()) < 1e-8 * energies[1]


@pytest.mark.parametrize("pattern, in_plane", [*zip(PATTERNS, (0, 0.3, 1))])
def test_only_linear_fields_are_free_of_energy(pattern, in_plane):
    blank = sheet(4, 4, 4, 4, pattern, MPI.COMM_SELF, a=0.3)
    bending = alone(blank, ff.Bending(1.0, 0.5, 0.7, in_plane=in_plane))
    K = matrix(bending).toarray()
    assert np.abs(K - K.T).max() <= 1e-14 * np.abs(K).max()
    if not in_plane:
        K = K[2::3, 2::3]
    stiffness = np.linalg.eigvalsh(K)
    free = 9 if in_plane else 3
    assert np.abs(stiffness[:free]).max() < 1e-12 * stiffness[-1]
    assert stiffness[free] > 1e-3 * min(in_plane or 1, 1) * stiffness[-1]


def deflection(blank, bending, held):
    """Of the nodes of a flat blank under a unit pressure, zero where `held` (nodes,)."""
    K, free = matrix(bending)[2::3, 2::3], np.flatnonzero(~held)
    load = np.bincount(compat.dofmap(blank.V).ravel(), np.repeat(blank.areas() / 3, 3))
    w = np.zeros(len(held))
    w[free] = spsolve(K[free][:, free].tocsc(), load[free])
    return w


@pytest.mark.parametrize("pattern, clamped", [("left", 0), *((each, 1) for each in PATTERNS)])
def test_square_plate(pattern, clamped):
    """Deflection at the centre of an isotropic plate, simply supported (Navier) and clamped
    (0.00126532 q L^4 / D)."""
    m, n = np.meshgrid(np.arange(1, 60, 2), np.arange(1, 60, 2))
    navier = (16 / np.pi**6 * (-1.0) ** ((m + n) // 2 - 1) / (m * n * (m**2 + n**2) ** 2)).sum()
    exact, errors = 0.00126532 if clamped else navier, []
    for n in (8, 32):
        blank = sheet(1, 1, n, n, pattern, MPI.COMM_SELF, a=0.3)
        rim = lambda x: (0.5 - np.abs(x[:2])).min(0) < 1e-9  # noqa: E731
        bending = alone(blank, ff.Bending(1.0, 1.0, 2.0, clamped=rim if clamped else ()))
        x = blank.coordinates()
        w = deflection(blank, bending, rim(x.T))
        # of which the middle one may lie beside the centre
        near = np.linalg.norm(x, axis=1).argsort()[:8]
        r = np.linalg.norm(x[near], axis=1)
        centre = np.linalg.lstsq(np.column_stack([np.ones(8), r**2]), w[near], rcond=None)[0][0]
        errors.append(abs(centre / exact - 1))
    assert errors[1] < min(0.02 if clamped else 0.005, 0.5 * errors[0])


def test_elastica_under_its_own_weight():
    """A clamped strip, of an isotropic plate, that sags by 64 % of its length."""
    L, q, errors = 100.0, 8 * D / 100.0**3, []

    def slope(s, y):  # of its angle, curvature and place
        return y[1], -q * (L - s) * np.cos(y[0]) / D, np.cos(y[0]), np.sin(y[0])

    s, ends = np.linspace(0, L, 100), lambda a, b: np.array([a[0], b[1], a[2], a[3]])
    x, z = solve_bvp(slope, ends, s, [0 * s, 0 * s, s, 0 * s], tol=1e-6).y[2:, -1]
    assert z > 0.6 * L
    for nx in (12, 24):
        blank = sheet(L, 25.0, nx, nx // 4, comm=MPI.COMM_SELF, a=math.pi / 4)
        clamp = near(0, -L / 2)
        plate = builders.Elastic(120 * D), ff.Bending(D, D, 2 * D, clamped=clamp)
        load = ff.DeadPressure(q, (0, 0, 1))
        run(ff.Scene(blank, [*plate, load], [ff.Support("clamp", clamp, (0, 1, 2))]), 5)
        end = near(0, L / 2)(blank.coordinates().T)
        now = (blank.coordinates() + blank.nodal_displacement())[end].mean(0)
        errors.append(math.hypot(now[0] + L / 2 - x, now[2] - z) / L)
    assert errors[0] < 0.02 and errors[1] < 0.6 * errors[0]


def test_curved_sheet_is_at_rest_undeformed():
    """A quarter of a tube needs no energy, however it moves; unrolled, that of its curvature."""
    radius, kappa, Q = 20.0, 1 / 20.0, rotation(2)

    def tube(x):
        t = x[:, 0] * kappa
        return np.column_stack([radius * np.sin(t), x[:, 1], radius * (1 - np.cos(t))])

    blank = sheet(math.pi / 2 * radius, 10.0, 32, 10, shape=tube, a=np.array([1.0, 0, 0]))
    bending = alone(blank, ff.Bending(D, 0.5 * D, 0.5 * D))
    scale = 0.5 * D * kappa**2 * blank.areas().sum()
    own = np.linalg.norm(bending.curvatures()[np.abs(blank.midpoints()[1]) < 2, 0], axis=1)
    assert np.median(own) == pytest.approx(kappa, rel=0.01)
    for motion in (lambda x: 0 * x, lambda x: (Q - np.eye(3)) @ x + 4):
        displace(blank, motion)
        bending.accept()
        assert bending.stored() < 1e-20 * scale
        assert np.abs(nodal_forces(bending)).max() < 1e-10 * scale
    displace(blank, lambda x: [radius * np.arctan2(x[0], radius - x[2]) - x[0], 0 * x[0], -x[2]])
    bending.accept()  # ends are free: they keep no curvature to lose
    assert bending.stored() == pytest.approx(scale, rel=0.06)


@pytest.mark.parametrize(
    "make", [lambda **held: ff.Bending(2, 1, 0.7, 0.3, **held), partial(ff.SheetMetal, DC04)]
)
def test_half_of_a_symmetric_sheet_has_half_of_its_energy(make):
    found = []
    for length in (20, 10):
        blank = builders.sheet(length, 10, length * 2 // 5, 4, "crossed", spatial=True)
        plane = {"symmetric": near(0, 0.0)} if length == 10 else {}
        term, middle = alone(blank, make(**plane)), 10.0 if length == 20 else 0.0
        x, y = blank.coordinates()[:, 0] - middle, blank.coordinates()[:, 1]
        u = 0.3 * np.sin(x / 4) * np.cos(y / 5), 0.2 * np.cos(x / 5) * np.sin(y / 3)
        blank.u.x.array[:] = np.column_stack([*u, np.cos(x / 4) * np.cos(y / 7 + 0.2)]).ravel()
        found.append(term.stored())
    assert found[0] == pytest.approx(2 * found[1], rel=1e-10)


@pytest.mark.versions
@pytest.mark.parametrize("in_plane", [0, 0.4])
def test_forces_and_stiffness_are_derivatives(in_plane):
    blank = sheet(20, 20, 6, 6, comm=MPI.COMM_SELF, a=0.4, b=1.8)
    held = {"symmetric": [near(0, -10), near(1, -10)], "clamped": near(0, 10)}
    bending = alone(blank, ff.Bending(2.0, 1.0, 0.7, in_plane, **held))
    displace(blank, wavy)
    assert off_differences(bending, h=1e-5) < 1e-8
