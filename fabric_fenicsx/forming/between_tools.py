"""Plies between rigid tools: their blank, what bends and touches them, what holds them."""

import dataclasses
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from ..coupons.scenario import FITS, Scenario, halved
from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.holder_pressure import BlankHolderPressure
from ..mechanics.contact.interaction import ToolInteraction
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.shell import mesh_warnings
from ..mechanics.shell.bending import Bending
from ..mechanics.shell.membrane import Membrane
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.fields import number, switch, text
from ..runtime.formatting import rounded
from ..runtime.rules import COUNT, FROM_ZERO, POSITIVE
from ..scene.supports import Support
from ..sheets.blank import Blank
from ..sheets.stack import Stack
from ..tools.tool import Tool
from . import holding, stacking
from .holding import Rim
from .plies import TOOL_METAL_FRICTION, Ply, read_plies

PLIES_SAY = "fibre_angle", "yarn_angle", "weave_angle", "mesh", "outline"  # of each ply of a stack
ON_PLANE = 1e-6  # mm off a plane of symmetry up to which nodes lie on it
PLANES = [lambda x: x[0] < ON_PLANE, lambda x: x[1] < ON_PLANE]  # of symmetry of a quarter


@dataclass(kw_only=True)
class BetweenTools(Scenario):
    """A ply of `fabric`, or a stack, that rigid tools form; a quarter of it unless `full`.

    A subclass makes the tools that touch it (`rigid`), among them the `die` on which holders press
    it, and the terms that hold its rim (`held`).
    """

    SOLVER = {"path_tolerance": 1e-6, "every": 10}
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
    centred: bool = switch("put the centre of an outline at the origin, under the punch", "ply")
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
    friction: float = number(0.25, FROM_ZERO, "coefficient between ply and tools", "tools")
    metal_friction: float = number(
        TOOL_METAL_FRICTION, FROM_ZERO, "coefficient between a stack's metal and tools", "tools"
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

    rigid: Sequence[Tool] = field(init=False, default=(), repr=False)
    die: Tool = field(init=False, repr=False, compare=False)

    def lay_blank(self) -> None:
        """Make `plies`, `blank`, its `extent` and the `thickness` of all of it without pressure."""
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
        self.extent = self.blank.extent()
        if not self.full:
            self._check_quarter()
        self.thickness = sum(ply.thickness_under(0.0) for ply in self.plies)

    def flat_nodes(self) -> np.ndarray:
        """This rank's nodes (n, 3) [mm] as if all sheets lay in the blank's middle."""
        owned = self.blank.V.dofmap.index_map.size_local
        return self.blank.coordinates()[:owned] * (1, 1, 0 if self.stack else 1)

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

    def terms(self) -> list[Term]:
        """Bending, contact with the tools, what holds the rim, contact between the plies."""
        terms = [*self._bending(), *map(self.contact, self.rigid)]
        between: list[Term] = []
        if isinstance(self.blank, Stack):
            planes = () if self.full else PLANES
            terms += stacking.metals(self.plies, planes)
            given = self.slip, self.lag, planes, self.penalty
            between = stacking.between(self.blank, self.plies, *given)
        terms += [*self.held(between), *between]
        self.pressing = [term for term in terms if isinstance(term, ToolInteraction)]
        self.contacts = [term for term in self.pressing if isinstance(term, Contact)]
        return terms

    def held(self, between: Sequence[Term]) -> list[Term]:
        """The terms that hold the rim; between: contacts of the plies."""
        raise NotImplementedError

    def rim(self, die: Tool, name: str, between: Sequence[Term], up: float = 1.0) -> Rim:
        """What a holder is told that presses the blank on a `die`; name: of its tool, between:
        contacts of the plies, up: 1 for a die above the blank, -1 below."""
        stack = self.blank if isinstance(self.blank, Stack) else None
        return Rim(
            self.blank,
            self.full,
            die,
            self.thickness,
            self.tool_friction(),
            self.lag,
            self.penalty,
            self.permitted,
            name,
            self.warnings,
            [ply.name for ply in self.plies] if stack else (),
            stacking.rims(stack, self.plies) if stack else (),
            stacking.neighbours(between, self.plies) if stack else (),
            up * holding.UP,
        )

    def contact(self, tool: Tool) -> Contact:
        """Contact of all plies with a tool."""
        friction = self.tool_friction()
        return Contact(tool, penalty=self.penalty, permitted=self.permitted, friction=friction)

    def tool_friction(self) -> Coulomb:
        """On tools, of each ply if one is of metal."""
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

    def modelled(self) -> float:
        """As in `Scenario`."""
        return 1.0 if self.full else 0.25
