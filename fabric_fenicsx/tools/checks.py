"""What can be seen of tools before anything runs."""

from collections.abc import Callable, Sequence

import numpy as np
from mpi4py import MPI
from numpy.typing import ArrayLike

from ..runtime.errors import InputError
from ..runtime.formatting import coordinates, rounded
from .implicit import ImplicitSurface
from .surfaces import Flipped, Offset, Reversed, Surface, Turned
from .tool import Tool
from .triangulated import TriangulatedSurface

COARSE = 20.0  # deg, by which neighbouring facets turn on a surface that is to be smooth
UNITS = {"metres": 1000.0, "inches": 25.4}
# share of the thickness by which a flange may be off its plane, a tool may be deep in the sheet at
# the start, and off it at the end
FLANGE = 0.05
MIRRORED = 0.25  # share of the thickness by which a punch and its mirror image may differ
EQUATION = 50  # points at which an equation's derivatives are compared with differences
STEP = 1e-3  # step of these differences [mm]
WRONG = 0.01, 0.1  # share by which derivatives are wrong, and of the points at which they may be


def check_triangles(
    surface: TriangulatedSurface, name: str, thickness: float, warn: Callable[[str], None]
) -> None:
    """Raise InputError for a surface `name` that is no surface or too coarse for a ply of this
    thickness [mm]; call `warn` with a sentence for what can only be doubted."""
    x = surface.points
    if len(surface.forks):
        raise InputError(
            f"{name} has {len(surface.forks)} edges with more than two triangles, one at "
            f"{coordinates(x[surface.forks[0]].mean(0))}; "
            "allowed are at most two at an edge"
        )
    if not surface.one_sided:
        raise InputError(
            f"{name} has only one side, as a Moebius strip; allowed is a surface with two"
        )
    if surface.turned:
        warn(
            f"{name}: {surface.turned} of {len(surface.triangles)} triangles were turned round to "
            "agree with the others"
        )
    off = 0.75 * surface.bulges
    worst = int(off.argmax())
    if off[worst] > thickness:
        raise InputError(
            f"{name} has facets that are {rounded(off[worst])} mm off the curved surface through "
            f"their corners, at {coordinates(x[surface.triangles[worst]].mean(0))}; allowed is up "
            f"to the ply's thickness {thickness:g} mm"
        )
    edges, turn = surface.turns
    if len(turn) and np.degrees(turn.max()) > COARSE:
        worst = int(turn.argmax())
        warn(
            f"{name} is coarse: its facets turn by {np.degrees(turn[worst]):.0f} deg at "
            f"{coordinates(x[edges[worst]].mean(0))} where "
            f"it is to be smooth; beyond {COARSE:g} deg its curvature is a guess"
        )


def check_punch(
    surface: TriangulatedSurface,
    name: str,
    half: ArrayLike,
    thickness: float,
    warn: Callable[[str], None],
) -> TriangulatedSurface:
    """The surface if it can be a punch from below with its flange in z = 0, its normals up, for a
    ply that reaches to +-half (2,) [mm] along x and y; it is turned round where its flange's
    normals point down.

    Raises InputError as `check_triangles` does, and for a size that is not in mm, for open edges
    beneath the ply and for a flange that is not there.
    """
    x, end = surface.points, np.asarray(half, dtype=float)
    size, needed = np.ptp(x, 0)[:2].max(), 2 * float(end.max())
    ply = f"the ply of {2 * end[0]:g} x {2 * end[1]:g} mm"
    for unit, factor in UNITS.items():
        if size < 0.2 * needed and 0.5 < size * factor / needed < 10:
            raise InputError(
                f"{name} is {rounded(size, 4)} mm large, which speaks of {unit}; allowed is a "
                f"surface in mm, larger than {ply}"
            )
    if size > 50 * needed:
        raise InputError(
            f"{name} is {rounded(size, 4)} mm large; allowed is a surface in mm, up to 50 times as "
            f"large as {ply}"
        )
    middle = x[surface.rim].mean(1)
    within = (abs(middle[:, :2]) < end - 1e-6 * needed).all(1) & (middle[:, 2] > -thickness)
    open_words = (
        f"{name} is open at {coordinates(middle[within.argmax()])}, beneath the ply; allowed is a "
        f"surface without holes or cracks that reaches beyond {ply}"
        if within.any()
        else ""
    )
    reaches = (x[:, :2].min(0) <= -end).all() and (x[:, :2].max(0) >= end).all()
    if open_words and reaches and not len(surface.forks):
        raise InputError(open_words)  # or a flange with cracks would pass for none
    outline = _outline(end)
    found = surface.evaluate(outline)
    off = np.where(
        abs(found.normal[:, 2]) > 0.99, abs(found.gap), np.maximum(abs(found.gap), thickness)
    )
    worst = int((off > (1 - 1e-9) * off.max()).argmax())  # the first, also of mirror images
    if off[worst] > FLANGE * thickness:
        raise InputError(
            f"{name} has no flange in z = 0 under the ply's edge at "
            f"{coordinates(outline[worst, :2])}: the nearest surface lies "
            f"{rounded(abs(found.gap[worst]))} mm off; allowed is a punch with a flange there that "
            f"reaches beyond {ply}"
        )
    check_triangles(surface, name, thickness, warn)
    if open_words:
        raise InputError(open_words)
    if found.normal[:, 2].mean() < 0:
        warn(f"{name}: the normals of its flange point down, so it was turned round")
        return surface.turned_round()
    return surface


def _outline(half):
    """Points (n, 3) on the edge of a ply in z = 0 that reaches to +-half (2,) [mm]."""
    side = np.linspace(-1, 1, 21)
    edges = np.vstack([np.column_stack([side, 0 * side + s]) for s in (-1, 1)])
    edges = np.vstack([edges, edges[:, ::-1]]) * half
    return np.column_stack([edges, np.zeros(len(edges))])


def check_own_punch(surface: Surface, low: ArrayLike, high: ArrayLike, thickness: float) -> float:
    """How high [mm] a punch's surface, of no triangles, rises over z = 0 beneath a ply from low to
    high (2,) [mm].

    Raises InputError for one that gives no number, does not rise, has its body above it, or has no
    flange beneath any of the ply's edge.
    """
    name, end = f"surface {type(surface).__name__} of the punch", np.maximum(np.abs(low), high)
    outline = _outline(end)
    gap, normal, _ = surface.evaluate(np.vstack([outline, outline / 2, 0 * outline[:1]]), thickness)
    if np.isnan(gap).any():
        raise InputError(f"the gap of {name} is not a number in z = 0; allowed is a finite one")
    top = height(surface, low, high)
    flange = abs(gap[: len(outline)]) <= FLANGE * thickness
    if not flange.any():
        raise InputError(
            f"{name} has no flange in z = 0 beneath the ply's edge; allowed is one that rises from "
            "a flange there"
        )
    if normal[: len(outline)][flange, 2].mean() < 0:
        raise InputError(
            f"{name} has a flange whose normals point down; allowed are normals up to the ply, so "
            "of an equation F < 0 below (`Reversed` turns a surface round)"
        )
    return top


def mirror_warning(
    surface: Surface, name: str, half: ArrayLike, top: float, thickness: float
) -> str:
    """A sentence if a punch that rises to z = `top` beneath a ply which reaches to +-half (2,) [mm]
    is not its own mirror image in x = 0 and y = 0, to `MIRRORED` of the thickness, else ""."""
    side, end = np.linspace(0.02, 0.98, 10), np.asarray(half, dtype=float)
    x, y = np.meshgrid(side * end[0], side * end[1])
    points = np.column_stack([x.ravel(), y.ravel(), top + 0 * x.ravel()])
    gap, normal, _ = surface.evaluate(points)
    points = points - gap[:, None] * normal
    points = points[np.isfinite(gap) & (abs(points[:, :2]) <= end).all(1)]
    for mirror in ((-1, 1, 1), (1, -1, 1), (-1, -1, 1)):
        off = np.nan_to_num(abs(surface.evaluate(points * mirror).gap))
        if len(off) and off.max() > MIRRORED * thickness:
            worst = points[off.argmax()]
            return (
                f"{name} is not its own mirror image: it is at {coordinates(worst)}, but "
                f"{rounded(off.max())} mm off {coordinates(worst * mirror)}; so the quarter stands "
                "for four mirrored ones"
            )
    return ""


def height(surface: Surface, low: ArrayLike, high: ArrayLike) -> float:
    """How high [mm] a surface rises over z = 0 beneath a ply from low to high (2,) [mm]; one of
    triangles anywhere.

    Places far above are taken to their nearest points, and again from above these: none is lower
    than the one before, and they end on the tops. Raises InputError for a surface that does not
    rise.
    """
    if isinstance(surface, TriangulatedSurface):
        return float(surface.points[:, 2].max())
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    size = float((high - low).max())
    x, y = np.meshgrid(*np.linspace(low, high, 21).T)
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    arms, known, top = np.full(len(points), 10 * size), np.zeros(len(points), bool), -np.inf
    for iteration in range(1000):
        above = points + arms[:, None] * [0, 0, 1]
        gap, normal, _ = surface.evaluate(above)
        found = above - gap[:, None] * normal
        within = (abs(2 * found[:, :2] - low - high) <= high - low + 1e-6 * size).all(1)
        points[within], known = found[within], known | within
        arms[~within] /= 2  # nothing is found from so far, or it is beyond the ply
        before, top = top, points[known, 2].max(initial=-np.inf)
        if iteration > 20 and top <= before + 1e-10 * size:
            break
    if not top > 1e-6 * size:
        raise InputError(
            f"surface {type(surface).__name__} of the punch does not rise over z = 0 beneath the "
            "ply; allowed is one that rises from a flange there"
        )
    return float(top)


def check_equation(tool: Tool, places: np.ndarray, comm: MPI.Comm) -> None:
    """Raise InputError on all ranks if gradient or Hessian of a tool's `ImplicitSurface` are not
    the derivatives of its F, or its `bound` exceeds the distance, at points about those `places`
    (n, 3) [mm] of all ranks, the nearest to the surface as far as its `bound` tells."""
    low, high = (
        getattr(np, least)(comm.allgather(getattr(places, least)(0, initial=start)), axis=0)
        for least, start in (("min", np.inf), ("max", -np.inf))
    )
    room = 0.02 * (high - low).max()
    x = np.random.default_rng(0).uniform(low - room, high + room, (20 * EQUATION, 3))
    x, surface = x - tool.displacement, tool.surface
    while isinstance(surface, (Flipped, Offset, Reversed, Turned)):
        x = x * (1, 1, -1) if isinstance(surface, Flipped) else x
        x = surface.back(x) if isinstance(surface, Turned) else x
        surface = surface.surface
    if not isinstance(surface, ImplicitSurface):
        return

    def slopes(of):
        steps = STEP * np.eye(3)[:, :, None]
        return np.stack([of(x + step) - of(x - step) for step in steps], -2) / (2 * STEP)

    with np.errstate(all="ignore"):
        x = x[np.argsort(surface.bound(surface.value(x.T), x.T), kind="stable")[:EQUATION]].T
        F, gradient, hessian = surface.derivatives(x)
        of_F, of_gradient = slopes(surface.value), slopes(lambda x: surface.derivatives(x)[1])
        gap, bound = abs(surface.evaluate(x.T).gap), surface.bound(surface.value(x), x)
    lost = ~np.isfinite(F)
    if lost.mean() > 0.5:
        raise InputError(
            f"F of surface {type(surface).__name__} of {tool.name} is not a number at "
            f"{coordinates(x[:, lost][:, 0])}; allowed is a finite one"
        )
    least = np.nanmax(abs(of_F), initial=0.0)
    for name, given, found, floor in (
        ("gradient", gradient, of_F, 1e-6 * least),
        ("Hessian", hessian, of_gradient, 1e-4 * least),
    ):
        off, size = (abs(each).reshape(-1, x.shape[1]).max(0) for each in (given - found, found))
        wrong = off > WRONG[0] * (size + floor)
        if wrong.mean() > WRONG[1]:
            raise InputError(
                f"the {name} of surface {type(surface).__name__} of {tool.name} is not that of its "
                f"F, as at {coordinates(x[:, wrong][:, 0])}; allowed are exact derivatives, which "
                "`check_derivatives` compares with differences"
            )
    beyond = bound > (1 + WRONG[0]) * gap + STEP
    if beyond.any():
        worst = int(np.where(beyond, bound - gap, 0.0).argmax())
        raise InputError(
            f"`bound` of surface {type(surface).__name__} of {tool.name} is "
            f"{rounded(bound[worst])} mm at {coordinates(x[:, worst])}, which is "
            f"{rounded(gap[worst])} mm off the surface; allowed is up to the distance, or no "
            "`bound`"
        )


def check_start(tool: Tool, places: np.ndarray, thickness: float, comm: MPI.Comm) -> None:
    """Raise InputError on all ranks for a tool so deep in a sheet, whose nodes of this rank are at
    places (n, 3) [mm], that these are in the tool themselves."""
    check_equation(tool, places, comm)
    nearest, place = _least_gap(tool, places, thickness, comm)
    if nearest < -(0.5 + 1e-6) * thickness:
        raise InputError(
            f"{tool.name} is {rounded(-nearest)} mm deep in the sheet's face at "
            f"{coordinates(place)} before anything moves; allowed is up to {thickness / 2:g} mm, "
            "half the thickness: begin its path further off, or turn it round with `Reversed` if "
            "its normals point away from the sheet"
        )


def _least_gap(tool, places, thickness, comm):
    """The least gap [mm] of all ranks between the tool and the sheet's face, and its place.
    Raises InputError, on all ranks, where the tool's surface gives no number."""
    gap = tool.evaluate(places, reach=thickness).gap
    lost = places[np.isnan(gap)][:1].tolist()
    if lost := sum(comm.allgather(lost), []):
        raise InputError(
            f"the gap of surface {type(tool.surface).__name__} of {tool.name} is not a number at "
            f"{coordinates(lost[0])}, where the sheet is before anything moves; allowed is a "
            "finite one"
        )
    deep = gap < -thickness / 2  # may be a bound
    exact = tool.evaluate(places[deep]).gap
    gap[deep] = np.where(np.isnan(exact), gap[deep], exact)
    gap[np.isnan(gap)] = np.inf
    least = int(gap.argmin()) if len(gap) else None
    parts = comm.allgather((gap[least], places[least].tolist()) if len(gap) else (np.inf, []))
    nearest, place = min(parts)
    return float(nearest) - thickness / 2, place


def check_motion(
    tools: Sequence[Tool], places: np.ndarray, thickness: float, comm: MPI.Comm
) -> None:
    """Raise InputError on all ranks for a tool that is in the flat blank at load 0, whose nodes of
    this rank are at places (n, 3) [mm], or that at load 1 is further off than `FLANGE` allows; the
    tools are left at load 0."""
    for tool in tools:
        check_equation(tool, places, comm)
        for load in (0.0, 1.0):
            tool.at(load)
            nearest, place = _least_gap(tool, places, thickness, comm)
            if load == 0 and nearest < -FLANGE * thickness:
                raise InputError(
                    f"{tool.name} cuts into the blank by {rounded(-nearest)} mm at "
                    f"{coordinates(place)} before anything moves; allowed is up to "
                    f"{FLANGE * thickness:g} mm"
                )
            if load == 1 and nearest > FLANGE * thickness:
                raise InputError(
                    f"{tool.name} never reaches the blank: at the end of its stroke it is still "
                    f"{rounded(nearest)} mm off or more; "
                    "allowed is a tool that touches it"
                )
        tool.at(0.0)
