"""Check of the derivatives that a law, a term or a surface gives, by finite differences."""

from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from ..material.laws import Law
from ..mechanics.assembly import Assembly
from ..mechanics.term import Term
from ..mechanics.term_checks import check_answers
from ..runtime.errors import InputError
from ..runtime.rules import FINITE, POSITIVE
from ..scene.scene import Scene
from ..tools.implicit import ImplicitSurface
from ..tools.surfaces import Surface

ALLOWED = 1e-4  # difference, over the largest of its kind
KINKS = 0.02  # share of states or points at which a derivative may jump between both sides
RANGES = np.array([[-0.05, 0.05], [-0.05, 0.05], [-0.8, 0.8]])  # eps_a, eps_b, gamma
TINY = 1e-300
NO_FORCES = "the term gives no forces here: nothing was compared"


class Row(NamedTuple):
    """Names of the compared quantities, their largest difference over the largest of its kind (NaN
    where there is no number) and its place; words: of a message about it."""

    names: str
    off: float
    where: str
    words: str = ""

    def message(self) -> str:
        """Sentence on a difference that is too large."""
        if np.isnan(self.off):
            return f"{self.names} are not numbers {self.where}"
        words = self.words or f"{self.names} differ by"
        return f"{words} {self.off:.2g} of the largest {self.where}"


def check_derivatives(
    thing: Law | Surface | Term, at: Any = None, *, load: float = 1.0, size: float | None = None
) -> str:
    """Compare the derivatives that an object gives with finite differences.

    - A law: stresses with differences of its energy, tangents with those of its stresses; energy
      and stress at rest, which must be 0; energy, which must be least there.
    - A surface: normal and curvature with differences of the gap; the gap with the distance to the
      surface; curvature with `radii`.
    - A term: forces with differences of its energy, tangent with those of its forces, where the
      sheet is and displaced by about `size`. The term is at load 0 afterwards, the sheet where it
      was.

    Parameters
    ----------
    thing
        A law, a surface, or a term of a scene.
    at
        Of a law: states (n, 3) of eps_a, eps_b [-] and gamma [rad], by default random ones. Of a
        surface: points (n, 3) near it [mm]. Of a term: its scene.
    load
        Load factor at which a term is checked.
    size
        Displacement of the sheet for a term [mm], by default 1/1000 of a cell.

    Returns
    -------
    str
        Table of the differences, with a remark if an energy of a term is below 0.

    Raises
    ------
    InputError
        With the table, if a difference is above 1e-4; 2 % of the states of laws and surfaces may
        be. Also where an energy or a gap is not a number.

    Examples
    --------
    >>> print(ff.check_derivatives(ff.Sphere(radius=30), [[10.0, 5.0, 31.0]]).splitlines()[0])
    surface Sphere: derivatives agree with differences
    """
    remarks: list[str] = []
    FINITE.check("`load`", load)
    if size is not None:
        POSITIVE.check("`size`", size)
    if isinstance(thing, Law):
        name, rows = f"law {thing.law}", [*_of_law(thing, at)]
    elif isinstance(thing, Surface):
        name, rows = f"surface {type(thing).__name__}", [*_of_surface(thing, at)]
    elif isinstance(at, Scene) and thing in at.terms:
        name, (rows, remarks) = f"term {thing.name}", _of_term(thing, at, load, size)
    else:
        raise InputError(
            f"no derivatives of {thing!r} can be checked at {at!r}; allowed are a law, a surface "
            "with points, and a term with its scene"
        )
    table = "\n".join(f"{row.names:<45} {row.off:9.1e}  {row.where}" for row in rows)
    for row in rows:  # the first, as what follows from it is off, too
        if not row.off <= ALLOWED:
            raise InputError(f"{name}: {row.message()}; allowed is {ALLOWED:g}\n{table}")
    head = remarks.pop() if NO_FORCES in remarks else "derivatives agree with differences"
    return "\n".join([f"{name}: {head}\n{table}", *remarks])


def _place(point):
    return f"at ({', '.join(f'{v:.4g}' for v in point)})"


def _row(names, given, found, places, kinks=KINKS):
    """The difference of `given` and `found` (n, ...) at that of the `places` (n, k) which is the
    worst but for the share `kinks` of them."""
    off = abs(given - found).reshape(len(places), -1).max(1)
    off[np.isnan(off)] = np.inf
    i = np.argsort(off)[int((1 - kinks) * (len(off) - 1))]
    scale = max(np.nanmax(abs(given), initial=0), np.nanmax(abs(found), initial=0), TINY)
    return Row(names, float(off[i] / scale) if np.isfinite(off[i]) else np.nan, _place(places[i]))


def _central(f, x, h):
    """Differences of f at x (n, 3) along each of the three axes, (..., 3)."""
    return np.stack([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(3)], -1)


# -- laws


def _of_law(law, at):
    def energy(x):
        with np.errstate(all="ignore"):  # sides of a case that do not count
            return sum(part + np.zeros(len(x)) for part in law.parts(*x.T))

    def stresses(x):
        return law.derivatives(*np.ascontiguousarray(x.T), False).first.T

    law.check_rest()
    low, high = RANGES.T
    drawn = np.random.default_rng(0).uniform(low, high, (500, 3))
    x = drawn if at is None else np.asarray(at, float)
    every = np.vstack([np.zeros((1, 3)), x])
    W = energy(every)
    for lost in every[~np.isfinite(W)]:
        raise InputError(
            f"law {law.law}: the energy is not a number {_place(lost)}; allowed is one at every "
            "eps_a, eps_b and gamma"
        )
    here = law.derivatives(*x.T)
    yield _row("energies of kernel and law", here.parts.sum(1), W[1:], x)
    slopes = _central(energy, x, 1e-6)
    for i, name in enumerate(("sigma_a", "sigma_b", "tau")):
        yield _row(f"{name} and differences of energies", here.first[i], slopes[:, i], x)
    if here.second is not None:
        turns = _central(stresses, x, 1e-7)
        pairs = {"aa": (0, 0), "ab": (0, 1), "bb": (1, 1), "ag": (0, 2), "bg": (1, 2), "gg": (2, 2)}
        for k, (name, (i, j)) in enumerate(pairs.items()):
            names = f"tangents {name} and differences of stresses"
            yield _row(names, here.second[k], turns[:, i, j], x)
    below = []  # as shear stores little, also each strain alone
    for states in (x * e for e in [np.ones(3), *np.eye(3)]):
        rise = energy(states) - W[0]
        depth = -float(rise.min()) / max(abs(rise).max(), TINY)
        below.append((max(depth, 0.0), _place(states[rise.argmin()])))
    yield Row(
        "energies below that at rest and none", *max(below), "the energy is below that at rest by"
    )


# -- surfaces


def _of_surface(surface, at):
    x = np.asarray(np.empty((0, 3)) if at is None else at, float)
    if not len(x):
        raise InputError("a surface needs points near it, (n, 3), to be checked at")
    here, h = surface.evaluate(x), 1e-5
    for lost in x[~np.isfinite(here.gap)]:
        raise InputError(
            f"surface {type(surface).__name__}: it finds no nearest point {_place(lost)}; allowed "
            "are points near it, nearer than its `radii`"
        )
    slopes = _central(lambda x: surface.evaluate(x).gap, x, h)
    yield _row("normals and differences of gaps", here.normal, slopes, x)
    turns = _central(lambda x: surface.evaluate(x).normal, x, h)
    # a flat surface has none to compare with
    bent = np.append(abs(turns).ravel(), abs(here.curvature).ravel()).max() > 1e-6
    yield _row("curvatures and differences of normals", here.curvature * bent, turns * bent, x)
    gap = here.gap[:, None]
    feet = x - gap * here.normal
    there = surface.evaluate(feet)
    yield _row("gaps and distances along the normal", gap, gap - there.gap[:, None], x)
    yield _of_radii(surface, feet, there.curvature)
    if isinstance(surface, ImplicitSurface):
        bound = surface.bound(surface.value(x.T), x.T)
        reach = np.maximum(bound, abs(here.gap))
        yield _row("`bound` and distances that it must not exceed", reach, abs(here.gap), x, 0.0)


def _of_radii(surface, feet, curvature):
    """The share by which a surface is curved more than its least radii allow, at points on it."""
    bent = np.linalg.eigvalsh(np.nan_to_num(curvature))
    inside, outside = 1 / np.asarray(surface.radii)
    over = np.fmax(bent[:, 2] - inside, -bent[:, 0] - outside)
    i = np.argsort(over)[int((1 - KINKS) * (len(over) - 1))]
    largest = abs(bent[i]).max()
    off = max(over[i], 0.0) / max(largest, 1e-6)
    where = _place(feet[i]) + (f", where the radius is {1 / largest:.4g} mm" if off else "")
    return Row("radii of curvature and least `radii`", off, where)


# -- terms


def _of_term(term, scene, load, size):
    """Rows on forces and tangent of a term, and remarks. The sheet is displaced by about `size`
    [mm] along `moved`, and from there along d: rough ones, the same on any number of ranks."""
    blank, comm, before, x = scene.blank, scene.comm, scene.u.copy(), scene.u.copy()
    assembly, gdim = Assembly(blank, [term]), blank.mesh.geometry.dim
    area, cells = comm.allreduce(np.array([blank.areas().sum(), len(blank.areas())]))
    size = size or 1e-3 * float(np.sqrt(area / cells))
    places = blank.coordinates()[: blank.V.dofmap.index_map.size_local]
    angles = [1e3 * places @ [1.3, 1.7, 1.9] + i for i in range(2 * gdim)]
    moved, d = (np.sin(part).T.ravel() for part in (angles[:gdim], angles[gdim:]))
    h = 1e-6 * size

    def move(by):
        x.array[:] = before.array + size * moved + by
        scene.set(x)

    def energy(by):
        move(by)
        return sum(assembly.energies().values())

    def forces(by):
        move(by)
        f = scene.u.duplicate()
        assembly.residual(f)
        return f.array.copy()

    def whole(values):
        """Rows (nodes, k) of all ranks."""
        return np.concatenate(comm.allgather(values.reshape(len(places), -1)))

    try:
        term.set_load(0.0)
        term.set_load(load)
        f = forces(0.0)
        check_answers(term)
        _check_adds(term, f)
        _check_places(term, lambda share: move(share * size * moved))
        Kd, change = _stiffness(term, assembly, d, x), (forces(h * d) - forces(-h * d)) / (2 * h)
        largest, total = abs(whole(f)).max(), abs(whole(f)).sum()
        # not d alone, along which forces may cancel
        e = d / 2 + f / max(largest, TINY)
        slope = (energy(1e3 * h * e) - energy(-1e3 * h * e)) / (2e3 * h)
        stored = energy(0.0)
    finally:
        scene.set(before)
        term.set_load(0.0)
    work = whole(f * e)
    off = abs(slope - work.sum()) / max(abs(slope), abs(work).sum(), TINY)
    where = f"for displacements of about {size:.3g} mm, the `size`"
    rows = [
        Row("forces and differences of energies", off, where),
        _row("tangent and differences of forces", whole(Kd), whole(change), whole(places), 0.0),
    ]
    remarks = [] if largest else [NO_FORCES]
    if term.energy_kind and stored < -1e-6 * size * total:
        below = "below 0 it drives the sheet in place of resisting it"
        remarks.insert(0, f"the energy of the displaced sheet is {stored:.3g} N mm: {below}")
    return rows, remarks


def _stiffness(term, assembly, d, like):
    """The tangent times the direction d (owned dofs,)."""
    direction, A = like.duplicate(), assembly.create_matrix()
    direction.array[:] = d
    assembly.tangent(A)
    product = (A * direction).array.copy()
    if compliance := term.compliance():
        c, k = compliance
        pushed = term.blank.mesh.comm.allreduce(float(c @ d[: c.size]))
        product[: c.size] -= c * pushed / k if k > 0 else 0.0
    return product


def _check_adds(term, f):
    """InputError if the array of forces loses its content; f: the term's forces."""
    alone = np.zeros_like(term.blank.u.x.array)
    scale = 1.0 + abs(f).max(initial=0.0)
    after = np.full_like(alone, scale)
    term.add_forces(alone)
    term.add_forces(after)
    lost = abs(after - alone - scale).max(initial=0.0) > 1e-6 * scale
    if term.blank.mesh.comm.allreduce(bool(lost), MPI.LOR):
        raise InputError(
            f"`add_forces` of term {term.name} loses what other terms added; allowed is to add to "
            "the array, as `f[dofs] += forces`"
        )


def _check_places(term, move):
    """InputError if places of the tangent change with the displacement but not `pattern`."""
    before, changed = None, False
    for share in (-1, -2, 0):
        move(share)
        now = term.pattern, np.array(term.tangent()[:2])
        before = before or now
        changed |= now[0] == before[0] and not np.array_equal(now[1], before[1])
    if term.blank.mesh.comm.allreduce(changed, MPI.LOR):
        raise InputError(
            f"`tangent` of term {term.name} gives other places where the sheet is elsewhere; "
            "allowed are always the same, unless `pattern` counts up"
        )
