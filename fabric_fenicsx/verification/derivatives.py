"""Whether a law, a term or a surface of one's own has the derivatives that it says it has."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc as fem_petsc
from mpi4py import MPI
from numpy.typing import ArrayLike
from petsc4py import PETSc

from .. import dolfinx_compat as compat
from ..material.laws import Law
from ..mechanics.assembly import triplets
from ..mechanics.protocols import DrivenByForce
from ..mechanics.term import Term, overrides
from ..mechanics.term_checks import check_answers
from ..mechanics.triplets import TripletPlaces
from ..runtime.errors import InputError
from ..runtime.rules import FINITE, POSITIVE
from ..scene.scene import Scene
from ..tools.implicit import ImplicitSurface
from ..tools.surfaces import Surface, radii_of

ALLOWED = 1e-4  # difference, over the largest of its kind
KINKS = 0.02  # share of states or points at which a derivative may jump between both sides
RANGES = np.array([[-0.05, 0.05], [-0.05, 0.05], [-0.8, 0.8]])  # eps_a, eps_b, gamma
PANELS, HALVINGS = 50, 40  # pieces of the way from rest to a state, where a jump is sought
NO_FORCES = "the term gives no forces here: nothing was compared"
AGAINST_NONE = {
    "energy at rest and none": "the energy at rest is",
    "stresses at rest and none": "the stresses at rest are",
    "energies below that at rest and none": "the energy is below that at rest by",
}


class Row(NamedTuple):
    """What was compared with what, how far it is off, over the largest of its kind (NaN where there
    is no number), and where."""

    what: str
    off: float
    where: str

    def differ(self) -> str:
        """In words."""
        if self.what in AGAINST_NONE and not np.isnan(self.off):
            return f"{AGAINST_NONE[self.what]} {self.off:.2g} of the largest {self.where}"
        if np.isnan(self.off):
            return f"{self.what} are not numbers {self.where}"
        return f"{self.what} differ by {self.off:.2g} of the largest {self.where}"


def check_derivatives(
    thing: Law | Surface | Term, at: Any = None, *, load: float = 1.0, size: float | None = None
) -> str:
    """Compare the derivatives that `thing` gives with differences; a table in words.

    - A law: stresses with differences of its energy, tangents with those of its stresses, at random
      strains; whether it is free of energy and stress at rest, whether its energy is least there,
      and without a jump on the way. `at`: other states (n, 3) of eps_a, eps_b [-] and gamma [rad].
      The table also tells if the sign of gamma matters to the energy, and if shear takes none.
    - A surface: normal and curvature with differences of the gap at the points `at` (n, 3) [mm],
      which should be near it; whether the gap leads to it, so is a distance; whether it is curved
      more than `radii` says; and of an `ImplicitSurface` whether `bound` exceeds the distance.
    - A term: forces with differences of its energy, and tangent with those of its forces, in the
      scene `at`, at the load factor `load`, where the sheet is and displaced by about `size` [mm]
      (default: 1/1000 of a cell). The table also tells if an energy is below 0 there. The term is
      then at load 0, the sheet where it was.

    Raises InputError, with the table, if one is off by more than `ALLOWED`; of laws and surfaces
    `KINKS` of the states may be. Raises it also where an energy or a gap is not a number.
    """
    remarks: list[str] = []
    FINITE.check("`load`", load)
    if size is not None:
        POSITIVE.check("`size`", size)
    if isinstance(thing, Law):
        name, rows = f"law {thing.law}", [*_of_law(thing, at)]
        remarks = _of_shear(thing, at)
    elif isinstance(thing, Surface):
        name, rows = f"surface {type(thing).__name__}", [*_of_surface(thing, at)]
    elif isinstance(at, Scene) and thing in at.terms:
        name, rows = f"term {thing.name}", [*_of_term(thing, at, load, size, remarks)]
    else:
        raise InputError(
            f"derivatives of {thing!r} are asked for with {at!r}; allowed are a law, a surface "
            "with points, and a term with its scene"
        )
    table = "\n".join(f"{row.what:<45} {row.off:9.1e}  {row.where}" for row in rows)
    for row in rows:  # the first, as what follows from it is off, too
        if not row.off <= ALLOWED:
            raise InputError(f"{name}: {row.differ()}; allowed is {ALLOWED:g}\n{table}")
    head = remarks.pop() if NO_FORCES in remarks else "derivatives agree with differences"
    return "\n".join([f"{name}: {head}\n{table}", *remarks])


def _place(point: np.ndarray) -> str:
    return f"at ({', '.join(f'{v:.4g}' for v in point)})"


def _row(
    what: str, given: np.ndarray, found: np.ndarray, places: np.ndarray, kinks: float = KINKS
) -> Row:
    """The difference of `given` and `found` (n, ...) at that of the `places` (n, k) which is the
    worst but for `kinks` of them."""
    off = abs(given - found).reshape(len(places), -1).max(1)
    off[np.isnan(off)] = np.inf
    i = np.argsort(off)[int((1 - kinks) * (len(off) - 1))]
    scale = max(np.nanmax(abs(given), initial=0), np.nanmax(abs(found), initial=0), 1e-300)
    return Row(what, float(off[i] / scale) if np.isfinite(off[i]) else np.nan, _place(places[i]))


def _central(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, h: float) -> np.ndarray:
    """Differences of f at x (n, 3) along each of the three axes, (..., 3)."""
    return np.stack([(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(3)], -1)


def _states(at: ArrayLike | None) -> np.ndarray:
    low, high = RANGES.T
    drawn = np.random.default_rng(0).uniform(low, high, (500, 3))
    return drawn if at is None else np.asarray(at, float)


def _energy(law: Law, x: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):  # sides of a case that do not count
        return sum(law.parts(*x.T)) + np.zeros(len(x))


def _of_law(law: Law, at: ArrayLike | None) -> Iterator[Row]:
    x = _states(at)
    law.check_shapes()

    def energy(x: np.ndarray) -> np.ndarray:
        return _energy(law, x)

    for lost in (every := np.vstack([np.zeros(3), x]))[~np.isfinite(energy(every))]:
        raise InputError(
            f"law {law.law}: the energy is not a number {_place(lost)}; allowed is one at every "
            "eps_a, eps_b and gamma"
        )
    here, rest = law.derivatives(*x.T), law.derivatives(*np.zeros((3, 1)))
    at_rest = np.array([*rest.first, *(() if rest.second is None else rest.second)])
    scales = np.nanmax(abs(here.first), 1)  # each stress by its own: shear is by far the least
    scales = np.maximum(scales, max(1e-12 * scales.max(), 1e-300))
    off = float((abs(rest.first[:, 0]) / scales).max()) if np.isfinite(at_rest).all() else np.nan
    W = energy(np.vstack([np.zeros(3), x]))
    left = float(abs(W[0]) / max(abs(W - W[0]).max(), 1e-300))
    yield Row("energy at rest and none", left, "at (0, 0, 0)")
    yield Row("stresses at rest and none", off, "at (0, 0, 0)")
    yield _row("energies of kernel and law", here.parts.sum(1), energy(x), x)
    slopes = _central(energy, x, 1e-6)
    turns = _central(lambda x: law.derivatives(x[:, 0], x[:, 1], x[:, 2], False).first.T, x, 1e-7)
    for i, name in enumerate(("sigma_a", "sigma_b", "tau")):
        yield _row(f"{name} and differences of energies", here.first[i], slopes[:, i], x)
    pairs = {"aa": (0, 0), "ab": (0, 1), "bb": (1, 1), "ag": (0, 2), "bg": (1, 2), "gg": (2, 2)}
    for k, (name, (i, j)) in enumerate(pairs.items()):
        if here.second is not None:
            what = f"tangents {name} and differences of stresses"
            yield _row(what, here.second[k], turns[:, i, j], x)
    # as shear stores little, also each strain alone
    alone = np.vstack([x, *(x[:100] * e for e in np.eye(3))])
    jumps, where = _jumps(law, alone)
    i = int(jumps.argmax())
    yield Row("energies on both sides of a state", float(jumps[i]), _place(where[i]))
    below = max(_below_rest(energy, x * e) for e in [np.ones(3), *np.eye(3)])
    yield Row("energies below that at rest and none", *below)


def _below_rest(energy: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> tuple[float, str]:
    W = energy(x) - energy(np.zeros((1, 3)))
    return max(-float(W.min()) / max(abs(W).max(), 1e-300), 0.0), _place(x[W.argmin()])


def _jumps(law: Law, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far a part of the energy jumps, over its largest, on the way from rest to each state x
    (n, 3), (n,), and where, (n, 3): there the energy's change is not the stresses' work, however
    short the way is made."""

    def parts(x: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.stack([part + np.zeros(len(x)) for part in law.parts(*x.T)], -1)

    def missed(ways: np.ndarray) -> np.ndarray:
        """By the work along each piece of ways (n, k + 1, 3), (n, k) [MPa]."""
        flat = np.ascontiguousarray(ways.reshape(-1, 3))
        stress = law.derivatives(flat[:, 0], flat[:, 1], flat[:, 2], False).first.T
        stress = stress.reshape(ways.shape)
        work = ((stress[:, 1:] + stress[:, :-1]) / 2 * np.diff(ways, axis=1)).sum(2)
        change = np.diff(parts(flat).sum(1).reshape(ways.shape[:2]), axis=1)
        return abs(change - np.nan_to_num(work))

    ways, rows = np.linspace(0, 1, PANELS + 1)[:, None] * x[:, None], np.arange(len(x))
    for _ in range(HALVINGS):
        k = missed(ways).argmax(1)
        one, two = ways[rows, k], ways[rows, k + 1]
        ways = np.stack([one, (one + two) / 2, two], 1)
    largest = np.maximum(abs(parts(x)).max(0), 1e-300)
    return (abs(parts(two) - parts(one)) / largest).max(1), two


def _of_shear(law: Law, at: ArrayLike | None) -> list[str]:
    """Lines that tell that shear takes no energy, or by how much the energy at gamma and -gamma
    differs."""
    x = _states(at)
    if np.array_equal(_energy(law, x), _energy(law, x * (1, 1, 0))):
        return ["shear takes no energy: nothing in the law holds a sheet's cells against shear"]
    off = np.nan_to_num(abs(_energy(law, x) - _energy(law, x * (1, 1, -1))))
    i, shear = int(off.argmax()), abs(law.parts(*x.T)[2] + np.zeros(len(x))).max()
    if off[i] <= ALLOWED * shear:
        return []
    return [
        f"the sign of gamma matters: energies at gamma and -gamma differ by "
        f"{off[i] / max(shear, 1e-300):.2g} of the largest in shear {_place(x[i])}"
    ]


def _of_surface(surface: Surface, at: ArrayLike | None) -> Iterator[Row]:
    x = np.asarray(np.empty((0, 3)) if at is None else at, float)
    if not len(x):
        raise InputError("a surface is checked at no points; allowed are some near it, (n, 3)")
    radii, here, h = radii_of(surface), surface.evaluate(x), 1e-5
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
    feet = surface.evaluate(x - gap * here.normal).gap[:, None]
    yield _row("gaps and distances along the normal", gap, gap - feet, x)
    yield _of_radii(surface, x - gap * here.normal)
    if isinstance(surface, ImplicitSurface):
        away = min(1e2, 0.3 * min(radii))
        x = np.concatenate([x + d * here.normal for d in (-away, 0.0, away)])
        bounds, gap = surface.bound(surface.value(x.T), x.T), abs(surface.evaluate(x).gap)
        found = np.isfinite(gap)  # far inside there may be no nearest point
        both = gap[found], np.maximum(bounds, gap)[found]
        yield _row("distances and bounds of them", *both, x[found])


def _of_radii(surface: Surface, feet: np.ndarray) -> Row:
    """The share by which a surface is curved more than its least radii allow, at points on it."""
    bent = np.linalg.eigvalsh(np.nan_to_num(surface.evaluate(feet).curvature))
    inside, outside = 1 / np.asarray(surface.radii)
    over = np.fmax(bent[:, 2] - inside, -bent[:, 0] - outside)
    i = np.argsort(over)[int((1 - KINKS) * (len(over) - 1))]
    off = max(over[i], 0.0) / max(abs(bent[i]).max(), 1e-6)
    found = 1 / max(abs(bent[i]).max(), 1e-300)
    where = _place(feet[i]) + (f", where the radius is {found:.4g} mm" if off else "")
    return Row("radii of curvature and least `radii`", off, where)


def _of_term(
    term: Term, scene: Scene, load: float, size: float | None, remarks: list[str]
) -> Iterator[Row]:
    probe = _Probe(term, scene, size)
    try:
        yield from _compared(probe, load, remarks)
    finally:
        probe.leave()


def _compared(probe: "_Probe", load: float, remarks: list[str]) -> Iterator[Row]:
    """Rows on the term's forces and tangent at `load`; what its energies are like is added to the
    remarks."""
    term, size, whole, d, h = probe.term, probe.size, probe.whole, probe.direction, probe.step
    term.set_load(0.0)
    rest = probe.energy_here()
    pushed = abs(whole(probe.forces(-size * probe.moved))).max(initial=0.0)
    term.set_load(load)
    f = probe.forces(0.0)
    check_answers(term)
    probe.check_adds(f)
    probe.check_places()
    Kd, change = probe.stiffness(), (probe.forces(h * d) - probe.forces(-h * d)) / (2 * h)
    largest, total = abs(whole(f)).max(), abs(whole(f)).sum()
    # not d alone, along which forces may cancel
    e = d / 2 + f / max(largest, 1e-300)
    slope = (probe.energy(1e3 * h * e) - probe.energy(-1e3 * h * e)) / (2e3 * h)
    work = whole(f * e)
    yield Row(
        "forces and differences of energies",
        abs(slope - work.sum()) / max(abs(slope), abs(work).sum(), 1e-300),
        f"for displacements of about {size:.3g} mm, the `size`",
    )
    what = "tangent and differences of forces"
    yield _row(what, whole(Kd), whole(change), whole(probe.places), 0.0)
    stored = probe.energy(0 * d)
    if term.energy_kind and stored < -1e-6 * size * total:
        remarks.append(
            f"the energy of the displaced sheet is {stored:.3g} N mm: below 0 it drives the "
            "sheet in place of resisting it"
        )
    still = term.energy_kind and not probe.before.norm() and pushed <= 1e-9 * largest
    if still and not overrides(term, "recall") and rest > size * total:
        remarks.append(
            f"the energy of the sheet as it lies is {rest:.3g} N mm, without a force: take it "
            "off, as the energy balance knows no work that has gone into it"
        )
    if not largest:
        remarks.append(NO_FORCES)


class _Probe:
    """A term alone in its scene, with the sheet displaced by about `size` [mm] from where it is,
    `moved`, and from there along `direction`: rough ones, the same on any number of ranks."""

    def __init__(self, term: Term, scene: Scene, size: float | None) -> None:
        self.term, self.scene, self.comm, blank = term, scene, scene.comm, scene.blank
        total = self.comm.allreduce(np.array([blank.areas().sum(), len(blank.areas())]), MPI.SUM)
        self.size = size or 1e-3 * float(np.sqrt(total[0] / total[1]))
        self.step = 1e-6 * self.size
        self.before, self.x = scene.u.copy(), scene.u.copy()
        gdim, owned = blank.mesh.geometry.dim, blank.V.dofmap.index_map.size_local
        self.places = blank.coordinates()[:owned]
        angles = [1e3 * self.places @ [1.3, 1.7, 1.9] + i for i in range(2 * gdim)]
        self.moved = np.sin(angles[:gdim]).T.ravel()
        self.direction = np.sin(angles[gdim:]).T.ravel()
        v, w = ufl.TestFunction(blank.V), ufl.TrialFunction(blank.V)
        self.forms = []
        if term.energy is not None:
            self.forms = [compat.form(each) for each in (term.energy, *term.variations(v, w))]

    def move(self, by: float | np.ndarray) -> None:
        """Displace the sheet, and by so much more."""
        self.x.array[:] = self.before.array + self.size * self.moved + by
        self.scene.set(self.x)

    def leave(self) -> None:
        """The sheet where it was, the term at load 0."""
        self.scene.set(self.before)
        self.term.set_load(0.0)

    def energy_here(self) -> float:
        """Energy of the term on all ranks [N mm]."""
        term = self.term
        form = fem.assemble_scalar(self.forms[0]) if self.forms else 0.0
        return self.comm.allreduce(form + sum(term.energies().values()), MPI.SUM)

    def energy(self, by: np.ndarray) -> float:
        """That of the displaced sheet."""
        self.move(by)
        return self.energy_here()

    def forces(self, by: float | np.ndarray) -> np.ndarray:
        """Forces on this rank's owned displacements [N]."""
        self.move(by)
        f = self.scene.u.duplicate()
        with f.localForm() as local:
            local.set(0)
        if self.forms:
            fem_petsc.assemble_vector(f, self.forms[1])
        with f.localForm() as local:
            self.term.add_forces(local.array)
        f.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        return f.array.copy()

    def stiffness(self) -> np.ndarray:
        """The tangent times the direction."""
        scene, term, d = self.scene, self.term, self.direction
        A, direction, found = scene.create_matrix(), scene.u.duplicate(), scene.u.duplicate()
        direction.array[:] = d
        rows, cols, values = triplets([term])
        extra = TripletPlaces(A, rows, cols).matrix(values)
        A.zeroEntries()
        if self.forms:
            fem_petsc.assemble_matrix(A, self.forms[2])
        A.assemble()
        (A * direction + extra * direction).copy(found)
        if isinstance(term, DrivenByForce) and (given := term.compliance()):
            c, k = given[0], given[1]
            pushed = self.comm.allreduce(float(c @ d[: c.size]), MPI.SUM)
            found.array[: c.size] -= c * pushed / k if k > 0 else 0.0
        return found.array.copy()

    def check_adds(self, f: np.ndarray) -> None:
        """InputError if what was in the array of forces is lost; f: the term's forces."""
        alone = np.zeros_like(self.scene.blank.u.x.array)
        scale = 1.0 + abs(f).max(initial=0.0)
        after = np.full_like(alone, scale)
        self.term.add_forces(alone)
        self.term.add_forces(after)
        lost = abs(after - alone - scale).max(initial=0.0) > 1e-6 * scale
        if self.comm.allreduce(bool(lost), MPI.LOR):
            raise InputError(
                f"`add_forces` of term {self.term.name} loses what other terms added; allowed is "
                "to add to the array, as `f[dofs] += forces`"
            )

    def check_places(self) -> None:
        """InputError if places of the tangent change with the displacement but not `pattern`."""
        found = []
        for by in (-1, -2, 0):
            self.move(by * self.size * self.moved)
            found.append((self.term.pattern, np.array(self.term.tangent()[:2])))
        (pattern, places), *others = found
        other = [p == pattern and not np.array_equal(places, each) for p, each in others]
        if self.comm.allreduce(any(other), MPI.LOR):
            raise InputError(
                f"`tangent` of term {self.term.name} gives other places where the sheet is "
                "elsewhere; allowed are always the same, unless `pattern` counts up"
            )

    def whole(self, values: np.ndarray) -> np.ndarray:
        """Rows (nodes, k) of all ranks."""
        return np.concatenate(self.comm.allgather(values.reshape(len(self.places), -1)))
