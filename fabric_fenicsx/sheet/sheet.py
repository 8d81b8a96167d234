"""A sheet as data: its cells, yarns and material, declared once for coupons and presses."""

import math
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InputError
from ..core.fields import KnowsItsFields, choice, documented, flag, path, quantity
from ..core.rules import BELOW_180, COUNT, FINITE, FROM_ZERO, POSITIVE, Rule, repr_short
from ..io.field import Field, of_place
from ..material.laws import Law
from ..material.laws.base import Material
from ..material.metal import Metal, load_metal
from ..material.presets import checked_fabric, load
from .specimen import PATTERNS

Values = dict[str, Any]  # values of fields, or quantities, by their names
FULL_TURN = Rule("an angle from -360 to 360 deg", lambda v: abs(v) <= 360)


def axes_of(turned: float) -> np.ndarray:
    """Directions of length and width of a sheet `turned` from x [rad], as rows (2, 2)."""
    c, s = math.cos(turned), math.sin(turned)
    return np.array([[c, s], [-s, c]])


def declared_again(kind: type, name: str, **changes: object) -> Any:
    """A field of the dataclass `kind` for a subclass, with another `default` or `rule`."""
    (base,) = (each for each in fields(kind) if each.name == name)
    default = changes.pop("default", base.default)
    return field(default=default, metadata={**base.metadata, **changes})


@dataclass(frozen=True, kw_only=True)
class Layout(KnowsItsFields):
    """Cells of a sheet and directions of its yarns."""

    nx: int = quantity(None, COUNT, "rectangles along the modelled length", "mesh")
    ny: int | None = quantity(None, COUNT, "rectangles across the width (default: squares)", "mesh")
    pattern: str = choice("crossed", PATTERNS, "how rectangles are divided into cells", "mesh")
    element: str | None = choice(
        None,
        ("P1", "P2", "P3", "Q1", "Q2"),
        "triangles (P) or quadrilaterals (Q), and their degree (P2; P1 where cells of a press "
        "follow the yarns, or yarns bend in the plane of a bias test)",
        "mesh",
    )
    fibre_angle: float | Field = quantity(
        0.0, of_place(FULL_TURN), "from the length to yarns a [deg]", "mesh"
    )
    yarn_angle: float = quantity(90.0, BELOW_180, "from yarns a to b in the flat [deg]", "weave")
    slits: Sequence[ArrayLike] = ()  # lines (n, 2) of the flat sheet as it is laid [mm]

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            lines = [np.array(line, float).reshape(-1, 2) for line in self.slits]
        except (TypeError, ValueError):
            lines = [np.empty((0, 2))]
        if not all(len(x) > 1 and 0 < np.ptp(x, axis=0).max() < np.inf for x in lines):
            flaw = f"`slits` are {repr_short(self.slits)}"
            raise InputError(f"{flaw}; expected lines [[x, y], [x, y], ...] in mm")
        # tuples, so that sheets compare
        vars(self)["slits"] = tuple(tuple(map(tuple, x.tolist())) for x in lines)

    def fibre_angles(self, places: np.ndarray) -> np.ndarray:
        """`fibre_angle` (n,) [deg] at places (n, 3) [mm]."""
        angle = self.fibre_angle
        return angle.at(places) if isinstance(angle, Field) else np.full(len(places), angle)

    def options(self, turned: float = 0.0) -> Values:
        """Directions of yarns, degree, frame and slits of a `Blank` whose length is `turned` from
        x [rad]."""

        def direction(more):
            if isinstance(self.fibre_angle, Field):
                return lambda x: np.radians(self.fibre_angles(x.T)) + more
            return math.radians(self.fibre_angle) + more

        b = None if self.yarn_angle == 90 else direction(turned + math.radians(self.yarn_angle))
        degree, frame = self.element and int(self.element[1]), axes_of(turned) if turned else None
        how = {"a": direction(turned), "b": b, "degree": degree, "frame": frame}
        return how | {"slits": self.slits}

    def filled(self, **values: Any) -> Self:
        """The same with values that the program made, which are not checked again."""
        new = copy(self)
        vars(new).update(values)
        return new


@dataclass(frozen=True, kw_only=True)
class SheetFields(Layout):
    """Material, mesh and yarns of a sheet; a subclass adds its sides. Lengths in mm, angles in deg.
    None stands for a default that depends on other fields or on the mesh: see `defaults` and
    `meshing.mesh_sheet`. Raises InputError for a value that is not allowed, and for fields that
    contradict each other."""

    SIDES: ClassVar[Mapping[str, float | None]]  # fields of length and width, and defaults [mm]
    OF_OUTLINE: ClassVar[str] = "unstructured"  # default of `pattern` for an outline

    fabric: Law | None = field(kw_only=False, default=None, metadata={"read": load})
    mesh: str | None = path(None, "mesh file of the sheet [mm]", "FILE", "mesh")
    outline: str | None = path(
        None, "outline of the sheet with holes: DXF, CSV of x and y [mm], or a mesh", "FILE", "mesh"
    )
    size: float = quantity(None, POSITIVE, "size of cells in an outline (length / nx) [mm]", "mesh")
    layer: str | None = path(None, "layers of a DXF outline, as `A,B` (all)", "NAME", "mesh")
    integration: str = choice(
        None,
        ("full", "inner"),
        "integration points of P2: full, or inner, closer to the cell's centre (default for strips "
        "whose cells do not follow the yarns)",
        "mesh",
    )
    temperature: float | Field | None = quantity(
        None, of_place(FINITE), "of fabric with parameters at temperatures [deg C]", "weave"
    )
    weave_angle: float | None = quantity(
        None, BELOW_180, "yarn angle without shear (that of the flat sheet) [deg]", "weave"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if flaws := self._flaws():
            raise InputError(flaws[0])
        if self.fabric is not None:
            at = self.temperature
            coldest = min(checked_fabric("`fabric`", self.fabric).at_temperatures, default=0.0)
            self.fabric.at(coldest if isinstance(at, Field) else at)

    def _flaws(self):
        """Why fields do not go together, a sentence each."""
        given = {name for name, v in vars(self).items() if not (v is None or v is False or v == "")}
        pairs = "outline mesh", "nx size", "fabric metal", "temperature metal"
        needs = {"size": ["outline"], "layer": ["outline"], "centred": ["outline", "mesh"]}
        return [
            f"`{one}` and `{other}` are both given; use one of them"
            for one, other in map(str.split, pairs)
            if given >= {one, other}
        ] + [
            f"`{name}` needs `{'` or `'.join(files)}`"
            for name, files in needs.items()
            if name in given and given.isdisjoint(files)
        ]

    @property
    def sheet_file(self) -> str:
        """The field that names the file of the sheet, and the file; "" for a rectangle."""
        given = next((k for k in ("mesh", "outline") if getattr(self, k)), "")
        return given and f"`{given}` {getattr(self, given)}"

    def defaults(self, nx: int) -> Values:
        """Values of fields that depend on others, of `nx` where it has no cells of its own."""
        values: Values = {}
        if self.outline and self.pattern in (None, type(self).pattern):
            values["pattern"] = self.OF_OUTLINE
        if not (self.nx or self.mesh or self.size):
            values["nx"] = nx
        sides = {} if self.sheet_file else self.SIDES
        return values | {k: side for k, side in sides.items() if getattr(self, k) is None}

    def points_of_p2(self, cells_follow_yarns: bool) -> str:
        """Default of `integration` on quadratic triangles."""
        return "full"

    def with_larger_cells(self, sides: np.ndarray, times: int = 2) -> Self | None:
        """The same with cells so many `times` as large, None if that is no mesh or not known;
        sides (2,): of the modelled part [mm]."""
        size = self.size or (sides[0] / self.nx if self.nx else math.inf)
        few = 2 * times * size > min(sides) * (1 + 1e-9) if self.outline else self.nx in (None, 1)
        few = few or bool(self.slits and not self.outline)  # edges may not follow them
        return None if few else self._with_cells(1 / times, lambda n: max(1, round(n)))

    def _with_cells(self, share, whole):
        """The same with this share of the rectangles along each side, made `whole` numbers. The
        sides of an outline are its own."""
        cells: Values = {k: whole(share * n) for k in ("nx", "ny") if (n := getattr(self, k))}
        cells |= {"size": self.size and self.size / share}
        return replace(self, **cells | (dict.fromkeys(self.SIDES) if self.outline else {}))


@dataclass(frozen=True, kw_only=True)
class YarnBending(KnowsItsFields):
    """Stiffness of yarns against bending."""

    bending_modulus: float = quantity(100.0, FROM_ZERO, "bending modulus of the yarns [MPa]")
    in_plane_bending: float = quantity(
        0.0, FROM_ZERO, "in-plane bending stiffness of the yarns, relative to the out-of-plane one"
    )
    in_plane_stiffness: float = quantity(
        0.0, FROM_ZERO, "additional in-plane bending stiffness of the yarns [N mm]"
    )

    @property
    def bend_within(self) -> bool:
        """True if yarns resist bending within the sheet."""
        return self.in_plane_bending * self.bending_modulus > 0 or self.in_plane_stiffness > 0


@documented
@dataclass(frozen=True, kw_only=True)
class Sheet(SheetFields, YarnBending):
    """A sheet of fabric, or of metal: a blank, or one ply of a stack.

    It is a rectangle of `length` and `width`, or has a `mesh` or an `outline`, which is flat, in a
    plane z = const, and lies as in its file unless it is `centred`. Thickness, fibre angle,
    friction and prescribed temperature may be a `Field` of x and y of the flat sheet in the press.
    Stiffnesses in bending are those of `Bending`. It is cut along
    `slits`, lines [[x, y], ...] of the flat sheet in the press [mm]: cells of an outline follow
    them, those of a rectangle or a mesh must have edges along them.

    Parameters
    ----------
    fabric, metal
        The material: one of them.
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

    SIDES = {"length": None, "width": None}
    OF_OUTLINE = "along"  # see docs/howto/meshes.md
    # field of a ply -> fields of the blank that this ply does not take over
    REPLACES: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "mesh": ("outline", "size", "layer", "nx", "ny", "pattern", "length", "width"),
        "outline": ("mesh", "length", "width", "ny"),
        "size": ("nx",),
        "nx": ("size",),
        "metal": ("fabric", "weave_angle"),
    }
    # Table 2 of Schäfer et al.: of fabric on fabric, and of metal on fabric
    BETWEEN_FABRICS: ClassVar[float] = 0.334
    ON_METAL: ClassVar[float] = 0.25

    metal: Metal | None = field(default=None, metadata={"read": load_metal})
    name: str = ""
    length: float | None = quantity(None, POSITIVE, "length of the whole sheet, along x [mm]")
    width: float | None = quantity(None, POSITIVE, "width of the whole sheet, along y [mm]")
    thickness: float | Field | None = quantity(
        None, of_place(POSITIVE), "thickness (that of the material) [mm]"
    )
    centred: bool = flag("move the centre of an outline or mesh to the origin")
    twist_modulus: float = quantity(1.0, FROM_ZERO, "twisting modulus of the sheet [MPa]")
    friction: float | Field | None = quantity(
        None,
        of_place(FROM_ZERO),
        "friction coefficient with the next sheet above (0.334, next to metal 0.25)",
    )

    def _flaws(self):
        flaws = super()._flaws()
        if self.metal and isinstance(self.thickness, Field):
            flaws.append("`thickness` of metal is a field; expected a number above 0")
        return flaws

    def material(self, rigid: bool = False) -> Material:
        """Its metal or fabric, with the sheet's own thickness if that is a number; rigid: fabric
        keeps its thickness under pressure."""
        material: Any = self.metal or self.fabric
        if self.thickness and not isinstance(self.thickness, Field):
            material = material.replace(thickness=self.thickness)
        return material.replace(compaction=None) if self.fabric and rigid else material

    def thickness_under(self, pressure: float, rigid: bool = False) -> float:
        """Thickness under a pressure [MPa], [mm]; rigid: as in `material`."""
        return self.material(rigid).thickness_under(pressure)

    def friction_to(self, upper: "Sheet") -> float | Field:
        """Coefficient of friction with a sheet above it."""
        if self.friction is not None:
            return self.friction
        return self.ON_METAL if self.metal or upper.metal else self.BETWEEN_FABRICS

    def finer(self, times: float) -> Self:
        """The sheet with `times` as many cells along each side; InputError for a mesh's file."""
        if self.mesh:
            allowed = "expected a rectangle or an outline that the program meshes"
            raise InputError(f"cells of {self.mesh} cannot be refined; {allowed}")
        return self._with_cells(times, lambda n: 2 * math.ceil(n / 2))

    def mirrored(self, planes: Iterable[int]) -> Self:
        """The sheet, a rectangle, with its images in planes through the origin."""
        slits = [np.array(line) for line in self.slits]
        for axis in planes:
            slits += [line * (1 - 2 * np.eye(2)[axis]) for line in slits]
        names = [("nx", "ny")[axis] for axis in planes]
        cells: Values = {name: 2 * n for name in names if (n := getattr(self, name))}
        return replace(self, **cells, slits=slits)
