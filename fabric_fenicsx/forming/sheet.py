"""One sheet of fabric or metal, as it is laid into a press."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from ..material.laws import Law
from ..material.laws.base import Material
from ..material.metal import Metal, load_metal
from ..material.presets import checked_fabric, load
from ..readers.field import Field, of_place
from ..runtime.errors import InputError
from ..runtime.fields import choice, documented, number, switch
from ..runtime.rules import COUNT, FINITE, FROM_ZERO, POSITIVE
from ..sheets.layout import FULL_TURN
from ..sheets.sheet_fields import ELEMENTS, SheetFields
from .interface import BETWEEN_FABRICS, ON_METAL

# field of a ply -> fields of the blank that this ply does not take over
OWN = {
    "mesh": ("outline", "size", "layer", "nx", "ny", "pattern", "length", "width"),
    "outline": ("mesh", "length", "width", "ny"),
    "size": ("nx",),
    "nx": ("size",),
    "metal": ("fabric", "weave_angle"),
}


@documented
@dataclass(frozen=True, kw_only=True)
class Sheet(SheetFields):
    """A sheet of fabric, or of metal: a blank, or one ply of a stack.

    It is a rectangle of `length` and `width`, or has a `mesh` or an `outline`, which is flat, in a
    plane z = const, and lies as in its file unless it is `centred`. A thickness, fibre angle,
    friction and temperature, which is given, as no heat is conducted, may be a `Field` of x and y
    of the flat sheet as it is laid. Stiffnesses in bending are those of `Bending`.

    Parameters
    ----------
    fabric, metal
        What it is made of: one of them.
    name
        In results; by default "ply 1" and so on.

    Raises
    ------
    InputError
        For numbers out of range, and for fields that exclude each other.

    Examples
    --------
    >>> ply = ff.Sheet(fabric=ff.load("komeili"), length=200, width=100, fibre_angle=45)
    >>> ply.fibre_angle, round(ply.thickness_under(0.0), 3)
    (45.0, 1.074)
    """

    OF_OUTLINE: ClassVar[str] = "along"  # see docs/howto/meshes.md

    fabric: Law | None = field(kw_only=False, default=None, metadata={"read": load})
    metal: Metal | None = field(default=None, metadata={"read": load_metal})
    name: str = ""
    nx: int = number(
        None, COUNT, "rectangles along the length that is modelled: half with symmetry x", "mesh"
    )
    element: str = choice(
        None,
        ELEMENTS,
        "triangles (P) or quadrilaterals (Q), and their degree (P1 where cells follow the yarns, "
        "else P2)",
        "mesh",
    )
    integration: str = choice(
        None, ("full", "inner"), "points of P2: full, or inner: nearer to a cell's centre", "mesh"
    )
    length: float | None = number(None, POSITIVE, "of the whole sheet, along x [mm]")
    width: float | None = number(None, POSITIVE, "of the whole sheet, along y [mm]")
    thickness: float | Field | None = number(
        None, of_place(POSITIVE), "in place of the material's [mm]"
    )
    fibre_angle: float | Field = number(  # type: ignore[assignment]
        0.0, of_place(FULL_TURN), "from the length to yarns a [deg]", "mesh"
    )
    centred: bool = switch("put the middle of an outline or mesh at the origin")
    temperature: float | Field | None = number(  # type: ignore[assignment]
        None, of_place(FINITE), "of fabric that has numbers at temperatures [deg C]", "weave"
    )
    bending_modulus: float = number(100.0, FROM_ZERO, "bending modulus of the yarns [MPa]")
    twist_modulus: float = number(1.0, FROM_ZERO, "twisting modulus of the sheet [MPa]")
    in_plane_bending: float = number(
        0.0, FROM_ZERO, "stiffness of yarns against bending within the sheet, over that out of it"
    )
    friction: float | Field | None = number(
        None,
        of_place(FROM_ZERO),
        "coefficient to the next sheet above (Table 2 of Schäfer et al.: 0.334, beside metal 0.25)",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fabric is not None:
            checked_fabric("`fabric`", self.fabric)
        if self.centred and not self.sheet_file:
            raise InputError("`centred` needs `outline` or `mesh`")
        if self.metal and self.fabric:
            raise InputError("`fabric` is not allowed beside `metal`")
        if self.metal and isinstance(self.thickness, Field):
            raise InputError("`thickness` of metal is a field; allowed is a number above 0")
        if self.metal and self.temperature is not None:
            raise InputError("`temperature` is of fabric alone, and not allowed beside `metal`")
        if self.fabric:
            at: Any = self.temperature
            if isinstance(at, Field):
                at = min(self.fabric.at_temperatures, default=0.0)
            self.fabric.at(at)

    @property
    def material(self) -> Material:
        """Its metal or fabric, with the sheet's own thickness if that is a number."""
        material: Any = self.metal or self.fabric
        own = self.thickness and not isinstance(self.thickness, Field)
        return material.replace(thickness=self.thickness) if own else material

    def check_complete(self) -> None:
        """Raise InputError for a sheet that lacks its material or its size."""
        if not (self.metal or self.fabric):
            raise InputError("a sheet needs `fabric` or `metal`")
        if not (self.sheet_file or (self.length and self.width)):
            raise InputError("a sheet needs `length` and `width`, `outline` or `mesh`")

    def ready(self, name: str, rigid: bool) -> Self:
        """The sheet as it is built, with name and material; rigid: fabric keeps its thickness."""
        made: dict[str, Any] = {"metal" if self.metal else "fabric": self.material}
        if self.fabric and rigid:
            made["fabric"] = self.material.replace(compaction=None)
        return dataclasses.replace(self, **made, name=self.name or name)

    def coarser(self, sides: np.ndarray) -> Self | None:
        """The sheet with cells twice as large, or None; sides (2,): of the modelled part [mm]."""
        size = self.size or (sides[0] / self.nx if self.nx else math.inf)
        few = 4 * size > min(sides) * (1 + 1e-9) if self.outline else self.nx in (None, 1)
        return None if few else self.on_coarser_mesh("length", "width")

    def finer(self, times: float) -> Self:
        """The sheet with `times` as many cells along each side; InputError for a mesh's file."""
        if self.mesh:
            raise InputError(
                f"cells of {self.mesh} can't be made finer; allowed is a rectangle or an outline, "
                "which the program meshes"
            )
        more = {n: 2 * math.ceil(times * k / 2) for n in ("nx", "ny") if (k := getattr(self, n))}
        more |= {"size": self.size and self.size / times}
        return dataclasses.replace(
            self, **more | (dict.fromkeys(("length", "width")) if self.outline else {})
        )

    def thickness_under(self, pressure: float, rigid: bool = False) -> float:
        """Thickness under a pressure [MPa], [mm]; rigid: of fabric that keeps its thickness."""
        material = self.material
        if self.fabric and rigid:
            material = material.replace(compaction=None)
        return material.thickness_under(pressure)

    def friction_to(self, upper: "Sheet") -> float | Field:
        """Coefficient of friction with a sheet above it."""
        if self.friction is not None:
            return self.friction
        return ON_METAL if self.metal or upper.metal else BETWEEN_FABRICS

    def mirrored(self, planes: Sequence[int]) -> Self:
        """The sheet, a rectangle, with the cells of its images in the planes of symmetry."""
        counts = {0: "nx", 1: "ny"}
        cells = {counts[k]: 2 * n for k in planes if (n := getattr(self, counts[k]))}
        return dataclasses.replace(self, **cells)

    def mirror_warning(self, modelled: str, planes: Sequence[int], x: np.ndarray) -> str:
        """A warning if the planes of symmetry don't mirror the yarns at places x (n, 3) into yarns
        of the same kind, otherwise "". modelled: what is modelled, a half or a quarter. A file of
        points may know of the modelled part alone, and is believed."""
        angle = self.fibre_angle
        if not self.fabric or (isinstance(angle, Field) and not callable(angle.source)):
            return ""
        where = "yarns by a function"
        if not isinstance(angle, Field):
            where, x = f"yarns at {angle:g} and {angle + self.yarn_angle:g} deg", np.zeros((1, 3))
        one, two, sheared = np.array([[0.01, 0.02], [0.02, 0.01], [0.1, 0.1]])
        energies = self.fabric.derivatives(one, two, sheared, False).parts.sum(1)
        for axis in planes:
            here, image = (self._yarns_at(each) for each in (x, x * (1 - 2 * np.eye(3)[axis])))
            if _is_multiple(here + image, 180):
                continue
            swapped = _is_multiple(here + image[::-1], 180)
            if swapped and math.isclose(*energies):
                continue
            differ = ", as warp and weft differ" if swapped else ""
            return (
                f"{where} are not their own mirror images{differ}, so the {modelled} stands for a "
                "ply of mirrored ones; take the whole ply"
            )
        return ""

    def _yarns_at(self, x):
        """Angles of yarns a and b at places x (n, 3), (2, n) [deg]."""
        angle = self.fibre_angle
        a = angle.at(x) if isinstance(angle, Field) else np.full(len(x), angle)
        return np.stack([a, a + self.yarn_angle])


def _is_multiple(angles, of):
    """Whether all angles are multiples `of` another, to 1e-6 deg."""
    return bool((abs(angles - of * np.round(angles / of)) < 1e-6).all())
