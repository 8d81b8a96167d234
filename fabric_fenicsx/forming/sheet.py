"""One sheet of fabric or metal, as it is laid into a press."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ..material.laws import Law
from ..material.laws.base import Material
from ..material.metal import Metal, load_metal
from ..material.presets import checked_fabric, load
from ..meshes.specimen import PATTERNS
from ..runtime.errors import InputError
from ..runtime.fields import check_fields, choice, number, switch, text
from ..runtime.rules import BELOW_180, COUNT, FROM_ZERO, POSITIVE
from ..sheets.layout import FULL_TURN
from .interface import BETWEEN_FABRICS, ON_METAL, Interface

ELEMENTS = "P1", "P2", "P3", "Q1", "Q2"
# field -> those for which it leaves no room
INSTEAD_OF = {
    "mesh": ("outline", "size", "nx", "ny", "pattern", "length", "width"),
    "outline": ("length", "width", "ny"),
    "size": ("nx",),
    "metal": ("fabric", "weave_angle"),
}
NEEDS_OUTLINE = "size", "layer", "centred"


def material(read: Any) -> Any:
    """A field: a material, in a file its preset or its own file."""
    return dataclasses.field(default=None, metadata={"read": read})


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A sheet of fabric, or of metal: a blank, or one ply of a stack.

    Parameters
    ----------
    fabric, metal
        What it is made of: one of them.
    name
        In results; by default "ply 1" and so on.
    length, width
        Of the whole sheet along x and y [mm]; or `mesh`, a file of the sheet; or `outline`, a file
        of its edges (DXF, CSV, mesh), with the `size` of its cells [mm], its `layer` in a drawing,
        and whether it is `centred`.
    thickness
        In place of the material's [mm].
    nx, ny, pattern, element, integration
        Its mesh: rectangles along what is modelled of length and width, how they become cells.
    fibre_angle, yarn_angle, weave_angle
        From x to yarns a, from there to yarns b, and that where the weave is free of shear [deg].
    bending_modulus, twist_modulus, in_plane_bending
        See `Bending`.
    friction
        Coefficient to the next sheet above; by default 0.334, beside metal 0.25 (Table 2 of
        Schäfer et al.).

    Raises
    ------
    InputError
        For numbers out of range, and for fields that exclude each other.

    Examples
    --------
    >>> ply = ff.Sheet(fabric=ff.load("komeili"), length=200, width=100, fibre_angle=45)
    >>> ply == dataclasses.replace(ply), ply.thickness_under(0.0) > 1.0
    (True, True)
    """

    fabric: Law | None = material(load)
    metal: Metal | None = material(load_metal)
    name: str = ""
    mesh: str | None = text(
        None,
        "sheet from a file, as of gmsh or Abaqus [mm], in place of a rectangle",
        "FILE",
        "mesh",
    )
    outline: str | None = text(
        None,
        "outline of the sheet with its holes, from a file: DXF, CSV of x and y [mm], or a mesh",
        "FILE",
        "mesh",
    )
    size: float | None = number(
        None, POSITIVE, "of the cells in an outline (its length over `nx`) [mm]", "mesh"
    )
    layer: str | None = text(
        None, "layer of a DXF outline, or several with commas between them (all)", "NAME", "mesh"
    )
    nx: int | None = number(
        None, COUNT, "rectangles along the length that is modelled, in a quarter half", "mesh"
    )
    ny: int | None = number(
        None, COUNT, "rectangles across the width (by default they are square)", "mesh"
    )
    pattern: str | None = choice(
        None,
        PATTERNS,
        "how rectangles are divided into cells (crossed; in an outline unstructured)",
        "mesh",
    )
    element: str | None = choice(
        None,
        ELEMENTS,
        "triangles (P) or quadrilaterals (Q), and their degree (P1 where cells follow the yarns, "
        "else P2)",
        "mesh",
    )
    integration: str | None = choice(
        None, ("full", "inner"), "points of P2: full, or inner: nearer to a cell's centre", "mesh"
    )
    fibre_angle: float = number(0.0, FULL_TURN, "from the length to yarns a [deg]", "mesh")
    yarn_angle: float = number(
        90.0, BELOW_180, "from yarns a to yarns b in the flat sheet [deg]", "weave"
    )
    weave_angle: float | None = number(
        None,
        BELOW_180,
        "from yarns a to yarns b where the weave is free of shear (the yarn angle) [deg]",
        "weave",
    )
    length: float | None = number(None, POSITIVE, "of the whole sheet, along x [mm]", "sheet")
    width: float | None = number(None, POSITIVE, "of the whole sheet, along y [mm]", "sheet")
    thickness: float | None = number(None, POSITIVE, "in place of the material's [mm]", "ply")
    centred: bool = switch("put the centre of an outline at the origin", "sheet")
    bending_modulus: float = number(100.0, FROM_ZERO, "bending modulus of the yarns [MPa]", "sheet")
    twist_modulus: float = number(1.0, FROM_ZERO, "twisting modulus of the sheet [MPa]", "sheet")
    in_plane_bending: float = number(
        0.0,
        FROM_ZERO,
        "stiffness of yarns against bending within the sheet, over that out of it",
        "sheet",
    )
    friction: float | None = number(
        None, FROM_ZERO, "coefficient to the next sheet (0.334, beside metal 0.25)", "ply"
    )

    def __post_init__(self) -> None:
        check_fields(self)
        if self.fabric is not None:
            checked_fabric("`fabric`", self.fabric)
        for key, others in INSTEAD_OF.items():
            for other in others if getattr(self, key) is not None else ():
                if getattr(self, other) is not None:
                    raise InputError(f"`{other}` is not allowed beside `{key}`")
        for key in NEEDS_OUTLINE:
            if getattr(self, key) and not self.outline:
                raise InputError(f"`{key}` needs `outline`")

    @property
    def file(self) -> str:
        """The field that names the file of the sheet, and the file; "" for a rectangle."""
        given = next((k for k in ("mesh", "outline") if getattr(self, k)), "")
        return given and f"`{given}` {getattr(self, given)}"

    @property
    def material(self) -> Material:
        """Its metal or fabric, with the sheet's own thickness if it has one."""
        made_of: Any = self.metal or self.fabric
        return made_of.replace(thickness=self.thickness) if self.thickness else made_of

    def ready(self, name: str, interface: Interface) -> Self:
        """The sheet with a name and its final material, as it is built; InputError without any
        material or size."""
        if not (self.metal or self.fabric):
            raise InputError("`fabric` or `metal` is missing; allowed is one of them")
        if not (self.file or (self.length and self.width)):
            raise InputError("a sheet needs `length` and `width`, `outline` or `mesh`")
        made: dict[str, Any] = {"metal" if self.metal else "fabric": self.material}
        if self.fabric and interface.is_rigid:
            made["fabric"] = self.material.replace(compaction=None)
        return dataclasses.replace(self, **made, name=self.name or name)

    def coarser(self, sides: np.ndarray) -> Self | None:
        """The sheet with cells twice as large, None if that is not known; sides (2,): of what is
        modelled [mm]."""
        size = self.size or (sides[0] / self.nx if self.nx else math.inf)
        few = 4 * size > min(sides) * (1 + 1e-9) if self.outline else self.nx == 1
        if few or not (self.nx or self.size):
            return None
        larger = {"nx": self.nx and halved(self.nx), "ny": self.ny and halved(self.ny)}
        return dataclasses.replace(self, **larger, size=self.size and 2 * self.size)

    def thickness_under(self, pressure: float) -> float:
        """Thickness between faces that press it [MPa], [mm]."""
        return self.material.thickness_under(pressure)

    def friction_to(self, upper: "Sheet") -> float:
        """Coefficient to a sheet above it."""
        if self.friction is not None:
            return self.friction
        return ON_METAL if self.metal or upper.metal else BETWEEN_FABRICS

    def mirror_warning(self) -> str:
        """A warning if planes along the axes don't mirror the yarns into yarns of the same kind,
        otherwise ""."""
        if not self.fabric:
            return ""
        a, b = self.fibre_angle, self.fibre_angle + self.yarn_angle
        along = _is_multiple(a, 90) and _is_multiple(b, 90)
        one, two, sheared = np.array([[0.01, 0.02], [0.02, 0.01], [0.1, 0.1]])
        energies = self.fabric.derivatives(one, two, sheared, False).parts.sum(1)
        if along or (_is_multiple(a + b, 180) and math.isclose(*energies)):
            return ""
        differ = ", as warp and weft differ" if _is_multiple(a + b, 180) else ""
        return (
            f"yarns at {a:g} and {b:g} deg are not their own mirror images{differ}, so the quarter "
            "stands for a ply of four mirrored ones; take the whole ply"
        )


def halved(count: int) -> int:
    """Half of a number of rectangles, at least 1."""
    return max(1, round(count / 2))


def _is_multiple(angle, of):
    """Whether an angle is one of those, to 1e-6 deg."""
    return abs(math.remainder(angle, of)) < 1e-6
