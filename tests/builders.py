"""Sheets, terms and runs that several tests share."""

import json
from contextlib import contextmanager
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from petsc4py import PETSc
from scipy import sparse

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.energy.term import Term, bind
from fabric_fenicsx.material.presets import load
from fabric_fenicsx.sheet.blank import Blank
from fabric_fenicsx.sheet.specimen import specimen
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings
from fabric_fenicsx.solve.stepping import LoadStepping

COMM = MPI.COMM_WORLD
KOMEILI = load("komeili")
COARSE = {"nx": 8, "element": "P1"}  # a strip that is pulled in a moment


def dome_press(
    fabric=None, plies=None, surface=None, holder=None, changes=(), stroke=None, full=False, **given
):
    """The press of the double dome with these changes, stroke [mm] and fields of its sheet and
    interface; plies: fields in which each differs from the sheet; surface: of the punch."""
    tables = {f.name: "contact" for f in fields(ff.Interface)}
    words = [f"{tables.get(name, 'blank')}.{name}={json.dumps(v)}" for name, v in given.items()]
    words += [f"stage.1.moves.punch={stroke}"] * (stroke is not None)
    words += ["blank.symmetry=none"] * full
    press = ff.Press.read("double_dome", [*words, *changes])
    sheet, tools = press.sheets[0], dict(press.tools)
    sheet = replace(sheet, fabric=fabric or sheet.fabric)
    sheets = [sheet] if plies is None else []
    for k, own in enumerate(plies or [], 1):
        metal = {"fabric": None} if "metal" in own else {}
        sheets.append(replace(sheet, **{"name": f"ply {k}"} | metal | own))
    if surface is not None:
        tools["punch"] = replace(tools["punch"], surface=surface)
    holders = press.holders if holder is None else {"blank holder": holder}
    return press.replace(sheets=sheets, tools=tools, holders=holders)


def dome(*args, comm=None, **given):
    """That press, built."""
    return dome_press(*args, **given).build(comm)


def sheet(
    length,
    width,
    nx,
    ny,
    pattern="crossed",
    comm=COMM,
    *,
    cell="triangle",
    shape=None,
    turn=None,
    spatial=False,
    **options,
):
    """A rectangle from the origin on, in its plane or, if `spatial`, free to leave it.

    shape: forms it, a function of its points (n, 3); turn: a rotation (3, 3) that takes it, with
    its frame, elsewhere.
    """
    points = cells = kind = None
    if comm.rank == 0:
        points, cells, kind = specimen(length, width, nx, ny, pattern, cell)
        points = shape(points) if shape else points
        points = points @ turn.T if turn is not None else points
    if turn is not None:
        plane = not spatial and turn[2, 2] == 1
        options |= {"frame": turn[:2, :2].T} if plane else {"frame": turn.T, "up": turn[:, 2]}
    return Blank.from_arrays(comm, points, cells, kind, spatial=spatial, **options)


def bent(radius, angle, tail):
    """Shape that lays a strip along x over a cylinder about y through the origin, with straight
    tails, and the unit vectors along which these leave it, at its low and high end."""

    def shape(x):
        s = x[:, 0] - tail - radius * angle / 2
        t = np.clip(s / radius, -angle / 2, angle / 2)
        beyond = s - t * radius
        along, up = radius * np.sin(t), radius * np.cos(t)
        return np.column_stack([along + beyond * np.cos(t), x[:, 1], up - beyond * np.sin(t)])

    c, s = np.cos(angle / 2), np.sin(angle / 2)
    return shape, (-c, 0, -s), (c, 0, -s)


def slit_strip():
    """Points, cells and their kind of 8 x 2 mm with a slit from (2, 1) to (6, 1), whose lips have
    nodes of their own."""
    points, cells, kind = specimen(8, 2, 8, 2, "right")
    lips = np.flatnonzero((points[:, 1] == 1) & (points[:, 0] > 2) & (points[:, 0] < 6))
    own = np.arange(len(points))
    own[lips] = len(points) + np.arange(len(lips))
    cells = np.where((points[cells, 1].mean(1) > 1)[:, None], own[cells], cells)
    return np.vstack([points, points[lips]]), cells, kind


def rotation(seed=0):
    """A rotation in space."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


def near(axis, position):
    return lambda x: np.abs(x[axis] - position) < 1e-6


def everywhere(x):
    return np.full(x.shape[-1], True)


def displacement(blank):
    """Of the owned nodes along x, y, z, (nodes, gdim)."""
    return blank.nodal_displacement()[: blank.V.dofmap.index_map.size_local]


@contextmanager
def compiled_as_it_stands():
    """Without the C compiler's optimiser, which takes 20 s for long forms that are run little."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compat, "C_FLAGS", ["-O0"])
        yield


class Alone(SimpleNamespace):
    """What a scene tells its terms, which refer to it weakly, without one."""


def alone(blank, *terms):
    """Bind terms to a sheet without a scene, to test them by themselves; the first of them."""
    scene = Alone(blank=blank, terms=terms)
    for term in terms:
        bind(term, scene)
    return terms[0]


class Springs(Term):
    """A bedding that is no form: a spring of k [N/mm] at each component of each node."""

    name = energy_kind = "springs"

    def __init__(self, k=0.5):
        self.k = k

    def u(self):
        gdim = self.blank.mesh.geometry.dim
        return self.blank.u.x.array[: gdim * self.blank.V.dofmap.index_map.size_local]

    def stored(self):
        return 0.5 * self.k * float(self.u() @ self.u())

    def add_forces(self, f):
        f[: len(self.u())] += self.k * self.u()

    def tangent(self):
        first = self.blank.mesh.geometry.dim * self.blank.V.dofmap.index_map.local_range[0]
        dofs = first + np.arange(len(self.u()), dtype=np.int32)
        return dofs, dofs, np.full(len(dofs), self.k)


class Elastic(Term):
    """An isotropic membrane of `stiffness` E h [N/mm], linear in Green's strain."""

    name, energy_kind = "elastic", "strain"

    def __init__(self, stiffness=1e3, nu=0.0):
        self.stiffness, self.nu = stiffness, nu

    def set_up(self, scene):
        blank, nu = scene.blank, self.nu
        a, b = (f + ufl.dot(ufl.grad(blank.displacement), f) for f in (blank.a0, blank.b0))
        e, f, g = (ufl.dot(a, a) - 1) / 2, (ufl.dot(b, b) - 1) / 2, ufl.dot(a, b) / 2
        density = (1 - nu) * (e**2 + f**2 + 2 * g**2) + nu * (e + f) ** 2
        dx = ufl.dx(blank.mesh, metadata={"quadrature_degree": 1})
        self.energy = self.stiffness / (2 * (1 - nu**2)) * density * dx


def march(newton, steps=20, *, start=None, on_accept=None, on_reject=None, **options):
    """Step to full load, every state to the solver's own tolerance; the `Outcome`."""
    settings = Settings(**{"path_tolerance": None} | options, steps=steps)
    told = {"on_accept": on_accept, "on_reject": on_reject}
    told = {name: listener for name, listener in told.items() if listener}
    return LoadStepping(newton, settings, start, **told).run()


def run(scene, steps=4, tolerance=1e-8, **options):
    """March to full load; all accepted states."""
    states = []
    outcome = march(Newton(scene, tolerance), steps, on_accept=states.append, **options)
    assert not outcome.reason, outcome.reason
    return states


def nodal_forces(term):
    """Derivative of a term's energies on this rank's owned nodes (nodes, gdim), by all ranks."""
    vector = compat.petsc_vector(term.blank.u).duplicate()
    with vector.localForm() as local:
        local.set(0)
        term.add_forces(local.array)
    vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
    return vector.array.reshape(-1, term.blank.mesh.geometry.dim).copy()


def off_differences(term, by=0.0, h=2e-6):
    """How far forces and tangent of a term on one rank are from differences, over their largest;
    by: displacement of the sheets at random from where they are [mm]."""
    u, rng = term.blank.u.x.array, np.random.default_rng(0)
    at, d = u + by * rng.uniform(-1, 1, len(u)), rng.uniform(-1, 1, len(u))

    def state(place):
        u[:] = place
        f = np.zeros(len(u))
        term.add_forces(f)
        return f, term.stored()

    f = state(at)[0]
    rows, cols, values = term.tangent()
    K = sparse.csr_matrix((values, (rows, cols)), (len(u),) * 2)
    assert abs(K - K.T).max() <= 1e-12 * abs(K).max()
    Kd = K @ d
    if yields := term.compliance():  # a tool moved by force
        Kd -= yields[0] * (yields[0] @ d) / yields[1]
    (f1, e1), (f2, e2), (g1, d1), (g2, d2) = (state(at + i * h * d) for i in (1, 2, -1, -2))
    change = (8 * (f1 - g1) - (f2 - g2)) / (12 * h)
    rise = (8 * (e1 - d1) - (e2 - d2)) / (12 * h)
    u[:] = at
    return max(abs(rise - f @ d) / abs(f * d).sum(), abs(change - Kd).max() / abs(Kd).max())


def said(summary):
    """Warnings of a summary, and reasons of its verdict, as texts."""
    return [*summary["warnings"], *(reason["text"] for reason in summary["reasons"])]
