"""The kernel against the UFL energy and against derivatives of eq. (30) written a third time, case
by case."""

import dolfinx
import mpmath
import numpy as np
import pytest
import ufl
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.energy.membrane_energy import energy_density
from fabric_fenicsx.material import kernel
from fabric_fenicsx.material.laws import COUPLINGS
from fabric_fenicsx.material.laws.tabulated import Curve, TabulatedFabric
from fabric_fenicsx.material.presets import PRESETS


def relative(value, reference):
    axes = tuple(range(1, reference.ndim))
    return np.sqrt(((value - reference) ** 2).sum(axes) / (reference**2).sum(axes))


def cases(fabric, C, a, b, lib, weave=None):
    """W_tot exactly as eqs (13)-(30) list it, with branches, for one point; lib is mpmath or numpy;
    weave: angle from which gamma counts, the initial one in eq. (8)."""
    I4 = a[0] * (C[0] * a[0] + C[2] * a[1]) + a[1] * (C[2] * a[0] + C[1] * a[1])
    I8 = b[0] * (C[0] * b[0] + C[2] * b[1]) + b[1] * (C[2] * b[0] + C[1] * b[1])
    I6 = a[0] * (C[0] * b[0] + C[2] * b[1]) + a[1] * (C[2] * b[0] + C[1] * b[1])
    acos = getattr(lib, "acos", None) or lib.arccos
    rest = acos(a[0] * b[0] + a[1] * b[1]) if weave is None else weave
    gamma = rest - acos(I6 / lib.sqrt(I4 * I8))
    g = gamma if gamma.real >= 0 else -gamma
    ea, eb = lib.sqrt(I4) - 1, lib.sqrt(I8) - 1
    w, f = fabric.warp, fabric.weft
    kTCa = (1 - w.p_min) * lib.exp(w.c * eb) + w.p_min
    kTCb = (1 - f.p_min) * lib.exp(f.c * ea) + f.p_min
    WTa, WTb = (w.a * ea**3 + w.b * ea**2) * kTCa, (f.a * eb**3 + f.b * eb**2) * kTCb
    WCa, WCb = w.d * ea**2, f.d * eb**2
    WS = fabric.s1 * g**2 / 2 + fabric.s2 * g**3 / 3 + fabric.s3 * g**4 / 4
    WSTa, WSTb = g**3 * w.s_T * (I4 - 1) ** 2 / 3, g**3 * f.s_T * (I8 - 1) ** 2 / 3
    kSCa, kSCb = lib.exp(w.s_C * (I4 - 1) ** 3), lib.exp(f.s_C * (I8 - 1) ** 3)
    if I4.real > 1 and I8.real > 1:
        return WTa + WTb + WS + WSTa + WSTb
    if I4.real > 1:
        return WTa + WCb + (WS + WSTa) * kSCb
    if I8.real > 1:
        return WCa + WTb + (WS + WSTb) * kSCa
    return WCa + WCb + WS * kSCa * kSCb


def through_ufl(fabric, C, a0, b0, weave=None):
    """Energy, S and dS/dE (Voigt) of the UFL energy, a point in each cell of a mesh; weave: as in
    `cases`."""
    mesh = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 1, len(C) // 2)
    data = dolfinx.fem.Function(compat.vector_space(mesh, "DG", 0, 7))
    data.x.array[:] = np.column_stack([C[:, 0, 0], C[:, 1, 1], C[:, 0, 1], a0, b0]).ravel()
    Cv = ufl.variable(ufl.as_matrix([[data[0], data[2]], [data[2], data[1]]]))
    a, b, Cs = ufl.as_vector([data[3], data[4]]), ufl.as_vector([data[5], data[6]]), ufl.sym(Cv)
    cosine = ufl.dot(a, b) if weave is None else dolfinx.fem.Constant(mesh, np.cos(weave))
    W = energy_density(ufl.dot(a, Cs * a), ufl.dot(a, Cs * b), ufl.dot(b, Cs * b), cosine, fabric)
    S = 2 * ufl.diff(W, Cv)
    D = 2 * ufl.diff(S, Cv)
    pairs = [(0, 0), (1, 1), (0, 1)]
    values = [W] + [S[p] for p in pairs] + [D[(*p, *q)] for p in pairs for q in pairs]
    values = compat.PointEvaluation(ufl.as_vector(values), mesh, 1)()[:, 0]
    return values[:, 0], values[:, 1:4], values[:, 4:].reshape(-1, 3, 3)


def voigt(S):
    return np.stack([S[:, 0, 0], S[:, 1, 1], S[:, 0, 1]], -1)


def agreed(law, states, weave=None):
    """The kernel's state, whose energy, stress and tangent UFL has, too."""
    C, a0, b0 = states
    fibres = a0, b0
    state = kernel.evaluate(law, cauchy_green=C, fibres=fibres, tangent=True, weave_angle=weave)
    W, S, D = through_ufl(law, C, a0, b0, weave)
    assert relative(W, state.energy).max() <= 1e-12
    assert relative(S, voigt(state.S)).max() <= 1e-12
    assert relative(D, state.tangent).max() <= 1e-12
    return state


@pytest.mark.versions
@pytest.mark.parametrize("off", [(), *[(name,) for name in COUPLINGS], COUPLINGS])
def test_agrees_with_ufl_on_many_states(unbalanced, random_states, off):
    state = agreed(unbalanced.without(*off), random_states(4_000))
    assert [(state.strain_state == k).sum() > 200 for k in (1, 2, 3, 4)] == [True] * 4
    assert np.degrees(np.abs(state.invariants[:, 3])).max() > 79


@pytest.mark.parametrize("extrapolation", ["constant", "linear"])
def test_tables_agree_with_ufl_within_and_beyond(random_states, extrapolation):
    warp = Curve((-0.05, 0.0, 0.01, 0.03), (-0.5, 0.0, 35.0, 135.0), extrapolation)
    weft = Curve((0.0, 0.02, 0.06), (0.0, 28.0, 90.0), extrapolation)
    table = TabulatedFabric(warp, weft, Curve((0.0, 0.4, 0.8), (0.0, 0.1, 0.05), extrapolation))
    agreed(table, random_states(2_000))


@pytest.mark.parametrize("weave", [None, np.radians(70), np.radians(115)])
def test_energy_and_stress_are_those_of_the_cases(unbalanced, random_states, weave):
    """By complex steps, with shear from the initial angle or that of the weave."""
    C, a0, b0 = random_states(1_000, seed=4)
    state = agreed(unbalanced, (C, a0, b0), weave)
    energy, gradient = np.empty(len(C)), np.empty((len(C), 3))
    for n, (Cn, a, b) in enumerate(zip(voigt(C), a0, b0)):
        for k in range(3):
            step = Cn.astype(complex)
            step[k] += 1e-30j
            W = cases(unbalanced, step, a, b, np, weave)
            energy[n], gradient[n, k] = W.real, 2 * W.imag / 1e-30
    gradient[:, 2] /= 2  # C12 stands for two entries
    # arccos loses digits towards 0 and 180 deg: so 1e-11 and not 1e-12
    assert relative(state.energy, energy).max() <= 1e-11
    assert relative(gradient, voigt(state.S)).max() <= 1e-11


@pytest.mark.versions
def test_tangents_agree_with_mpmath(unbalanced, random_states):
    C, a0, b0 = random_states(20, seed=3)
    state = kernel.evaluate(unbalanced, cauchy_green=C, fibres=(a0, b0), tangent=True)
    assert len({*state.strain_state}) == 4
    half, orders = np.array([1.0, 1.0, 0.5]), np.eye(3, dtype=int)
    with mpmath.workdps(40):
        for Cn, a, b, exact in zip(voigt(C), a0, b0, state.tangent):
            place = tuple(mpmath.mpf(float(v)) for v in Cn)
            a, b = ([mpmath.mpf(float(v)) for v in d] for d in (a, b))
            for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)):
                order = (orders[i] + orders[j]).tolist()
                W = mpmath.diff(lambda *c: cases(unbalanced, c, a, b, mpmath), place, order)
                error = 4 * float(W) * half[i] * half[j] - exact[i, j]
                assert abs(error) < 1e-12 * np.linalg.norm(exact)


def test_measures_layouts_and_rotations_agree(unbalanced, random_states):
    C, a0, b0 = random_states(200)
    w, V = np.linalg.eigh(C)
    U = np.einsum("nik,nk,njk->nij", V, np.sqrt(w), V)
    t = np.linspace(0, 6, len(C))
    R = np.stack([np.cos(t), -np.sin(t), np.sin(t), np.cos(t)], -1).reshape(-1, 2, 2)
    in_space, none = np.pad(R @ U, ((0, 0), (0, 1), (0, 0))), np.eye(2)
    of_U = kernel.evaluate(unbalanced, stretch=np.repeat(U, 2, axis=0)[::2], fibres=(a0, b0))
    for name, given, turn in (
        ("cauchy_green", np.asfortranarray(C), none),
        ("gradient", R @ U, R),
        ("gradient", in_space, R),
    ):
        state = kernel.evaluate(unbalanced, **{name: given}, fibres=(a0, b0))
        assert relative(state.S, of_U.S).max() <= 1e-11  # U from an eigensolver
        turned = turn @ of_U.cauchy @ turn.swapaxes(-1, -2)
        assert relative(state.cauchy[:, :2, :2], turned).max() <= 1e-11
    one = kernel.evaluate(unbalanced, stretch=U[0], fibres=(a0[0], b0[0]))
    assert np.array_equal(one.S[0], of_U.S[0])


def test_states_of_strain_and_signs():
    """1 both in tension, 2 b compressed, 3 a, 4 both; no strain counts as compression."""
    stretch = [np.diag(v) for v in ((1.01, 1.02), (1.01, 1.0), (0.99, 1.01), (1.0, 1.0))]
    found = kernel.evaluate(PRESETS["komeili"], stretch=stretch)
    assert found.strain_state.tolist() == [1, 2, 3, 4]
    gradient = [[[1.0, s * 0.3], [0.0, 1.0]] for s in (1, -1)]
    gamma = kernel.evaluate(PRESETS["komeili"], gradient=gradient).invariants[:, 3]
    assert gamma == pytest.approx([np.arctan(0.3), -np.arctan(0.3)])
    state = kernel.evaluate(PRESETS["komeili"], stretch=np.eye(2), tangent=True)
    assert state.energy[0] == 0 and np.all(state.S == 0)
    assert state.tangent[0] == pytest.approx(np.diag([1.3, 1.3, 25.06e-3]))
