"""The double-dome forming of a ply: its options, its scene and what is measured in it."""

import dataclasses
import itertools
import json
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import brentq

from .cli import ANY, FROM_ZERO, POSITIVE, Parser
from .errors import InputError
from .material.baseline import Fabric
from .mechanics.bending import Bending, plate_stiffness
from .mechanics.contact import Contact, Pressing, default_penalty
from .mechanics.friction import Friction
from .mechanics.load import EdgeTension
from .scene import Scene, Support
from .study import Result, Study, add_weave_options, parser
from .tools import DoubleDome, Offset, Plane, Reversed, Tool, TriangulatedSurface, check_motion, check_punch

if TYPE_CHECKING:
    import pyvista

ANGLES = 0, 45, 90  # of the paths to x [deg]
HOLDERS = ("pressure", "force", "gap", "grippers")
RINGS = 2.0, 4.0, 6.0  # mm about a node, in which the die must be flat for it to be held


def forming_parser(name: str, description: str, full: dict[str, int], quick: dict[str, int]) -> Parser:
    """The parser of a study that forms plies: what all studies share and the options of this scene; see `study.parser`."""
    p = parser(name, description, full, quick, element="P1", tolerance=1e-6, path_tolerance=1e-6, every=10)
    ply = p.add_argument_group("ply")
    ply.add_argument("--length", type=POSITIVE, default=470.0, help="along x [mm]")
    ply.add_argument("--width", type=POSITIVE, default=270.0, help="along y [mm]")
    ply.add_argument("--full", action="store_true", help="the whole ply; otherwise a quarter of it")
    ply.add_argument("--bending-modulus", type=FROM_ZERO, default=100.0, help="E_b of both yarns [MPa]")
    ply.add_argument("--twist-modulus", type=FROM_ZERO, default=1.0, help="G [MPa]")
    ply.add_argument("--in-plane-bending", type=FROM_ZERO, default=0.0, help="of yarns in the ply, of that out of it")
    add_weave_options(p)
    tools = p.add_argument_group("tools")
    tools.add_argument("--stroke", type=POSITIVE, help="of the punch (the dome's depth) [mm]")
    tools.add_argument(
        "--dome", metavar="NAME=VALUE", action="append", default=[],
        help="dimension of the double dome: " + ", ".join(f.name for f in dataclasses.fields(DoubleDome)),
    )  # fmt: skip
    tools.add_argument(
        "--punch", metavar="FILE", help="surface instead, with its flange at z = 0 [mm]: STL, VTP, MSH, STEP, IGES"
    )
    tools.add_argument("--chord", type=POSITIVE, default=0.1, help="of the triangles on faces of STEP and IGES [mm]")
    tools.add_argument("--clearance", type=POSITIVE, help="between punch and die (1.2 thicknesses) [mm]")
    tools.add_argument("--friction", type=FROM_ZERO, default=0.25, help="coefficient of ply on tools")
    tools.add_argument("--slip", type=POSITIVE, default=0.1, help="that sticking friction permits [mm]")
    tools.add_argument(
        "--lag",
        type=POSITIVE,
        default=0.01,
        help="of pressed areas and normal forces behind the present ones, of their sum",
    )
    tools.add_argument("--penalty", type=POSITIVE, help="of contact (from stiffness and radii) [N/mm^3]")
    tools.add_argument("--permitted", type=POSITIVE, help="penetration, kept by augmented contact (any) [mm]")
    holder = p.add_argument_group("blank holder")
    holder.add_argument("--holder", choices=HOLDERS, default="pressure")
    holder.add_argument("--holder-pressure", type=FROM_ZERO, default=2.0, help="on what lies on the flange [MPa]")
    holder.add_argument("--holder-force", type=FROM_ZERO, default=1e5, help="on the whole ply [N]")
    holder.add_argument("--holder-gap", type=POSITIVE, help="to the die (1.1 thicknesses) [mm]")
    holder.add_argument("--gripper-tension", type=ANY, default=5.0, help="on the ply's edges [N/mm]")
    return p


def _dome(pairs):
    """The `DoubleDome` with the dimensions NAME=VALUE of the options."""
    names, given = [f.name for f in dataclasses.fields(DoubleDome)], {}
    for pair in pairs:
        name, _, value = pair.partition("=")
        try:
            given[name] = float(value)
        except ValueError:
            raise InputError(f"--dome {pair} has no number after its name; allowed is NAME=VALUE") from None
        if name not in names:
            raise InputError(f"--dome {pair} names no dimension; allowed are {', '.join(names)}")
    return DoubleDome(**given)


class Forming:
    """A ply of `fabric` between punch, die and blank holder: terms and supports of its scene, and its measures.

    The flat ply lies in z = 0 with its centre at the origin, under the die's flange. The punch comes from below.
    study: with the options of `forming_parser`; part: the subfolder of its output. Raises InputError for options that
    do not fit the dome, the ply or each other.
    """

    def __init__(self, study: Study, fabric: Fabric, part: str = "") -> None:
        args, t = study.args, fabric.thickness
        self.study, self.args, self.fabric, self.thickness = study, args, fabric, t
        self.part, self.folder = part, args.out / part
        share = 1.0 if args.full else 0.5
        self.blank = study.specimen(share * args.length, share * args.width, spatial=True, centred=args.full)
        surface: DoubleDome | TriangulatedSurface
        surface = self._from_file() if args.punch else _dome(args.dome)
        depth = surface.depth if isinstance(surface, DoubleDome) else float(surface.points[:, 2].max())
        self.stroke = args.stroke or depth
        if self.stroke > depth:
            raise InputError(f"--stroke {self.stroke:g} is deeper than the die; allowed is up to {depth:g} mm")
        clearance = args.clearance or 1.2 * t
        if clearance < t:
            raise InputError(f"--clearance {clearance:g} is less than the ply's thickness; allowed is from {t:g} mm")
        start = t / 2 - clearance - depth  # so that it would end `clearance` from the die all over
        self.punch = Tool("punch", surface, lambda load: (0.0, 0.0, start + load * self.stroke))
        self.die = Tool("die", Reversed(Offset(surface, clearance)), lambda load: (0.0, 0.0, t / 2 - clearance))
        owned = self.blank.V.dofmap.index_map.size_local
        check_motion([self.punch, self.die], self.blank.coordinates()[:owned], t, study.comm)
        radius = min(*self.punch.surface.radii, *self.die.surface.radii)
        self.penalty = args.penalty or default_penalty(fabric, radius if math.isfinite(radius) else 10 * t)
        self.membrane = study.membrane(self.blank, fabric)
        self.terms = [*self._bending(), self._contact(self.die), self._contact(self.punch), *self._holder()]
        self.pressing = [term for term in self.terms if isinstance(term, (Contact, Pressing))]
        self.contacts = [term for term in self.pressing if isinstance(term, Contact)]
        self.frictions = [Friction(k, args.friction, args.slip, args.lag) for k in self.pressing if args.friction]
        self.terms += self.frictions

    def _from_file(self):
        low, high = self.blank.extent()
        half = np.maximum(abs(low), abs(high))[:2]
        surface = TriangulatedSurface.read(self.args.punch, self.args.chord)
        return check_punch(surface, f"--punch {self.args.punch}", half, self.thickness, self.study.warn)

    def _contact(self, tool):
        return Contact(self.blank, tool, self.thickness, self.penalty, permitted=self.args.permitted)

    def _bending(self):
        args, t = self.args, self.thickness
        stiffness = plate_stiffness(args.bending_modulus, t)
        if not stiffness:
            return []
        planes = () if args.full else [lambda x: x[0] < 1e-6, lambda x: x[1] < 1e-6]
        return [Bending(self.blank, stiffness, D_t=4 * plate_stiffness(args.twist_modulus, t), in_plane=args.in_plane_bending, symmetric=planes)]  # fmt: skip

    def _holder(self):
        args, t, up = self.args, self.thickness, np.array([0.0, 0.0, 1.0])

        def side(axis, place):
            return lambda x: abs(x[axis] - place) < 1e-6

        if args.holder == "pressure":
            return [Pressing(self.blank, args.holder_pressure, up, self._on_flange, lag=args.lag)]
        if args.holder == "grippers":
            low, high = self.blank.extent()
            edges = []
            for axis in (0, 1):
                for place, sign in ((low[axis], -1.0), (high[axis], 1.0)):
                    if sign > 0 or args.full:
                        edges.append(EdgeTension(self.blank, args.gripper_tension, sign * np.eye(3)[axis], side(axis, place)))  # fmt: skip
            return edges
        gap = args.holder_gap or 1.1 * t
        if args.holder == "gap":
            if gap < 0.5 * t:
                raise InputError(
                    f"--holder-gap {gap:g} crushes the ply; allowed is from {t / 2:g} mm, half its thickness"
                )
            return [self._contact(Tool("blank holder", Plane((0, 0, t / 2 - gap), up)))]
        force = args.holder_force * (1.0 if args.full else 0.25)
        return [self._contact(Tool("blank holder", Plane((0, 0, -t / 2), up), force=lambda load: force * up))]  # fmt: skip

    def _on_flange(self, x):
        """Share of the places x (n, 3) that lies beneath the die's flange, (n,): 0 at its end, 1 from `RINGS` inwards."""
        rings = itertools.product(RINGS, np.arange(8) * math.pi / 4)
        shifts = np.array([(r * math.cos(angle), r * math.sin(angle), 0) for r, angle in rings])
        at = (x * (1, 1, 0) + shifts[:, None]).reshape(-1, 3)
        gap, normal, _ = self.die.evaluate(at, reach=self.thickness)
        flat = (abs(gap - self.thickness / 2) < 1e-3 * self.thickness) & (normal[:, 2] < -0.999)
        seen = flat.reshape(len(shifts), -1).sum(0)
        return np.clip(2 * seen / (8 * len(RINGS)) - 1, 0, 1)

    @property
    def supports(self) -> list[Support]:
        """The planes of symmetry of a quarter; of a whole ply its centre and the turn about it."""
        near = 1e-6
        if not self.args.full:
            return [
                Support("plane of symmetry x = 0", lambda x: x[0] < near, (0,)),
                Support("plane of symmetry y = 0", lambda x: x[1] < near, (1,)),
            ]
        end = self.args.length / 2 - near
        return [
            Support("centre", lambda x: np.hypot(x[0], x[1]) < near, (0, 1)),
            Support("end of the axis", lambda x: (abs(x[1]) < near) & (x[0] > end), (1,)),
        ]

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Way [mm] and force [N] of the punch, of a quarter if that is modelled."""
        forces = [contact.force() for contact in self.contacts if contact.tool is self.punch]
        forces += [friction.settled for friction in self.frictions if friction.tool is self.punch]
        return load * self.stroke, float(sum(forces, np.zeros(3))[2])

    def quantities(self, fields: Mapping[str, np.ndarray], rows: list[dict[str, Any]]) -> dict[str, Any]:
        """The study's own numbers, of the last state's cell fields and the history's rows: forces, penetrations, shear,
        strains, draw-in and wrinkles; their names end with their units."""
        study = self.study
        from .results import forming
        from .results.fields import read_last

        seen = None
        if study.comm.rank == 0:
            grid = read_last(self.folder)
            seen = {"draw_in": forming.draw_in(grid), "wrinkles": forming.wrinkles(grid, self.punch, self.thickness)}
        gamma = np.degrees(np.abs(fields["shear_angle"]))
        total = sum((k.force() for k in self.pressing), np.zeros(3))
        total = total + sum((k.settled for k in self.frictions), np.zeros(3))
        strain, deepest = rows[-1]["strain_energy_Nmm"], max(k.deepest() for k in self.contacts)
        return {
            "punch_force_N": rows[-1]["reaction_N"],
            "punch_force_of_whole_ply_N": rows[-1]["reaction_N"] * (1 if self.args.full else 4),
            "contact_forces_N": {k.tool.name: float(np.linalg.norm(k.force())) for k in self.contacts},
            "unbalanced_force_N": float(abs(total[2])),
            "penalty_N_per_mm3": self.penalty,
            "penetration_mm": max(k.penetration() for k in self.contacts),
            "penetration_largest_mm": deepest,
            "penetration_of_thickness": deepest / self.thickness,
            "sticking_slip_mm": self.args.slip if self.args.friction else None,
            "viscous_of_strain_energy": rows[-1]["viscous_energy_Nmm"] / strain if strain else 0.0,
            "shear_angle_deg": study.extremes(np.degrees(fields["shear_angle"])),
            "shear_angle_max_deg": study.extremes(gamma)[1],
            "log_eps_11": study.extremes(fields["log_eps_11"]),
            "log_eps_22": study.extremes(fields["log_eps_22"]),
            "stability_ellipticity_min": study.extremes(fields["stability_ellipticity"])[0],
            "cells_that_lost_ellipticity": study.comm.allreduce(int((fields["stability_ellipticity"] < 0).sum())),
            "share_of_state_1_to_4": [study.mean((fields["strain_state"] == k) * 1.0, gamma > -1) for k in (1, 2, 3, 4)],
        } | study.comm.bcast(seen)  # fmt: skip

    def run(self) -> Result:
        """Form the ply; the study's `Result`. Raises SolverFailure, after all is written, if the stroke was not
        reached."""
        return self.study.march(self.membrane, self.supports, self.measure, self.quantities, self.part, self.terms)

    def summary(self) -> dict[str, Any]:
        """What summary.json of the last run says."""
        text = (self.folder / "summary.json").read_text() if self.study.comm.rank == 0 else None
        return json.loads(self.study.comm.bcast(text))

    def punch_mesh(self) -> "pyvista.PolyData":
        """The punch, where it is now, as a PyVista surface [mm]."""
        import pyvista

        from .meshes.double_dome import double_dome

        surface = self.punch.surface
        if isinstance(surface, TriangulatedSurface):
            points, triangles = surface.points, surface.triangles
        else:
            points, triangles = double_dome(surface, size=8.0)
        return pyvista.PolyData.from_regular_faces(points + self.punch.displacement, triangles)


def pictures(study: Study, runs: Mapping[str, tuple[Forming, Result]]) -> None:
    """Pictures, paths and punches of formed plies {label: (`Forming`, `Result`)}, on rank 0: of each in its own folder, and all
    together in the study's."""
    if study.comm.rank != 0 or study.args.no_pictures:
        return
    from .results import forming as see
    from .results import pictures
    from .results.fields import read_last

    args, grids, paths = study.args, {}, {}
    yarns = args.fibre_angle, args.fibre_angle + args.yarn_angle
    for label, (forming, result) in runs.items():
        folder, grid = result.folder, read_last(result.folder)
        grids[label], paths[label] = grid, see.along_paths(grid, ANGLES)
        see.write_paths(folder / "paths.csv", paths[label])
        see.state_map(folder / "states.png", grid)
        punch = forming.punch_mesh()
        try:
            see.formed_picture(folder / "formed.png", grid, punch, yarns)
        except InputError as error:  # nothing to draw with, which is no reason to lose a run
            study.warn(f"formed.png was not drawn: {error}")
    see.outline_picture(study.args.out / "outline.png", grids)
    surface, marks = forming.punch.surface, {}
    if isinstance(surface, DoubleDome):
        at = [brentq(lambda r: surface.plan(*(r * np.array([[math.cos(k)], [math.sin(k)]])))[0][0], 0, 1e3) for k in np.radians(ANGLES)]  # fmt: skip
        marks = {"outline of the punch": at}
    see.paths_picture(study.args.out / "paths.png", paths, marks)
    if len(runs) > 1:
        curves = {
            label: ([row["displacement_mm"] for row in r.rows], [row["reaction_N"] for row in r.rows])
            for label, (_, r) in runs.items()
        }
        pictures.curves(study.args.out / "compare_curves.png", curves, "stroke / mm", "punch force / N")
