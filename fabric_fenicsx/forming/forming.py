"""Forming of a woven ply between rigid tools: punch, die and blank holder (Figs 11 to 16 of
Schäfer et al., for a single ply)."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..job.job import Result
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.fields import number, one_of, text
from ..runtime.formatting import coordinates, rounded
from ..runtime.rules import POSITIVE
from ..scene import output as reports
from ..scene.scene import Scene
from ..tools.checks import check_motion
from ..tools.double_dome import DoubleDome
from ..tools.surfaces import Offset, Reversed, Surface
from ..tools.tool import Tool
from . import holding, measuring
from .between_tools import BetweenTools
from .dome import DIMENSIONS, dome_of
from .holding import Holder, PressureHolder
from .punch import PRESSED, clearance_of, punch_of

if TYPE_CHECKING:
    import pyvista

PLIES_SAY = "fibre_angle", "yarn_angle", "weave_angle", "mesh", "outline"  # of each ply of a stack
OFF_CENTRE = 0.05  # of its extent, by which a sheet may lie off the punch without a word
ON_PLANE = 1e-6  # mm off a plane of symmetry up to which nodes lie on it
PLANES = [lambda x: x[0] < ON_PLANE, lambda x: x[1] < ON_PLANE]  # of symmetry of a quarter


@dataclass(kw_only=True)
class Forming(BetweenTools):
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
    DEFAULT_SIZES = (470.0, 270.0)

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
    holder: Holder | Sequence[Holder] = one_of(
        PressureHolder(), holding.HOLDERS, "what holds the rim of the ply", holding.GROUP
    )

    def prepare(self) -> None:
        """Make blank, membrane and tools."""
        self.holders = holding.holders_of(self.holder)
        self.lay_blank()
        if self.full and self.sheet_file:
            self._check_centre()
        t = self.thickness
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
        self.rigid = [self.die, self.punch_tool]
        check_motion(self.rigid, self.flat_nodes(), t, self.comm)

    def _check_centre(self):
        """Warn of a whole sheet that does not lie under the punch."""
        low, high = self.extent[0][:2], self.extent[1][:2]
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
        known = self.extent, self.thickness, self.full, self.comm, self.warnings.append
        surface, found = punch_of(self.punch, self.chord, *known)
        asked = self.stroke or found  # which may be rounded
        rounded = abs(asked - found) < 0.01 * self.thickness
        return surface, asked if rounded and not isinstance(surface, DoubleDome) else found

    def held(self, between: Sequence[Term]) -> list[Term]:
        """As in `BetweenTools`: of the blank holder, or of all its segments."""
        rim = self.rim(self.die, "blank holder", between)
        names = [rim.name, *(f"{rim.name} {k}" for k in range(2, len(self.holders) + 1))]
        return [
            term
            for name, holder in zip(names, self.holders)
            for term in holding.terms_of(holder, dataclasses.replace(rim, name=name))
        ]

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Stroke [mm] and force [N] of the punch, of a quarter if that is modelled."""
        return load * self.stroke, float(reports.tool_force(scene, self.punch_tool)[2])

    def force_name(self) -> str:
        """As in `Scenario`."""
        return "punch force" if self.full else "punch force on a quarter of the ply"

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
        from ..postprocess.tool_surfaces import tool_mesh

        low, high = self.extent  # known, as rank 0 draws alone
        rise = np.array([0, 0, self.stroke])
        return tool_mesh(self.punch_tool, low - rise, high + 2 * rise)

    def pictures(self, result: Result, folder: Path) -> None:
        """Strain states, the formed plies and paths of this run."""
        measuring.pictures(self, result, folder)

    def compare(self, results: Mapping[str, Result], folder: Path) -> None:
        """Outlines and paths of plies {label: `Result`} side by side, into `folder`."""
        measuring.compare(self, results, folder)
