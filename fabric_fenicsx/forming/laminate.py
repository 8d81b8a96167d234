"""Forming of the paper's fibre-metal laminate: three plies between two sheets of metal (Figs 11 to
16 of Schäfer et al.)."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..job.job import Result
from ..material.metal import load_metal
from ..runtime.fields import number, text
from ..runtime.rules import POSITIVE, SHARE
from ..solve.limits import Limits
from ..tools.double_dome import DoubleDome
from .dome import dome_of
from .forming import Forming
from .plies import Ply

AREA = 13568 / 20268  # of metal over fabric, from the numbers of elements that the paper gives
MIDDLE, METAL = "middle", "upper metal"  # names of the plies that pictures show
FABRICS = "lower", MIDDLE, "upper"
# In the dome's own fillet, of 15 mm, the laminate of 5 mm would have a die of 2.7 mm radius. Here
# that is 22.8 mm, which cells of 15 mm follow.
DOME = {"entry_radius": 45.0, "wall_angle": 20.0}


@dataclass(kw_only=True)
class Laminate(Forming):
    """Three plies of `fabric`, at 0/90, between two smaller sheets of metal; else as `Forming`, but
    with a gentler dome (entry_radius 45 mm, wall_angle 20 deg, unless `dome` says others)."""

    NAME: ClassVar[str] = "laminate"
    # the metal reaches 60 mm onto the flange along x, where 40 mm of it are drawn in: an edge that
    # slips into the die is bent back by the punch's flange, and jams
    DEFAULT_SIZES = (760.0, 460.0)
    FULL = {"nx": 24, "steps": 40, "balance": 0.02}
    QUICK = {"nx": 5, "steps": 2, "balance": None, "stroke": 2}
    LIMITS = Limits(shortening=1.0)  # yarns between sheets of metal are shortened, and can't fold

    metal: str = text("dc04", "of the outer sheets: preset or material file", "FILE", "laminate")
    metal_thickness: float = number(
        None, POSITIVE, "of each sheet, in place of the metal's [mm]", "laminate"
    )
    metal_area: float = number(AREA, SHARE, "of a sheet of metal, of a ply's", "laminate")

    def prepare(self) -> None:
        """Make the plies, unless they are given as `stack`; the rest as `Forming` does."""
        if not (self.punch or isinstance(self.dome, DoubleDome)):
            self.dome = dome_of(self.dome, **DOME)
        if self.stack is None:
            self.stack = self._laminate()
        super().prepare()

    def _laminate(self):
        share = self.metal_area**0.5
        sides = [getattr(self, k) or usual for k, usual in zip(self.SIZES, self.DEFAULT_SIZES)]
        sheet = {
            "metal": load_metal(self.metal),
            "thickness": self.metal_thickness,
            "length": share * sides[0],
            "width": share * sides[1],
            # cells as large as the plies'
            "nx": max(1, round(share * (self.nx or self.FULL["nx"]))),
        }
        plies = [Ply(name=name) for name in FABRICS]
        return [Ply(name="lower metal", **sheet), *plies, Ply(name=METAL, **sheet)]

    def about(self) -> tuple[str, str]:
        """As in `Scenario`."""
        return super().about() if self.punch else ("", "")

    def quantities(self, result: Result) -> dict[str, Any]:
        """As of `Forming`, with the pressure between the sheets and, of the middle ply, the largest
        shear angle on the path at 45 deg and its contrast."""
        from ..results import quantities

        found = super().quantities(result) | quantities.pressure_quantities(result)
        if MIDDLE in self.blank.parts:
            found["plies"][MIDDLE] |= quantities.middle_quantities(result, MIDDLE)
        return found

    def pictures(self, result: Result, folder: Path) -> None:
        """As of `Forming`, and the middle ply with the metal's contour."""
        super().pictures(result, folder)
        self.compare({"": result}, folder)

    def compare(self, results: Mapping[str, Result], folder: Path) -> None:
        """The middle plies {label: `Result`} side by side, into `folder`."""
        from ..plot.forming_pictures import draw_laminate

        grids = {label: result.grids for label, result in results.items()}
        if all({MIDDLE, METAL} <= set(each) for each in grids.values()):
            draw_laminate(folder, grids, MIDDLE, METAL, self.punch_tool)
