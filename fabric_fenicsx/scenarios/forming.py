"""Forming of a woven ply between rigid tools: punch, die and blank holder (Figs 11 to 16 of
Schäfer et al., for a single ply)."""

import dataclasses
import itertools
import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.optimize import brentq

from ..errors import InputError
from ..job import Result
from ..mechanics.bending import Bending
from ..mechanics.contact import Contact
from ..mechanics.friction import Friction
from ..mechanics.load import EdgeTension
from ..mechanics.membrane import Membrane
from ..mechanics.nodes import PressingTerm
from ..mechanics.pressing import BlankHolderPressure
from ..mechanics.pressure_law import default_penalty
from ..mechanics.term import Term
from ..results import measures
from ..scene import Scene
from ..sheets.blank import Blank
from ..sheets.stack import Stack
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
from . import stacking
from .numbers import FINITE, FROM_ZERO, POSITIVE, choice, number, switch, text
from .plies import Ply, read_plies
from .scenario import ELEMENTS, Scenario

if TYPE_CHECKING:
    import pyvista

log = logging.getLogger("fabric_fenicsx")
ANGLES = 0, 45, 90  # of the paths to x [deg]
HOLDERS = ("pressure", "force", "gap", "grippers")
PLIES_SAY = "fibre_angle", "yarn_angle", "weave_angle", "mesh"  # of each ply of a stack
RINGS = 2.0, 4.0, 6.0  # mm about a node, in which the die must be flat for it to be held
UP = np.array([0.0, 0.0, 1.0])
PLANES = [lambda x: x[0] < 1e-6, lambda x: x[1] < 1e-6]  # of symmetry of a quarter
DIMENSIONS = ", ".join(each.name for each in dataclasses.fields(DoubleDome))


@dataclass(kw_only=True)
class Forming(Scenario):
    """A ply of `fabric` between punch, die and blank holder; a quarter of it unless `full`.

    The flat ply lies in z = 0 with its centre at the origin, under the die's flange. The punch
    comes from below. punch: a surface with its flange at z = 0, or a file of one, in place of the
    double dome; `dome`: dimensions of that, as a mapping or as texts NAME=VALUE.
    """

    NAME: ClassVar[str] = "double_dome"
    FULL = {"nx": 47, "steps": 40}
    QUICK = {"nx": 12, "steps": 12}
    SOLVER = {"path_tolerance": 1e-6, "balance": 0.02, "every": 10}
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
    stack: str | Sequence[Ply] | None = text(
        None, "plies on one another, from the punch to the die: a TOML file", "FILE", "ply"
    )
    stroke: float = number(None, POSITIVE, "of the punch (the dome's depth) [mm]", "tools")
    dome: Mapping[str, float] | Sequence[str] = field(
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
        self.plies = self._plies()
        if not self.full:
            take = f"take the whole ply ({self.spelled('full')})"
            self.warnings += [
                f"{ply.mirror_warning()}; {take}" for ply in self.plies if ply.mirror_warning()
            ]
        self.blank = self._blank()
        # of all that lies between the tools
        t = self.thickness = sum(ply.fabric.thickness for ply in self.plies if ply.fabric)
        surface = self._surface()
        depth = self._depth(surface)
        self.stroke = self.stroke or depth
        if self.stroke > depth:
            raise InputError(
                f"{self.spelled('stroke')} {self.stroke:g} is deeper than the die; allowed is up "
                f"to {depth:g} mm"
            )
        self.clearance = self.clearance or 1.2 * t
        if self.clearance < t:
            raise InputError(
                f"{self.spelled('clearance')} {self.clearance:g} is less than the ply's "
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
        nodes = self.blank.coordinates()[:owned] * (1, 1, 0 if self.stack else 1)
        check_motion([self.punch_tool, self.die], nodes, t, self.comm)
        radius = min(*self.punch_tool.surface.radii, *self.die.surface.radii)
        self.penalty = self.penalty or min(
            default_penalty(ply.fabric, radius) for ply in self.plies if ply.fabric
        )

    def membranes(self) -> list[Membrane]:
        """As in `Scenario`."""
        return stacking.membranes(self.plies) if self.stack else [self.fabric_membrane()]

    def _plies(self) -> list[Ply]:
        """Those of the stack, the lowest first, or the one of the other fields."""
        if self.stack is None:
            return [
                Ply(fabric=self.fabric, fibre_angle=self.fibre_angle, yarn_angle=self.yarn_angle)
            ]
        usual = {each.name: each.default for each in dataclasses.fields(self)}
        if given := [self.spelled(k) for k in PLIES_SAY if getattr(self, k) != usual[k]]:
            raise InputError(
                f"{', '.join(given)} is given beside {self.spelled('stack')}; allowed is to say "
                "it of each ply"
            )
        plies = read_plies(self.stack) if isinstance(self.stack, str) else self.stack
        return [ply.completed(self.fabric, f"ply {k + 1}") for k, ply in enumerate(plies)]

    def _blank(self) -> Blank:
        share = 1.0 if self.full else 0.5
        if self.stack is None:
            return self.sheet(share=share, centred=self.full)
        sizes = [getattr(self, k) or usual for k, usual in zip(self.SIZES, self.DEFAULT_SIZES)]
        options = {
            "ny": self.ny,
            "pattern": self.pattern,
            "element": self.element,
            "centred": self.full,
            "comm": self.comm,
        }
        return stacking.lay(self.plies, lambda ply: ply.blank(sizes, share, self.nx, **options))

    def _depth(self, surface):
        """Greatest stroke of a punch with this surface [mm]."""
        if isinstance(surface, DoubleDome):
            return surface.depth
        if isinstance(surface, TriangulatedSurface):
            return float(surface.points[:, 2].max())
        if self.stroke is None:
            raise InputError("stroke is not given; allowed is one [mm] for a surface of your own")
        return self.stroke

    def _surface(self):
        """The punch's surface, checked."""
        if not self.punch:
            return _dome(self.dome, self.spelled("dome"))
        low, high = self.blank.extent()
        half = np.maximum(abs(low), abs(high))[:2]
        surface, name = self.punch, self.spelled("punch")
        if not isinstance(surface, Surface):
            surface = TriangulatedSurface.read(surface, self.chord)
            name += f" {self.punch}"
        warn = self.warnings.append
        if isinstance(surface, TriangulatedSurface):
            check_punch(surface, name, half, self.thickness, warn)
        return surface

    def terms(self) -> list[Term]:
        """Bending, contact with the tools, blank holder, friction."""
        terms = [*self._bending(), self._contact(self.die), self._contact(self.punch_tool)]
        terms += self._blank_holder()
        if isinstance(self.blank, Stack):
            planes = () if self.full else PLANES
            terms += stacking.between(self.blank, self.plies, self.slip, self.lag, planes)
        self.pressing = [term for term in terms if isinstance(term, PressingTerm)]
        self.contacts = [term for term in self.pressing if isinstance(term, Contact)]
        rubbed = [term.tool for term in self.pressing] if self.friction else []
        return terms + [Friction(tool, self.friction, self.slip, self.lag) for tool in rubbed]

    def _contact(self, tool):
        return Contact(tool, penalty=self.penalty, permitted=self.permitted)

    def _bending(self) -> list[Term]:
        if not self.bending_modulus:
            return []
        terms: list[Term] = [
            Bending(
                modulus=self.bending_modulus,
                twist_modulus=self.twist_modulus,
                in_plane=self.in_plane_bending,
                symmetric=() if self.full else PLANES,
            )
            for _ in self.plies
        ]
        return [term.on(p.name) for term, p in zip(terms, self.plies)] if self.stack else terms

    def _blank_holder(self) -> list[Term]:
        t = self.thickness
        if self.holder == "pressure":
            pressure = BlankHolderPressure(self.holder_pressure, UP, self._on_flange, lag=self.lag)
            return [pressure.on(self.plies[0].name) if self.stack else pressure]
        if self.holder == "grippers":
            return list(self._gripped_edges())
        gap = self.holder_gap or 1.1 * t
        if self.holder == "gap":
            if gap < 0.5 * t:
                raise InputError(
                    f"{self.spelled('holder_gap')} {gap:g} crushes the ply; allowed is from "
                    f"{t / 2:g} mm, half its thickness"
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
        t, rings = self.thickness, itertools.product(RINGS, np.arange(8) * math.pi / 4)
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

    def start(self) -> None:
        """Press the sheets of a stack together as under the holder: where that is not so, they part
        at once, while sheets that do not touch yet resist nothing."""
        held = self.holder == "pressure" and self.holder_pressure
        if isinstance(self.blank, Stack) and held:
            on_die = next(term for term in self.contacts if term.tool is self.die)
            terms, under = self.scene.terms, self._on_flange
            stacking.press(self.blank, terms, on_die, self.holder_pressure, under)

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Stroke [mm] and force [N] of the punch, of a quarter if that is modelled."""
        return load * self.stroke, float(scene.tool_force(self.punch_tool)[2])

    def quantities(self, result: Result) -> dict[str, Any]:
        """Forces, penetrations, shear, strains, draw-in and wrinkles."""

        rows = result.rows
        plies = {
            part.name: self._ply_quantities(result, part)
            for part in (self.blank.parts.values() or [self.blank.whole])
        }
        several = {"plies": plies} if self.stack else {}
        worst = max(plies.values(), key=lambda q: q["shear_angle_max_deg"])
        several["draw_in"] = max(
            (q["draw_in"] for q in plies.values()), key=lambda found: found["largest_mm"]
        )
        total = sum((self.scene.tool_force(term.tool) for term in self.pressing), np.zeros(3))
        strain, force = rows[-1]["strain_energy_Nmm"], rows[-1]["reaction_N"]
        return (
            {
                "punch_force_N": force,
                "punch_force_of_whole_ply_N": force * (1 if self.full else 4),
                "contact_forces_N": {
                    contact.tool.name: float(np.linalg.norm(contact.force()))
                    for contact in self.contacts
                },
                "unbalanced_force_N": float(abs(total[2])),
                "penalty_N_per_mm3": self.penalty,
                "penetration_mm": max(contact.penetration() for contact in self.contacts),
                "penetration_largest_mm": max(contact.deepest() for contact in self.contacts),
                "penetration_of_thickness": self.scene.penetration_of_thickness(),
                "sticking_slip_mm": self.slip if self.friction else None,
                "viscous_of_strain_energy": rows[-1]["viscous_energy_Nmm"] / strain
                if strain
                else 0.0,
            }
            | worst
            | several
        )

    def _ply_quantities(self, result, part):
        """Shear, strains, draw-in and wrinkles of one ply."""
        from ..results import forming

        comm, shape = self.comm, None
        if comm.rank == 0:
            grid = result.grids[part.name]
            wrinkles = forming.wrinkles(grid, self.punch_tool, self.fabric.thickness)
            shape = {"draw_in": forming.draw_in(grid), "wrinkles": wrinkles}
        fields = {name: values[part.cells] for name, values in result.fields.items()}
        gamma = np.degrees(np.abs(fields["shear_angle"]))
        ellipticity, states = fields["stability_ellipticity"], fields["strain_state"]

        def extremes(values):
            return measures.extremes(comm, values)

        return {
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

        grids, formed = result.grids, []
        for ply, (name, grid) in zip(self.plies, grids.items()):
            end = f"_{name.replace(' ', '_')}" if name else ""
            forming.write_paths(folder / f"paths{end}.csv", forming.along_paths(grid, ANGLES))
            forming_pictures.state_map(folder / f"states{end}.png", grid)
            formed.append((grid, (ply.fibre_angle, ply.fibre_angle + ply.yarn_angle)))
        try:
            forming_pictures.formed_picture(folder / "formed.png", formed, self.punch_mesh())
        except InputError as error:  # nothing to draw with, which is no reason to lose a run
            log.warning("warning: formed.png was not drawn: %s", error)
        self._compare(grids, folder)

    def compare(self, results: Mapping[str, Result], folder: Path) -> None:
        """Outlines and paths of plies {label: `Result`} side by side, into `folder`."""
        grids = {
            " ".join(filter(None, (label, name))): grid
            for label, result in results.items()
            for name, grid in result.grids.items()
        }
        self._compare(grids, folder)

    def _compare(self, grids, folder):
        from ..results import forming, forming_pictures

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


def _dome(pairs, name):
    """The `DoubleDome` with dimensions {name: value} or texts NAME=VALUE."""
    names, given = [each.name for each in dataclasses.fields(DoubleDome)], {}
    if isinstance(pairs, Mapping):
        pairs = [f"{key}={value!r}" for key, value in pairs.items()]
    for pair in pairs:
        key, _, value = pair.partition("=")
        try:
            given[key] = float(value)
        except ValueError:
            raise InputError(
                f"{name} {pair} has no number after its name; allowed is NAME=VALUE"
            ) from None
        if key not in names:
            raise InputError(f"{name} {pair} names no dimension; allowed are {', '.join(names)}")
    return DoubleDome(**given)
