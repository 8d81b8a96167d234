"""Forming of a woven ply between rigid tools: punch, die and blank holder (Figs 11 to 16 of
Schäfer et al., for a single ply)."""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from ..job.job import Result
from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.holder_pressure import BlankHolderPressure
from ..mechanics.contact.pressing_term import PressingTerm
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.shell import mesh_warnings
from ..mechanics.shell.bending import Bending
from ..mechanics.shell.membrane import Membrane
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.fields import number, one_of, switch, text
from ..runtime.rules import COUNT, FROM_ZERO, POSITIVE
from ..runtime.words import coordinates, rounded
from ..scene import reports
from ..scene.scene import Scene
from ..scene.supports import Support
from ..sheets.blank import Blank
from ..sheets.stack import Stack
from ..tools.checks import check_motion
from ..tools.double_dome import DoubleDome
from ..tools.surfaces import Offset, Reversed, Surface
from ..tools.tool import Tool
from . import holding, measuring, stacking
from .dome import DIMENSIONS, dome_of
from .holding import Holder, Press, PressureHolder
from .plies import TOOL_METAL_FRICTION, Ply, read_plies
from .punch import PRESSED, clearance_of, punch_of
from .scenario import FITS, Scenario, halved

if TYPE_CHECKING:
    import pyvista

PLIES_SAY = "fibre_angle", "yarn_angle", "weave_angle", "mesh", "outline"  # of each ply of a stack
OFF_CENTRE = 0.05  # of its extent, by which a sheet may lie off the punch without a word
ON_PLANE = 1e-6  # mm off a plane of symmetry up to which nodes lie on it
PLANES = [lambda x: x[0] < ON_PLANE, lambda x: x[1] < ON_PLANE]  # of symmetry of a quarter


@dataclass(kw_only=True)
class Forming(Scenario):
    """A ply of `fabric` between punch, die and blank holder; a quarter of it unless `full`.
    `fabric double_dome --help` tells what each field is, and its unit.

    A quarter has `nx` rectangles along half of the length, so with the same `nx` its cells are half
    as long as those of the whole ply.

    The flat ply lies in z = 0 with its centre at the origin, under the die's flange. The punch
    comes from below: its top begins just below the ply and rises by `stroke`. punch: a surface with
    its flange at z = 0, or a file of one, in place of the double dome; `dome`: that, its dimensions
    as a mapping, or as texts NAME=VALUE.
    """

    NAME: ClassVar[str] = "double_dome"
    HEADLINES = (
        *("punch_force_N", "shear_angle_max_deg", "shear_angle_99_percent_deg"),
        "draw_in.largest_mm",
    )
    FULL = {"nx": 47, "steps": 40, "balance": 0.02}
    QUICK = {"nx": 12, "steps": 12, "balance": None}  # few steps are not to become many
    SOLVER = {"path_tolerance": 1e-6, "every": 10}
    DEFAULT_SIZES = (470.0, 270.0)
    SPATIAL = True

    nx: int = number(
        None, COUNT, "rectangles along the length that is modelled: half, unless `full`", "mesh"
    )
    length: float = number(
        None, POSITIVE, "of the whole ply, along x (470, or the mesh's) [mm]", "ply"
    )
    width: float = number(
        None, POSITIVE, "of the whole ply, along y (270, or the mesh's) [mm]", "ply"
    )
    full: bool = switch("model the whole ply, not a quarter", "ply")
    centred: bool = switch(
        "put the centre of an outline at the origin, under the punch",
        "ply",
    )
    bending_modulus: float = number(100.0, FROM_ZERO, "bending modulus of the yarns [MPa]", "ply")
    twist_modulus: float = number(1.0, FROM_ZERO, "twisting modulus of the ply [MPa]", "ply")
    in_plane_bending: float = number(
        0.0,
        FROM_ZERO,
        "stiffness of yarns against bending within the ply, over that out of it",
        "ply",
    )
    stack: str | os.PathLike[str] | Sequence[Ply] | None = text(
        None,
        "TOML file of several plies, from the punch to the die; examples: studies/stacks",
        "FILE",
        "ply",
    )
    stroke: float = number(None, POSITIVE, "travel of the punch (its height) [mm]", "tools")
    dome: DoubleDome | Mapping[str, float] | Sequence[str] = field(
        default=(),
        metadata={
            "repeated": "NAME=VALUE",
            "help": f"dimension of the double dome: {', '.join(DIMENSIONS)}",
            "group": "tools",
        },
    )
    punch: str | Surface | None = text(
        None,
        "punch from a file (STL, VTP, MSH, STEP, IGES) with its flange at z = 0 [mm]",
        "FILE",
        "tools",
    )
    chord: float = number(
        0.1, POSITIVE, "largest distance of triangles from faces of STEP and IGES [mm]", "tools"
    )
    clearance: float = number(
        None, POSITIVE, "distance of punch and die when closed (1.2 thicknesses) [mm]", "tools"
    )
    friction: float = number(0.25, FROM_ZERO, "coefficient between ply and tools", "tools")
    metal_friction: float = number(
        TOOL_METAL_FRICTION,
        FROM_ZERO,
        "coefficient between a stack's metal and tools",
        "tools",
    )
    slip: float = number(0.1, POSITIVE, "how far a sticking ply may slip [mm]", "tools")
    lag: float = number(
        0.01,
        POSITIVE,
        "share of normal forces, and of areas under the holder, that may lag behind the state",
        "tools",
    )
    penalty: float = number(
        None,
        POSITIVE,
        "stiffness of contact with fabric that is rigid (by default it is compacted) [N/mm^3]",
        "tools",
    )
    permitted: float | None = number(
        None,
        POSITIVE,
        "largest penetration of rigid faces, which augmented contact keeps (any) [mm]",
        "tools",
    )
    holder: Holder | Sequence[Holder] = one_of(
        PressureHolder(), holding.HOLDERS, "what holds the rim of the ply", holding.GROUP
    )

    def prepare(self) -> None:
        """Make blank, membrane and tools."""
        self.holders = holding.holders_of(self.holder)
        if self.penalty or self.permitted:
            self.fabric = self.fabric.replace(compaction=None)
        self.plies = self._plies()
        if not self.full:
            self.warnings += [
                f"{words}; take the whole ply (`full`)"
                for words in map(Ply.mirror_warning, self.plies)
                if words
            ]
        elif not self.sheet_file:
            self.nx += self.nx % 2 if self.nx == self.FULL["nx"] else 0
            sides = [getattr(self, k) or usual for k, usual in zip(self.SIZES, self.DEFAULT_SIZES)]
            self.ny = self.ny or 2 * max(1, round(self.nx * sides[1] / sides[0] / 2))
        self.blank = self._blank()
        self._extent = self.blank.extent()
        if not self.full:
            self._check_quarter()
        elif self.sheet_file:
            self._check_centre()
        # of all that lies between the tools, without pressure
        t = self.thickness = sum(ply.thickness_under(0.0) for ply in self.plies)
        surface, depth = self._punch()
        self.stroke = self.stroke or depth
        self.closes = self.stroke > (1 - 1e-9) * depth
        if self.stroke > depth:
            raise InputError(
                f"`stroke` {self.stroke:g} is deeper than the die; allowed is up to {depth:g} mm"
            )
        pressed = sum(ply.thickness_under(PRESSED) for ply in self.plies)
        self.clearance = clearance_of(self.clearance, t, pressed, surface)
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

    def membranes(self) -> list[Membrane]:
        """As in `Scenario`."""
        return stacking.membranes(self.plies) if self.stack else [self.fabric_membrane()]

    def problem(self) -> dict[str, Any]:
        """As in `Scenario`: the plies of a stack."""
        return {"plies": [ply.described() for ply in self.plies]} if self.stack else {}

    def can_be_coarser(self) -> bool:
        """As in `Scenario`: not of plies with meshes of their own."""
        return super().can_be_coarser() and not any(ply.mesh for ply in self.plies)

    def coarser(self) -> Self:
        """As in `Scenario`."""
        plies = [
            dataclasses.replace(ply, nx=halved(ply.nx), size=ply.size and 2 * ply.size)
            for ply in self.plies
        ]
        stack = plies if self.stack else None
        return dataclasses.replace(self, **self.coarser_mesh(), stack=stack)

    def _plies(self) -> list[Ply]:
        """Those of the stack, the lowest first, or the one of the other fields."""
        if self.stack is None:
            return [
                Ply(fabric=self.fabric, fibre_angle=self.fibre_angle, yarn_angle=self.yarn_angle)
            ]
        usual = {each.name: each.default for each in dataclasses.fields(self)}
        if given := [f"`{k}`" for k in PLIES_SAY if getattr(self, k) != usual[k]]:
            raise InputError(
                f"{', '.join(given)} is given beside `stack`; allowed is to say it of each ply"
            )
        plies = read_plies(self.stack) if isinstance(self.stack, (str, os.PathLike)) else self.stack
        other = next((each for each in plies if not isinstance(each, Ply)), None)
        if other is not None:
            raise InputError(
                f"`stack` holds {other!r}; allowed are plies, as `Ply(fibre_angle=45)`"
            )
        plies = [ply.completed(self.fabric, f"ply {k + 1}") for k, ply in enumerate(plies)]
        if self.penalty or self.permitted:
            rigid = [p.fabric and p.fabric.replace(compaction=None) for p in plies]
            plies = [dataclasses.replace(p, fabric=each) for p, each in zip(plies, rigid)]
        return plies

    def _blank(self) -> Blank:
        asked, known = self.element, len(self.warnings)
        blank = self._laid()
        if blank.degree == 1 or asked or not self._has_usual_nx:
            return blank
        # by default quadratic cells are twice as large, so that nodes are as many
        self.nx, self.ny, self.element = halved(self.nx), halved(self.ny), f"P{blank.degree}"
        del self.warnings[known:]
        return self._laid()

    def _laid(self) -> Blank:
        share = 1.0 if self.full else 0.5
        if self.stack is None:
            return self.sheet(share=share, centred=self.centred if self.outline else self.full)
        sizes = [getattr(self, k) or usual for k, usual in zip(self.SIZES, self.DEFAULT_SIZES)]
        options = {
            "ny": self.ny,
            "pattern": self.pattern,
            "element": self.element,
            "centred": self.full,
            "comm": self.comm,
        }

        def made(ply):
            blank, source = ply.blank(sizes, share, self.nx, **options), f"ply {ply.name}"
            warning = mesh_warnings.size_warning(blank, ply.thickness_under(0.0), source)
            self.warnings += filter(None, [*blank.warnings, warning])
            own = ply.mesh or ply.outline
            self.warnings += mesh_warnings.cell_warnings(blank, source) if own else []
            return blank

        return stacking.lay(self.plies, made)

    def _check_quarter(self):
        """Raise InputError for a sheet that planes of symmetry would cut, or that has no edge on
        one of them."""
        sheets = self.blank.sheets if isinstance(self.blank, Stack) else []
        for name, blank in [(f" of {s.name}", s.blank) for s in sheets] or [("", self.blank)]:
            for axis, start, end in zip("xy", *blank.extent()):
                reaches = f"the mesh{name} reaches from {axis} = {rounded(start, 4)} to "
                reaches += f"{rounded(end, 4)} mm"
                if start < -FITS * (end - start):
                    raise InputError(
                        f"{reaches}, beyond the quarter x, y >= 0; allowed is `full`, or a quarter"
                    )
                if start > ON_PLANE:
                    raise InputError(
                        f"{reaches}, but the planes of symmetry of a quarter are x = 0 and y = 0; "
                        "allowed is a mesh with edges on both, or `full`"
                    )

    def _check_centre(self):
        """Warn of a whole sheet that does not lie under the punch."""
        low, high = self._extent[0][:2], self._extent[1][:2]
        middle = (low + high) / 2
        if (abs(middle) > OFF_CENTRE * (high - low)).any():
            self.warnings.append(
                f"{self.sheet_file} has its centre at {coordinates(middle)} mm, and the punch at "
                f"(0, 0){'; `centred` puts it there' if self.outline else ''}"
            )

    def _punch(self):
        """The punch's surface, checked, and its greatest stroke [mm]."""
        if not self.punch:
            dome = self.dome if isinstance(self.dome, DoubleDome) else dome_of(self.dome)
            return dome, dome.depth
        if self.dome:
            raise InputError("`dome` is given beside `punch`; allowed is one of them")
        known = self._extent, self.thickness, self.full, self.comm, self.warnings.append
        surface, found = punch_of(self.punch, self.chord, *known)
        asked = self.stroke or found  # which may be rounded
        rounded = abs(asked - found) < 0.01 * self.thickness
        return surface, asked if rounded and not isinstance(surface, DoubleDome) else found

    def terms(self) -> list[Term]:
        """Bending, contact with the tools, blank holder."""
        terms = [*self._bending(), self._contact(self.die), self._contact(self.punch_tool)]
        between: list[Term] = []
        if isinstance(self.blank, Stack):
            planes = () if self.full else PLANES
            terms += stacking.metals(self.plies, planes)
            given = self.slip, self.lag, planes, self.penalty
            between = stacking.between(self.blank, self.plies, *given)
        terms += [*self._held(between), *between]
        self.pressing = [term for term in terms if isinstance(term, PressingTerm)]
        self.contacts = [term for term in self.pressing if isinstance(term, Contact)]
        return terms

    def _contact(self, tool):
        friction = self._tool_friction()
        return Contact(tool, penalty=self.penalty, permitted=self.permitted, friction=friction)

    def _tool_friction(self):
        """On the tools, of each ply if one is of metal."""
        coefficient: float | dict[str, float] = self.friction
        if any(ply.metal for ply in self.plies):
            metal, fabric = self.metal_friction, self.friction
            coefficient = {ply.name: metal if ply.metal else fabric for ply in self.plies}
        return Coulomb(coefficient, self.slip, self.lag)

    def _bending(self) -> list[Term]:
        if not self.bending_modulus:
            return []
        plies = [ply for ply in self.plies if ply.fabric]
        terms: list[Term] = [
            Bending(
                modulus=self.bending_modulus,
                twist_modulus=self.twist_modulus,
                in_plane=self.in_plane_bending,
                symmetric=() if self.full else PLANES,
            )
            for _ in plies
        ]
        return [term.on(p.name) for term, p in zip(terms, plies)] if self.stack else terms

    def _held(self, between: Sequence[Term]) -> list[Term]:
        """The terms of the blank holder, or of all its segments."""
        stack = isinstance(self.blank, Stack)
        press = Press(
            self.blank,
            self.full,
            self.die,
            self.thickness,
            self._tool_friction(),
            self.lag,
            self.penalty,
            self.permitted,
            "blank holder",
            self.warnings,
            [ply.name for ply in self.plies] if stack else (),
            stacking.rims(self.blank, self.plies) if isinstance(self.blank, Stack) else (),
            stacking.neighbours(between, self.plies) if stack else (),
        )
        names = [press.name, *(f"{press.name} {k}" for k in range(2, len(self.holders) + 1))]
        return [
            term
            for name, holder in zip(names, self.holders)
            for term in holding.terms_of(holder, dataclasses.replace(press, name=name))
        ]

    def supports(self) -> list[Support]:
        """The planes of symmetry of a quarter; of a whole ply the nodes nearest to its centre and
        to the end of its axis, against motion and turning."""
        if not self.full:
            return [
                Support("plane of symmetry x = 0", PLANES[0], (0,)),
                Support("plane of symmetry y = 0", PLANES[1], (1,)),
            ]
        parts = list(self.blank.parts.values()) or [self.blank.whole]
        held = [holding.nearest_nodes(parts, at) for at in ((0.0, 0.0), (self.length / 2, 0.0))]
        return [
            Support("centre", held[0], (0, 1), locates=True),
            Support("end of the axis", held[1], (1,), locates=True),
        ]

    def start(self) -> None:
        """Press the sheets of a stack together as under the holder: where that is not so, they part
        at once, while sheets that do not touch yet resist nothing."""
        holders = [
            term for term in self.pressing if isinstance(term, BlankHolderPressure) and term.now
        ]
        if isinstance(self.blank, Stack) and holders:
            on_die = next(term for term in self.contacts if term.tool is self.die)
            pairs = stacking.neighbours(self.scene.terms, self.plies)
            stiff = any(ply.metal for ply in self.plies)
            stacking.press(self.blank, pairs, on_die, holders, stiff)

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Stroke [mm] and force [N] of the punch, of a quarter if that is modelled."""
        return load * self.stroke, float(reports.tool_force(scene, self.punch_tool)[2])

    def force_name(self) -> str:
        """As in `Scenario`."""
        return "punch force" if self.full else "punch force on a quarter of the ply"

    def modelled(self) -> float:
        """As in `Scenario`."""
        return 1.0 if self.full else 0.25

    def of_whole(self, quantities: Mapping[str, Any]) -> str:
        """What to say behind the punch force of a quarter, "" for a whole ply."""
        whole = quantities["punch_force_of_whole_ply_N"]
        return "" if self.full else f" on the quarter, {rounded(whole, 5)} N on the whole ply"

    def about(self) -> tuple[str, str]:
        """As in `Scenario`: which plies are formed over what."""
        if not (self.punch or self.stack):
            return "", ""
        over, count = "the double dome", len(self.plies)
        if self.punch:
            punch = self.punch
            over = Path(punch).name if isinstance(punch, str) else type(punch).__name__
        plies = f"{count} plies" if count > 1 else "a ply"
        return f"Forming over {over}", f"Forming of {plies} over {over}, between rigid tools."

    def quantities(self, result: Result) -> dict[str, Any]:
        """Forces, penetrations, shear, strains, draw-in and wrinkles; thinning of metal."""
        return measuring.quantities(self, result)

    def punch_mesh(self) -> "pyvista.PolyData":
        """The punch, where it is now, as a PyVista surface [mm]."""
        from ..results import formed

        low, high = self._extent  # known, as rank 0 draws alone
        rise = np.array([0, 0, self.stroke])
        return formed.tool_mesh(self.punch_tool, low - rise, high + 2 * rise)

    def pictures(self, result: Result, folder: Path) -> None:
        """Strain states, the formed plies and paths of this run."""
        measuring.pictures(self, result, folder)

    def compare(self, results: Mapping[str, Result], folder: Path) -> None:
        """Outlines and paths of plies {label: `Result`} side by side, into `folder`."""
        measuring.compare(self, results, folder)
