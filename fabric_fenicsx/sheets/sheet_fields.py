"""The fields of a sheet: material, mesh and yarns, declared once for all tests."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self

from ..material.laws import Law
from ..meshes.specimen import PATTERNS
from ..runtime.errors import InputError
from ..runtime.fields import KnowsItsFields, choice, number, text
from ..runtime.rules import BELOW_180, COUNT, FINITE, POSITIVE
from .layout import FULL_TURN

ELEMENTS = "P1", "P2", "P3", "Q1", "Q2"


@dataclass(frozen=True, kw_only=True)
class SheetFields(KnowsItsFields):
    """Material, mesh and yarns of a sheet, as data; a subclass adds its sides. Lengths in mm,
    angles in deg. None stands for a default that depends on other fields. Raises InputError for a
    value that is not allowed, and for fields that contradict each other."""

    OF_OUTLINE: ClassVar[str] = "unstructured"  # default of `pattern` for an outline

    fabric: Law | None = field(kw_only=False, default=None)
    mesh: str | None = text(
        None, "sheet from a file, as of gmsh or Abaqus [mm], not a rectangle", "FILE", "mesh"
    )
    outline: str | None = text(
        None, "outline of the sheet with holes: DXF, CSV of x and y [mm], or a mesh", "FILE", "mesh"
    )
    size: float = number(
        None, POSITIVE, "of the cells in an outline (its length over `nx`) [mm]", "mesh"
    )
    layer: str | None = text(
        None, "layer of a DXF outline, or several with commas between them (all)", "NAME", "mesh"
    )
    nx: int = number(None, COUNT, "rectangles along the length", "mesh")
    ny: int = number(None, COUNT, "rectangles across the width (square ones by default)", "mesh")
    pattern: str = choice("crossed", PATTERNS, "how rectangles are divided into cells", "mesh")
    element: str = choice(
        None, ELEMENTS, "triangles (P) or quadrilaterals (Q), and their degree (P2)", "mesh"
    )
    fibre_angle: float = number(0.0, FULL_TURN, "from the length to yarns a [deg]", "mesh")
    yarn_angle: float = number(
        90.0, BELOW_180, "from yarns a to yarns b in the flat sheet [deg]", "weave"
    )
    temperature: float | None = number(
        None, FINITE, "of a fabric that has numbers at temperatures [deg C]", "weave"
    )
    weave_angle: float | None = number(
        None, BELOW_180, "that where the weave is free of shear (the yarn angle) [deg]", "weave"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.outline and self.mesh:
            raise InputError("`outline` is given beside `mesh`; allowed is one of them")
        if self.outline and self.nx and self.size:
            raise InputError("`nx` is given beside `size`; allowed is one of them")
        if not self.outline and (self.size or self.layer):
            raise InputError(f"`{'size' if self.size else 'layer'}` needs `outline`")

    @property
    def sheet_file(self) -> str:
        """The field that names the file of the sheet, and the file; "" for a rectangle."""
        given = next((k for k in ("mesh", "outline") if getattr(self, k)), "")
        return given and f"`{given}` {getattr(self, given)}"

    def with_defaults(self, nx: int, **sides: float) -> Self:
        """The same with `nx` and `sides` [mm] where it has none of its own."""
        usual: dict[str, Any] = {}
        if self.outline and self.pattern in (None, type(self).pattern):
            usual["pattern"] = self.OF_OUTLINE
        if not (self.nx or self.mesh or self.size):
            usual["nx"] = nx
        if not self.sheet_file:
            usual |= {name: side for name, side in sides.items() if getattr(self, name) is None}
        return replace(self, **usual)

    def on_coarser_mesh(self, *sides: str, times: int = 2) -> Self:
        """The same with half the rectangles along each side, or another share, and cells so many
        `times` as large; `sides`: fields that an outline decides."""
        cells: dict[str, Any] = {"size": self.size and times * self.size}
        for name in ("nx", "ny"):
            count = getattr(self, name)
            cells[name] = count and max(1, round(count / times))
        return replace(self, **cells | (dict.fromkeys(sides) if self.outline else {}))
