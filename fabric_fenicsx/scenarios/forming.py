"""Forming of a woven ply between rigid tools: punch, die and blank holder (Figs 11 to 16 of
Schäfer et al., for a single ply)."""

import dataclasses
import itertools
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.optimize import brentq

from ..errors import InputError
from ..job import Result
from ..mechanics.bending import Bending
from ..mechanics.contact import Contact, default_penalty
from ..mechanics.friction import Friction
from ..mechanics.load import EdgeTension
from ..mechanics.nodes import PressingTerm
from ..mechanics.pressing import BlankHolderPressure
from ..mechanics.term import Term
from ..results import measures
from ..scene import Scene
from ..supports import Support
from ..tools import (
    DoubleDome,
    Offset,
    Plane,
    Reversed,
    Surface,
    Tool,
    TriangulatedSurface,
    check_motion,
    check_punch,
)
from .numbers import FINITE, FROM_ZERO, POSITIVE, choice, number, switch, text
from .scenario import ELEMENTS, Scenario

if TYPE_CHECKING:
    import pyvista

log = logging.getLogger("fabric_fenicsx")
ANGLES = 0, 45, 90  # of the paths to x [deg]
HOLDERS = ("pressure", "force", "gap", "grippers")
RINGS = 2.0, 4.0, 6.0  # mm about a node, in which the die must be flat for it to be held
UP = np.array([0.0, 0.0, 1.0])
DIMENSIONS = ", ".join(each.name for each in dataclasses.fields(DoubleDome))


@dataclass(kw_only=True)
class Forming(Scenario):
    """A ply of `fabric` between punch, die and blank holder; a quarter of it unless `full`.

    The flat ply lies in z = 0 with its centre at the origin, under the die's flange. The punch
    comes from below. punch: a surface with its flange at z = 0, or a file of one, in place of the
    double dome; `dome`: that, its dimensions as a mapping, or as texts NAME=VALUE.
    """

    NAME: ClassVar[str] = "double_dome"
    FULL = {"nx": 47, "steps": 40}
    QUICK = {"nx": 12, "steps": 12}
    SOLVER = {"tolerance": 1e-6, "path_tolerance": 1e-6, "every": 10}
    DEFAULT_SIZES = (470.0, 270.0)
    SPATIAL = True

    element: str = choice("P1", ELEMENTS, "P: triangles, Q: quadrilaterals", "mesh")
    length: float = number(None, POSITIVE, "along x (470, or the mesh's) [mm]", "ply")
    width: float = number(None, POSITIVE, "along y (270, or the mesh's) [mm]", "ply")
    full: bool = switch("the whole ply; otherwise a quarter of it", "ply")
    bending_modulus: float = number(100.0, FROM_ZERO, "E_b of both yarns [MPa]", "ply")
    twist_modulus: float = number(1.0, FROM_ZERO, "G [MPa]", "ply")
    in_plane_bending: float = number(
        0.0, FROM_ZERO, "stiffness of yarns in the ply, of that out of it", "ply"
    )
    stroke: float = number(None, POSITIVE, "of the punch (the dome's depth) [mm]", "tools")
    dome: DoubleDome | Mapping[str, float] | Sequence[str] = field(
        default=(),
        metadata={
            "repeated": "NAME=VALUE",
            "help": f"dimension of the double dome: {DIMENSIONS}",
            "group": "tools",
        },
    )
    punch: str | Surface | None = text(
        None,
        "surface instead, with its flange at z = 0 [mm]: STL, VTP, MSH, STEP, IGES",
        "FILE",
        "tools",
    )
    chord: float = number(0.1, POSITIVE, "of the triangles on faces of STEP and IGES [mm]", "tools")
    clearance: float = number(
        None, POSITIVE, "between punch and die (1.2 thicknesses) [mm]", "tools"
    )
    friction: float = number(0.25, FROM_ZERO, "coefficient of ply on tools", "tools")
    slip: float = number(0.1, POSITIVE, "that sticking friction permits [mm]", "tools")
    lag: float = number(
        0.01,
        POSITIVE,
        "of pressed areas and normal forces behind the present ones, of their sum",
        "tools",
    )
    penalty: float = number(
        None, POSITIVE, "of contact (from stiffness and radii) [N/mm^3]", "tools"
    )
    permitted: float | None = number(
        None, POSITIVE, "penetration, kept by augmented contact (any) [mm]", "tools"
    )
    holder: str = choice("pressure", HOLDERS, "how the ply's rim is held", "blank holder")
    holder_pressure: float = number(
        2.0, FROM_ZERO, "on what lies on the flange [MPa]", "blank holder"
    )
    holder_force: float = number(1e5, FROM_ZERO, "on the whole ply [N]", "blank holder")
    holder_gap: float = number(None, POSITIVE, "to the die (1.1 thicknesses) [mm]", "blank holder")
    gripper_tension: float = number(5.0, FINITE, "on the ply's edges [N/mm]", "blank holder")

    def prepare(self) -> None:
        """Make blank, membrane and tools."""
        t = self.fabric.thickness
        if not self.full and not self._is_mirrored():
            self.warnings.append(
                f"yarns at {self.fibre_angle:g} and {self.fibre_angle + self.yarn_angle:g} deg are "
                "not their own mirror images, so the quarter stands for a ply of four mirrored "
                f"ones; take the whole ply (`full`)"
            )
        if self.full and not self.mesh:
            self.nx += self.nx % 2 if self.nx == self.FULL["nx"] else 0
            self.ny = self.ny or 2 * max(1, round(self.nx * self.width / self.length / 2))
        self.blank = self.sheet(share=1.0 if self.full else 0.5, centred=self.full)
        surface = self._surface()
        depth = self._depth(surface)
        self.stroke = self.stroke or depth
        if self.stroke > depth:
            raise InputError(
                f"`stroke` {self.stroke:g} is deeper than the die; allowed is up to {depth:g} mm"
            )
        self.clearance = self.clearance or 1.2 * t
        if self.clearance < t:
            raise InputError(
                f"`clearance` {self.clearance:g} is less than the ply's "
                f"thickness; allowed is from {t:g} mm"
            )
        lift = t / 2 - self.clearance  # so that the punch ends `clearance` from the die all over
        start, stroke = lift - depth, self.stroke
        self.punch_tool = Tool(
            surface, lambda load: (0.0, 0.0, start + load * stroke), name="punch"
        )
        self.die = Tool(
            Reversed(Offset(surface, self.clearance)), lambda load: (0.0, 0.0, lift), name="die"
        )
        owned = self.blank.V.dofmap.index_map.size_local
        nodes = self.blank.coordinates()[:owned]
        self._check_supported(nodes)
        check_motion([self.punch_tool, self.die], nodes, t, self.comm)
        radius = min(*self.punch_tool.surface.radii, *self.die.surface.radii)
        self.penalty = self.penalty or default_penalty(self.fabric, radius)
        self.membrane = self.fabric_membrane()

    def _check_supported(self, nodes):
        """A whole ply is held in single nodes, which even numbers of rectangles have."""
        for support in self.supports():
            if not self.comm.allreduce(int(support.where(nodes.T).sum())):
                raise InputError(
                    f"the ply has no node at its {support.name}; allowed for a whole ply are even "
                    "`nx`, `ny` and `pattern` crossed, left or right, or an own mesh with one"
                )

    def _is_mirrored(self):
        """Whether planes along the axes mirror the yarns into yarns of the same kind."""
        a, b = self.fibre_angle, self.fibre_angle + self.yarn_angle
        along = _is_multiple(a, 90) and _is_multiple(b, 90)
        one, two, sheared = np.array([[0.01, 0.02], [0.02, 0.01], [0.1, 0.1]])
        energies = self.fabric.derivatives(one, two, sheared, False).parts.sum(1)
        return along or (_is_multiple(a + b, 180) and math.isclose(*energies))

    def _depth(self, surface):
        """Greatest stroke of a punch with this surface [mm]."""
        if isinstance(surface, DoubleDome):
            return surface.depth
        if isinstance(surface, TriangulatedSurface):
            return float(surface.points[:, 2].max())
        if self.stroke is None:
            raise InputError("`stroke` is not given; allowed is one [mm] for a surface of your own")
        return self.stroke

    def _surface(self):
        """The punch's surface, checked."""
        if not self.punch:
            return self.dome if isinstance(self.dome, DoubleDome) else _dome(self.dome)
        low, high = self.blank.extent()
        half = np.maximum(abs(low), abs(high))[:2]
        surface, name = self.punch, "`punch`"
        if not isinstance(surface, Surface):
            surface = TriangulatedSurface.read(surface, self.chord)
            name += f" {self.punch}"
        warn = self.warnings.append
        if isinstance(surface, TriangulatedSurface):
            check_punch(surface, name, half, self.fabric.thickness, warn)
        return surface

    def terms(self) -> list[Term]:
        """Bending, contact with the tools, blank holder, friction."""
        terms = [*self._bending(), self._contact(self.die), self._contact(self.punch_tool)]
        terms += self._blank_holder()
        self.pressing = [term for term in terms if isinstance(term, PressingTerm)]
        self.contacts = [term for term in self.pressing if isinstance(term, Contact)]
        rubbed = [term.tool for term in self.pressing] if self.friction else []
        return terms + [Friction(tool, self.friction, self.slip, self.lag) for tool in rubbed]

    def _contact(self, tool):
        return Contact(tool, penalty=self.penalty, permitted=self.permitted)

    def _bending(self) -> list[Term]:
        if not self.bending_modulus:
            return []
        planes = () if self.full else [lambda x: x[0] < 1e-6, lambda x: x[1] < 1e-6]
        return [
            Bending(
                modulus=self.bending_modulus,
                twist_modulus=self.twist_modulus,
                in_plane=self.in_plane_bending,
                symmetric=planes,
            )
        ]

    def _blank_holder(self) -> list[Term]:
        t = self.fabric.thickness
        if self.holder == "pressure":
            return [BlankHolderPressure(self.holder_pressure, UP, self._on_flange, lag=self.lag)]
        if self.holder == "grippers":
            return list(self._gripped_edges())
        gap = self.holder_gap or 1.1 * t
        if self.holder == "gap":
            if gap < 0.5 * t:
                raise InputError(
                    f"`holder_gap` {gap:g} crushes the ply; allowed is from {t / 2:g} mm, half its "
                    "thickness"
                )
            return [self._contact(Tool(Plane((0, 0, t / 2 - gap), UP), name="blank holder"))]
        force = self.holder_force * (1.0 if self.full else 0.25)
        plate = Plane((0, 0, -t / 2), UP)
        return [self._contact(Tool(plate, force=lambda load: force * UP, name="blank holder"))]

    def _gripped_edges(self):
        """Tension on each free edge of the ply."""
        low, high = self.blank.extent()
        for axis in (0, 1):
            for place, sign in ((low[axis], -1.0), (high[axis], 1.0)):
                if sign > 0 or self.full:
                    yield EdgeTension(
                        self.gripper_tension, sign * np.eye(3)[axis], _at(axis, place)
                    )

    def _on_flange(self, x):
        """Share of the places x (n, 3) that lies beneath the die's flange, (n,): 0 at its end, 1
        from `RINGS` inwards."""
        t, rings = self.fabric.thickness, itertools.product(RINGS, np.arange(8) * math.pi / 4)
        shifts = np.array([(r * math.cos(angle), r * math.sin(angle), 0) for r, angle in rings])
        at = (x * (1, 1, 0) + shifts[:, None]).reshape(-1, 3)
        gap, normal, _ = self.die.evaluate(at, reach=t)
        flat = (abs(gap - t / 2) < 1e-3 * t) & (normal[:, 2] < -0.999)
        share = flat.reshape(len(shifts), -1).sum(0)
        return np.clip(2 * share / (8 * len(RINGS)) - 1, 0, 1)

    def supports(self) -> list[Support]:
        """The planes of symmetry of a quarter; of a whole ply its centre and the turn about it."""
        near = 1e-6
        if not self.full:
            return [
                Support("plane of symmetry x = 0", lambda x: x[0] < near, (0,)),
                Support("plane of symmetry y = 0", lambda x: x[1] < near, (1,)),
            ]
        end = self.length / 2 - near
        return [
            Support("centre", lambda x: np.hypot(x[0], x[1]) < near, (0, 1)),
            Support("end of the axis", lambda x: (abs(x[1]) < near) & (x[0] > end), (1,)),
        ]

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Stroke [mm] and force [N] of the punch, of a quarter if that is modelled."""
        return load * self.stroke, float(scene.tool_force(self.punch_tool)[2])

    def quantities(self, result: Result) -> dict[str, Any]:
        """Forces, penetrations, shear, strains, draw-in and wrinkles."""
        from ..results import forming

        t, comm, fields, rows = self.fabric.thickness, self.comm, result.fields, result.rows
        shape = None
        if comm.rank == 0:
            wrinkles = forming.wrinkles(result.grid, self.punch_tool, t)
            shape = {"draw_in": forming.draw_in(result.grid), "wrinkles": wrinkles}
        gamma = np.degrees(np.abs(fields["shear_angle"]))
        total = sum((self.scene.tool_force(term.tool) for term in self.pressing), np.zeros(3))
        strain, force = rows[-1]["strain_energy_Nmm"], rows[-1]["reaction_N"]
        deepest = max(contact.deepest() for contact in self.contacts)
        ellipticity, states = fields["stability_ellipticity"], fields["strain_state"]

        extremes = partial(measures.extremes, comm)

        return {
            "punch_force_N": force,
            "punch_force_of_whole_ply_N": force * (1 if self.full else 4),
            "contact_forces_N": {
                contact.tool.name: float(np.linalg.norm(contact.force()))
                for contact in self.contacts
            },
            "unbalanced_force_N": float(abs(total[2])),
            "penalty_N_per_mm3": self.penalty,
            "penetration_mm": max(contact.penetration() for contact in self.contacts),
            "penetration_largest_mm": deepest,
            "penetration_of_thickness": deepest / t,
            "sticking_slip_mm": self.slip if self.friction else None,
            "viscous_of_strain_energy": rows[-1]["viscous_energy_Nmm"] / strain if strain else 0.0,
            "shear_angle_deg": extremes(np.degrees(fields["shear_angle"])),
            "shear_angle_max_deg": extremes(gamma)[1],
            "log_eps_11": extremes(fields["log_eps_11"]),
            "log_eps_22": extremes(fields["log_eps_22"]),
            "stability_ellipticity_min": extremes(ellipticity)[0],
            "cells_that_lost_ellipticity": comm.allreduce(int((ellipticity < 0).sum())),
            "share_of_state_1_to_4": [
                measures.mean(comm, (states == k) * 1.0, np.ones(len(states))) for k in (1, 2, 3, 4)
            ],
        } | comm.bcast(shape)

    def punch_mesh(self) -> "pyvista.PolyData":
        """The punch, where it is now, as a PyVista surface [mm]."""
        import pyvista

        from ..meshes.double_dome import double_dome

        surface = self.punch_tool.surface
        if isinstance(surface, TriangulatedSurface):
            points, triangles = surface.points, surface.triangles
        elif isinstance(surface, DoubleDome):
            points, triangles = double_dome(surface, size=8.0)
        else:
            low, high = self.blank.extent()
            below, above = np.array([0, 0, -self.stroke]), np.array([0, 0, 2 * self.stroke])
            points, _, triangles = surface.mesh(low + below, high + above, 8.0)
        moved = points + self.punch_tool.displacement
        return pyvista.PolyData.from_regular_faces(moved, triangles)

    def pictures(self, result: Result, folder: Path) -> None:
        """Strain states, the formed ply and paths of this run."""
        from ..results import forming, forming_pictures

        grid = result.grid
        forming.write_paths(folder / "paths.csv", forming.along_paths(grid, ANGLES))
        forming_pictures.state_map(folder / "states.png", grid)
        yarns = self.fibre_angle, self.fibre_angle + self.yarn_angle
        try:
            forming_pictures.formed_picture(folder / "formed.png", grid, self.punch_mesh(), yarns)
        except InputError as error:  # nothing to draw with, which is no reason to lose a run
            log.warning("warning: formed.png was not drawn: %s", error)
        self.compare({"": result}, folder)

    def compare(self, results: Mapping[str, Result], folder: Path) -> None:
        """Outlines and paths of plies {label: `Result`} side by side, into `folder`."""
        from ..results import forming, forming_pictures

        grids = {label: result.grid for label, result in results.items()}
        forming_pictures.outline_picture(folder / "outline.png", grids)
        paths = {label: forming.along_paths(grid, ANGLES) for label, grid in grids.items()}
        surface, marks = self.punch_tool.surface, {}
        if isinstance(surface, DoubleDome):
            rays = [np.array([[math.cos(k)], [math.sin(k)]]) for k in np.radians(ANGLES)]
            at = [brentq(lambda r, ray=ray: surface.plan(*(r * ray))[0][0], 0, 1e3) for ray in rays]
            marks = {"outline of the punch": at}
        forming_pictures.paths_picture(folder / "paths.png", paths, marks)


def _at(axis, place):
    """Function of points (3, n) to whether their coordinate along `axis` is `place` [mm]."""
    return lambda x: abs(x[axis] - place) < 1e-6


def _is_multiple(angle, of):
    """Whether an angle is one of those, to 1e-6 deg."""
    return abs(math.remainder(angle, of)) < 1e-6


def _dome(pairs):
    """The `DoubleDome` with dimensions {name: value} or texts NAME=VALUE."""
    names, given = [each.name for each in dataclasses.fields(DoubleDome)], {}
    if isinstance(pairs, Mapping):
        pairs = [f"{key}={value!r}" for key, value in pairs.items()]
    for pair in pairs:
        key, _, value = pair.partition("=")
        try:
            given[key] = float(value)
        except ValueError:
            where = f"`dome` {pair} has no number after its name"
            raise InputError(f"{where}; allowed is NAME=VALUE") from None
        if key not in names:
            raise InputError(f"`dome` {pair} names no dimension; allowed are {', '.join(names)}")
    return DoubleDome(**given)
