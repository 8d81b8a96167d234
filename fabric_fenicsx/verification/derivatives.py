"""Check of the derivatives that a law, a term or a surface gives, by finite differences."""

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.rules import FINITE, POSITIVE
from ..energy.assembly import Assembly
from ..energy.term import Term, check_answers
from ..material.laws import Law
from ..scene.scene import Scene
from ..surfaces.implicit import ImplicitSurface
from ..surfaces.surfaces import Surface

DIFFERENCE_TOLERANCE = 1e-4  # over the largest of its kind


def check_derivatives(
    thing: Law | Surface | Term,
    at: ArrayLike | Scene | None = None,
    *,
    load: float = 1.0,
    size: float | None = None,
) -> str:
    """Compare the derivatives of an object with finite differences.

    - A law: stresses with differences of its energy, tangents with those of its stresses; energy
      and stress at rest, which must be 0; energy, which must be least there.
    - A surface: normal and curvature with differences of the gap; the gap with the distance to the
      surface; curvature with `radii`.
    - A term: forces with differences of its energy, tangent with those of its forces, where the
      sheet is and displaced by about `size`. The term is at load 0 afterwards, the sheet where it
      was.

    Returns a table of the differences, with a remark if an energy of a term is below 0. Raises
    InputError, with the table, if a difference is above 1e-4; 2 % of the states of laws and
    surfaces may be. Also where an energy or a gap is not a number.

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

    Examples
    --------
    >>> print(ff.check_derivatives(ff.Sphere(radius=30), [[10.0, 5.0, 31.0]]).splitlines()[0])
    surface Sphere: derivatives agree with differences
    """
    FINITE.check("`load`", load)
    if size is not None:
        POSITIVE.check("`size`", size)
    points = np.empty(0) if at is None or isinstance(at, Scene) else np.asarray(at, float)
    remarks = ["derivatives agree with differences"]
    if isinstance(thing, Law):
        name, rows = f"law {thing.law}", [*_of_law(thing, points)]
    elif isinstance(thing, Surface) and points.size:
        name, rows = f"surface {type(thing).__name__}", [*_of_surface(thing, points)]
    elif isinstance(thing, Term) and isinstance(at, Scene) and thing in at.terms:
        name, (rows, remarks) = f"term {thing.name}", _of_term(thing, at, load, size)
    else:
        raise InputError(
            f"derivatives of {thing!r} cannot be checked at {at!r}; expected a law, a surface "
            "with points near it, (n, 3), and a term with its scene"
        )
    return _report(name, rows, remarks)


def _report(name, rows, remarks):
    """The table of `rows`, with its remarks; InputError with it if a row differs too much."""
    table = "\n".join(f"{names:<45} {off:9.1e}  {where}" for names, off, where in rows)
    for names, off, where in rows:  # the first, as what follows from it is off, too
        if not off <= DIFFERENCE_TOLERANCE:
            apart = "are not numbers" if np.isnan(off) else f"differ by {off:.2g} of the largest"
            allowed = f"expected {DIFFERENCE_TOLERANCE:g}"
            raise InputError(f"{name}: {names} {apart} {where}; {allowed}\n{table}")
    return "\n".join([f"{name}: {remarks[0]}\n{table}", *remarks[1:]])


def _place(point):
    return f"at ({', '.join(f'{v:.4g}' for v in point)})"


def _row(names, values, expected, places, kinks=0.02):
    """Row of a table: names, the difference of values (n, ...) over the largest (NaN: no number) at
    that of the `places` (n, k) which is the worst but for the share `kinks` of them, at which a
    derivative may jump between both sides, and that place."""
    off = abs(values - expected).reshape(len(places), -1).max(1)
    off[np.isnan(off)] = np.inf
    i = np.argsort(off)[int((1 - kinks) * (len(off) - 1))]
    scale = max(*(np.nanmax(abs(side), initial=0) for side in (values, expected)), 1e-300)
    return names, float(off[i] / scale) if np.isfinite(off[i]) else np.nan, _place(places[i])


def _not_finite(names, values, places):
    """A row if one of the values (n,) is not a number."""
    return [(names, np.nan, _place(x)) for x in places[~np.isfinite(values)][:1]]


def _central(f, x, h):
    """Differences of f at x (n, 3) along each of the three axes, (..., 3)."""
    return np.stack([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(3)], -1)


def _of_law(law, x):
    def energy(x):
        with np.errstate(all="ignore"):  # sides of a case that do not count
            return sum(part + np.zeros(len(x)) for part in law.parts(*x.T))

    def stresses(x):
        return law.derivatives(*np.ascontiguousarray(x.T), False).first.T

    law.check_rest()
    if not x.size:
        x = np.random.default_rng(0).uniform(-1, 1, (500, 3)) * [0.05, 0.05, 0.8]
    W, here = energy(x), law.derivatives(*x.T)
    yield from _not_finite("energies", W, x)
    yield _row("energies of kernel and law", here.parts.sum(1), W, x)
    slopes = _central(energy, x, 1e-6)
    for i, name in enumerate(("sigma_a", "sigma_b", "tau")):
        yield _row(f"{name} and differences of energies", here.first[i], slopes[:, i], x)
    if here.second is not None:
        turns = _central(stresses, x, 1e-7)
        for pair, tangents in zip(("aa", "ab", "bb", "ag", "bg", "gg"), here.second):
            i, j = map("abg".index, pair)
            yield _row(f"tangents {pair} and differences of stresses", tangents, turns[:, i, j], x)
    depths = []  # below the energy at rest; as shear stores little, also of each strain alone
    for states in (x * e for e in [np.ones(3), *np.eye(3)]):
        rise = energy(states) - energy(np.zeros((1, 3)))
        depth = max(-float(rise.min()) / max(abs(rise).max(), 1e-300), 0.0)
        depths.append((depth, _place(states[rise.argmin()])))
    yield "energy at rest and its minimum", *max(depths)


def _of_surface(surface, x):
    here, h = surface.evaluate(x), 1e-5
    yield from _not_finite("gaps to the nearest point", here.gap, x)
    slopes, turns = (
        _central(lambda x: getattr(surface.evaluate(x), name), x, h) for name in ("gap", "normal")
    )
    yield _row("normals and differences of gaps", here.normal, slopes, x)
    bent = max(abs(turns).max(), abs(here.curvature).max()) > 1e-6  # else nothing to compare with
    yield _row("curvatures and differences of normals", here.curvature * bent, turns * bent, x)
    gap = here.gap[:, None]
    feet = x - gap * here.normal
    there = surface.evaluate(feet)
    yield _row("gaps and distances along the normal", gap, gap - there.gap[:, None], x)
    bends = np.linalg.eigvalsh(np.nan_to_num(there.curvature))
    inside, outside = 1 / np.asarray(surface.radii)  # the sharpest that the radii allow
    allowed = np.clip(bends, -outside, inside)
    yield _row("radii of curvature and smallest `radii`", bends * bent, allowed * bent, feet)
    if isinstance(surface, ImplicitSurface):
        bound = np.maximum(surface.bound(surface.value(x.T), x.T), abs(here.gap))
        yield _row("`bound` and distances that it must not exceed", bound, abs(here.gap), x, 0.0)


def _of_term(term, scene, load, size):
    """Rows on forces and tangent of a term, and remarks. The sheet is displaced by about `size`
    [mm] along `moved`, and from there along d: rough fields, the same on any number of ranks."""
    blank, comm, before, x = scene.blank, scene.comm, scene.u.copy(), scene.u.copy()
    assembly, f, gdim = Assembly(blank, [term]), scene.u.duplicate(), blank.mesh.geometry.dim
    area, cells = comm.allreduce(np.array([blank.areas().sum(), len(blank.areas())]))
    size = size or 1e-3 * float(np.sqrt(area / cells))
    places = blank.coordinates()[: blank.V.dofmap.index_map.size_local]
    angles = 1e3 * places @ [1.3, 1.7, 1.9] + np.arange(2 * gdim).reshape(2, gdim, 1)
    (moved, d), h = np.sin(angles).swapaxes(1, 2).reshape(2, -1), 1e-6 * size

    def at(by, share=1.0):
        """Energy and forces."""
        x.array[:] = before.array + share * size * moved + by
        scene.set(x)
        assembly.residual(f)
        return sum(assembly.energies().values()), f.array.copy()

    def whole(values):
        """Rows (nodes, k) of all ranks."""
        return np.concatenate(comm.allgather(values.reshape(len(places), -1)))

    try:
        term.set_load(0.0)
        term.set_load(load)
        asked = []
        for share in (0.0, -1.0, 1.0):
            stored, forces = at(0.0, share)
            check_answers(term)
            asked.append((term.pattern, np.array(term.tangent()[:2])))
        _check_places(term, asked)
        Kd = _stiffness(term, assembly, d, scene)
        change = (at(h * d)[1] - at(-h * d)[1]) / (2 * h)
        largest, total = abs(whole(forces)).max(), abs(whole(forces)).sum()
        # not d alone, along which forces may cancel
        e = d / 2 + forces / max(largest, 1e-300)
        slope = (at(1e3 * h * e)[0] - at(-1e3 * h * e)[0]) / (2e3 * h)
    finally:
        scene.set(before)
        term.set_load(0.0)
    work = whole(forces * e)
    off = abs(slope - work.sum()) / max(abs(slope), abs(work).sum(), 1e-300)
    where = f"for displacements of about {size:.3g} mm, the `size`"
    rows = [
        ("forces and differences of energies", off, where),
        _row("tangent and differences of forces", whole(Kd), whole(change), whole(places), 0.0),
    ]
    nothing = "the term has no forces here: nothing was compared"
    remarks = ["derivatives agree with differences" if largest else nothing]
    if term.energy_kind and stored < -1e-6 * size * total:
        below = "a negative energy drives the sheet instead of resisting it"
        remarks.append(f"the energy of the displaced sheet is {stored:.3g} N mm: {below}")
    return rows, remarks


def _stiffness(term, assembly, d, scene):
    """The tangent where the sheet is times the direction d (owned dofs,)."""
    direction, A = scene.u.duplicate(), assembly.create_matrix()
    direction.array[:] = d
    assembly.tangent(A)
    product = (A * direction).array.copy()
    c, k = term.compliance() or (np.empty(0), 0.0)
    if k > 0:
        product[: c.size] -= c * scene.comm.allreduce(float(c @ d[: c.size])) / k
    return product


def _check_places(term, asked):
    """InputError if places of the tangent changed with the displacement but not `pattern`."""
    pattern, places = asked[0]
    changed = any(now == pattern and not np.array_equal(at, places) for now, at in asked)
    if term.blank.mesh.comm.allreduce(changed, MPI.LOR):
        raise InputError(
            f"`tangent` of term {term.name} returns different rows and columns if the sheet moves; "
            "expected always the same, unless `pattern` counts up"
        )
