"""Supports: nodes whose displacement is prescribed."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from ..mechanics.roles import Touching
from ..runtime.errors import InputError
from ..sheets.blank import Blank

if TYPE_CHECKING:
    from .scene import Scene

FLAT = 0.05  # height over length, up to which a smooth tool does not hold a blank within its plane
LIFTS = "move along its normal", "turn about its length", "turn about its width"
BORNE = 0.005  # of all forces from outside, more than what a support that only locates should bear


@dataclass(frozen=True)
class Support:
    """Prescribed displacement of some nodes along the axes of the blank's frame.

    - where: function of points (3, n) [mm] to a mask (n,)
    - components: the axes held
    - value: displacement at full load (gdim,) [mm], growing with the load factor, or a function of
      points (3, n) and load factor to (gdim, n)
    - locates: only keeps the sheet from moving as a rigid body and should bear nothing; a run warns
      if it bears more than `BORNE` of all forces on nodes from outside, added up by size
    """

    name: str
    where: Callable[[np.ndarray], np.ndarray]
    components: tuple[int, ...]
    value: Sequence[float] | Callable[[np.ndarray, float], np.ndarray] = (0.0, 0.0, 0.0)
    locates: bool = False


# what a scene takes: supports, or a function that makes them for its blank
Supports = Iterable[Support] | Callable[[Blank], Iterable[Support]]


def clamped_ends(stroke: float = 0.0) -> Callable[[Blank], list[Support]]:
    """Supports of a strip clamped at both ends, "fixed grip" and "moving grip", of which the second
    is pulled by `stroke` [mm] along the frame's first axis.

    They raise InputError if an end is not straight, over half the strip's width or more.
    """
    return lambda blank: _ends(blank, stroke, tuple(range(blank.mesh.geometry.dim)))


def rolling_ends(stroke: float = 0.0) -> Callable[[Blank], list[Support]]:
    """As `clamped_ends`, with ends that are free to move across the strip but for one corner."""

    def supports(blank: Blank) -> list[Support]:
        low, high = blank.extent()
        near, corner = 1e-6 * (high - low).max(), low[:2, None]
        at_corner = Support(
            "corner", lambda x: (np.abs(blank.along(x)[:2] - corner) <= near).all(0), (1,)
        )
        return [*_ends(blank, stroke, (0, *range(2, len(low)))), at_corner]

    return supports


def _ends(blank, stroke, components):
    low, high = blank.extent()
    x, comm, near = blank.along(blank.coordinates().T), blank.mesh.comm, 1e-6 * (high - low).max()
    for name, position in (("low", low[0]), ("high", high[0])):
        at_end = x[1][np.abs(x[0] - position) <= near]
        first = comm.allreduce(at_end.min(initial=np.inf), MPI.MIN)
        held = comm.allreduce(at_end.max(initial=-np.inf), MPI.MAX) - first
        if held < 0.5 * (high - low)[1]:
            raise InputError(
                f"the {name} end of {blank.name} along its length can be gripped over {held:.4g} "
                f"of {(high - low)[1]:.4g} mm; allowed is a straight end, half the width or more"
            )

    def end(position):
        return lambda x: np.abs(blank.along(x)[0] - position) <= near

    return [
        Support("fixed grip", end(low[0]), components),
        Support("moving grip", end(high[0]), components, (stroke, 0.0, 0.0)),
    ]


def on_edge(blank: Blank) -> Callable[[np.ndarray], np.ndarray]:
    """Function of points (3, n) to whether they lie on the edge of a rectangular blank, (n,)."""
    low, high = (corner[:2, None] for corner in blank.extent())
    near = 1e-6 * (high - low).max()

    def edge(x):
        x = blank.along(x)[:2]
        return (np.minimum(np.abs(x - low), np.abs(x - high)) <= near).any(0)

    return edge


def frame(deformation: Callable[[float], np.ndarray]) -> Callable[[Blank], list[Support]]:
    """Support of a rectangle's whole edge, "frame", that deforms it homogeneously.

    deformation: function of the load factor to the deformation gradient (2, 2).
    """

    def supports(blank: Blank) -> list[Support]:
        corner = blank.extent()[0]

        def value(x, load):
            x = blank.along(x)
            moved = np.zeros_like(x)
            moved[:2] = (deformation(load) - np.eye(2)) @ (x[:2] - corner[:2, None])
            return moved

        return [Support("frame", on_edge(blank), tuple(range(len(corner))), value)]

    return supports


def check_held(scene: "Scene") -> str:
    """Raise InputError, naming the motion, if supports and terms let the blank move as a rigid
    body; a sentence to warn with if, in its plane, only the shapes of smooth tools may hold it.

    Planes never do, nor does a ball against turning: motions along which no tool's normal anywhere
    points are refused. Other tools may once the sheet is formed, so refusing them would be wrong.
    """
    blank = scene.blank
    low, high = blank.extent()
    flat = len(low) == 2 or (high - low)[2] <= FLAT * (high - low).max()
    resisted = {word for term in scene.terms for word in term.resists}
    node, axis = np.divmod(scene.held, len(low))
    x, along = blank.coordinates()[node], np.eye(3)[axis]
    free, smooth = free_motion(blank, x, along, resisted), "lift" in resisted
    if not free:
        return ""
    if smooth and not (flat and len(scene.tools()) == 1):
        touching = [term for term in scene.terms if isinstance(term, Touching)]
        pressed = [each for term in touching for each in term.may_press()]
        places, normals = (np.vstack(each) for each in zip((x, along), *pressed))
        shapes_leave = free_motion(blank, places, normals, resisted)
        if flat and not shapes_leave:
            return (
                f"nothing but the shapes of tools without friction holds {blank.name}, which may "
                f"{free} until it is formed: steps are slow till then and may fail; allowed, too, "
                "are friction and supports that only locate it (`Support(..., locates=True)`)"
            )
        free = shapes_leave
    if free:
        names = ", ".join(support.name for support in scene.supports) or "none"
        raise InputError(
            f"the supports ({names}) leave {blank.name} free to {free}"
            + (", which contact without friction does not resist" if smooth else "")
            + "; allowed are supports, or a term's `resists`, that hold every rigid motion"
            + (", or friction, as `Contact(tool, friction=0.25)`" if smooth else "")
        )
    return ""


def free_motion(blank: Blank, places: np.ndarray, along: np.ndarray, resisted: set[str]) -> str:
    """The rigid motion, in words such as "turn about its length", that is left free by the terms'
    `resisted` ones and by what holds points of this rank at `places` (k, 3) [mm] along axes of the
    frame or vectors `along` (k, 3); "" if none is."""
    gdim = blank.mesh.geometry.dim
    low, high = (corner[:, None] for corner in blank.extent())
    x = (blank.along(places.T) - (low + high) / 2) / (high - low).max()
    turns = [(0, 1)] if gdim == 2 else [(1, 2), (2, 0), (0, 1)]
    moves = list(along.T[:gdim])
    motions = np.array(moves + [x[i] * moves[j] - x[j] * moves[i] for i, j in turns])
    axes = "length", "width", "normal"
    names = [f"move along its {axis}" for axis in axes[:gdim]]
    names += [f"turn about its {axis}" for axis in (axes[2:] if gdim == 2 else axes)]
    left = [
        i
        for i, name in enumerate(names)
        if not {name.split()[0], "lift" if name in LIFTS else "slide"} & resisted
    ]
    products = blank.mesh.comm.allreduce(motions @ motions.T, MPI.SUM)[np.ix_(left, left)]
    if not left:
        return ""
    stiffness, free = np.linalg.eigh(products)
    if stiffness[0] > 1e-9 * max(stiffness[-1], 1.0):
        return ""
    return names[left[np.abs(free[:, 0]).argmax()]]


def locating_warning(scene: "Scene") -> str:
    """A sentence if supports that only locate the sheet bear a force in the present state, after
    `Scene.residual`, else ""."""
    forces = scene.outer_forces()
    most = BORNE * sum(forces.values())
    locating = [each.name for each in scene.supports if each.locates]
    borne = {name: forces[name] for name in locating if forces[name] > most}
    if not borne:
        return ""
    told = " and ".join(f"{name} {force:.3g} N" for name, force in borne.items())
    return (
        f"supports that should only keep the sheet in its place bear {told}, as sheet, yarns or "
        "tools are not symmetric: the formed shape depends on them; give supports of your own"
    )
