"""The plies of a stack: as a scenario is given them, and from a file."""

import dataclasses
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..material.files import read_toml
from ..material.laws import Law
from ..material.laws.base import Material
from ..material.metal import Metal, load_metal
from ..material.presets import checked_fabric, load
from ..runtime.errors import InputError
from ..runtime.fields import check_fields, number
from ..runtime.rules import BELOW_180, COUNT, FINITE, FROM_ZERO, POSITIVE, shown, unknown_key
from ..sheets.blank import Blank
from ..sheets.layout import OF_OUTLINES, Layout, blank_options

# Table 2 of Schäfer et al.: of fabric on fabric, of metal on fabric, of tools on metal
FRICTION, METAL_FRICTION, TOOL_METAL_FRICTION = 0.334, 0.25, 0.1
FILES = "mesh", "outline"  # fields of a ply that name files
MATERIALS = {"fabric": load, "metal": load_metal}  # field of a ply -> how its file is read


@dataclass(kw_only=True)
class Ply:
    """One ply of a stack, of fabric or of metal. A field that is None has the scenario's value.

    metal: in place of the fabric; it has no yarns, so their angles say nothing. name: by default
    "ply 1" and so on; mesh: a file, in place of length, width and nx; outline: a file, in place of
    length and width, layer: of a drawing, centred: put its centre at the origin. Raises InputError
    for numbers out of range, for sizes beside a file, and for fabric and metal in one ply.
    """

    fabric: Law | None = None
    metal: Metal | None = None
    name: str = ""
    fibre_angle: float = number(0.0, FINITE, "of yarns a from the length [deg]")
    yarn_angle: float = number(90.0, BELOW_180, "from yarns a to yarns b [deg]")
    length: float = number(None, POSITIVE, "of the whole ply [mm]")
    width: float = number(None, POSITIVE, "of the whole ply [mm]")
    thickness: float = number(None, POSITIVE, "in place of the material's [mm]")
    nx: int = number(None, COUNT, "rectangles along the length")
    mesh: str | None = None
    outline: str | None = None
    size: float = number(None, POSITIVE, "of the cells in an outline [mm]")
    layer: str | None = None
    centred: bool = False
    friction: float = number(
        None, FROM_ZERO, "coefficient to the next ply (0.334, beside metal 0.25)"
    )

    def __post_init__(self) -> None:
        check_fields(self, lambda name: f"{name} of {self.name or 'a ply'}")
        if self.fabric is not None:
            checked_fabric(f"fabric of {self.name or 'a ply'}", self.fabric)
        self._check_files()
        if self.fabric and self.metal:
            raise InputError(
                f"{self.name or 'a ply'} is given fabric and metal; allowed is one of them"
            )

    def _check_files(self):
        """Raise InputError for what a mesh or an outline has of its own, and for what only an
        outline has."""
        name = self.name or "a ply"
        own = {"mesh": ("length", "width", "nx", "outline"), "outline": ("length", "width")}
        own |= {"size": ("nx",)}
        for key, others in own.items():
            given = [other for other in others if getattr(self, other) is not None]
            if getattr(self, key) and given:
                raise InputError(
                    f"{', '.join(given)} of {name} is given beside {key}, which has its own; "
                    "allowed is one of them"
                )
        idle = next((key for key in OF_OUTLINES if getattr(self, key)), "")
        if idle and not self.outline:
            raise InputError(f"{idle} of {name} is given without outline; allowed is it with one")

    def completed(self, fabric: Law, name: str) -> Self:
        """The ply with this name, and unless it is of metal this fabric, where it has none; its
        thickness is then the material's."""
        material = self.metal or self.fabric or fabric
        if self.thickness:
            material = material.replace(thickness=self.thickness)
        made_of: dict[str, Any] = {"metal" if self.metal else "fabric": material}
        return dataclasses.replace(self, **made_of, name=self.name or name)

    def described(self) -> dict[str, Any]:
        """The ply in what JSON can hold, its material as a file's text."""
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        return given | {key: given[key] and given[key].dumps() for key in MATERIALS}

    @property
    def material(self) -> Material | None:
        """Its metal or fabric, None before it has one."""
        return self.metal or self.fabric

    def thickness_under(self, pressure: float) -> float:
        """Thickness between faces that press it [MPa], 0 before it has a material [mm]."""
        return self.material.thickness_under(pressure) if self.material else 0.0

    def friction_to(self, upper: "Ply") -> float:
        """Coefficient to a ply above it."""
        if self.friction is not None:
            return self.friction
        return METAL_FRICTION if self.metal or upper.metal else FRICTION

    def blank(self, sizes: Sequence[float], share: float, nx: int, **options: Any) -> Blank:
        """Its `Blank` in space. sizes: length and width of a whole ply that has none of its own
        [mm]; share: of length and width that is modelled; options: as in `Blank.rectangle`."""
        layout: Layout = {
            "element": options["element"],
            "fibre_angle": self.fibre_angle,
            "yarn_angle": self.yarn_angle,
            "centred": self.centred if self.outline else options["centred"],
        }
        if self.mesh:
            mine = blank_options(layout)
            return Blank.read(self.mesh, spatial=True, comm=options["comm"], **mine)
        if self.outline:
            return Blank.outline(
                self.outline,
                nx=self.nx or nx or 1,
                size=self.size,
                pattern="along" if options["pattern"] == "along" else "unstructured",
                layer=self.layer,
                spatial=True,
                comm=options["comm"],
                **layout,
            )
        return Blank.rectangle(
            share * (self.length or sizes[0]),
            share * (self.width or sizes[1]),
            nx=self.nx or nx,
            fibre_angle=self.fibre_angle,
            yarn_angle=self.yarn_angle,
            spatial=True,
            **options,
        )

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
            "stands for a ply of four mirrored ones"
        )


def _is_multiple(angle, of):
    """Whether an angle is one of those, to 1e-6 deg."""
    return abs(math.remainder(angle, of)) < 1e-6


def read_plies(path: str | os.PathLike[str]) -> list[Ply]:
    """The plies of a TOML file, from the punch to the die; examples are in studies/stacks.

    Above them stands `unit = "mm"`, which all lengths are in. Each ply is a table `[[ply]]` with
    the fields of `Ply`. `fabric` or `metal` is a preset or a material file, `mesh` and `outline`
    are files; they may lie beside the stack's. Raises InputError that names file, ply and field.
    """
    if not os.path.isfile(path):
        raise InputError(
            f"stack file {shown(path)} does not exist or is not a file; allowed is a TOML file "
            "with a table [[ply]] for each ply"
        )
    folder = Path(path).parent
    return read_toml(path, lambda document: plies_of(document, folder))


def plies_of(document: Mapping[str, Any], folder: Path) -> list[Ply]:
    """The plies of a stack file's `document`, whose other files may lie in the `folder`."""
    for key in document:
        if key not in ("ply", "unit"):
            raise unknown_key(key, ("ply", "unit"), f"key {shown(key)}")
    if document.get("unit") != "mm":
        found = shown(document["unit"]) if "unit" in document else "missing"
        raise InputError(f'unit is {found}; allowed is a line `unit = "mm"`, as all lengths are')
    tables = document.get("ply")
    if not isinstance(tables, list) or not tables or not all(isinstance(t, dict) for t in tables):
        raise InputError("there is no ply; allowed is a table [[ply]] for each")
    plies = [_ply(table, f"ply {k + 1}", folder) for k, table in enumerate(tables)]
    names = [ply.name for ply in plies]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(
                f"name of ply {k + 1} is {shown(name)}, as of ply {names.index(name) + 1}; allowed "
                "are different names"
            )
    return plies


def _ply(table, name, folder):
    known = [each.name for each in fields(Ply)]
    for key in table:
        if key not in known:
            raise unknown_key(key, known, f"key {shown(key)} of {name}")
    given = {"name": name} | table
    if not isinstance(given["name"], str) or not given["name"].strip():
        raise InputError(f"name of {name} is {shown(given['name'])}; allowed is a word")
    for key in (*MATERIALS, *FILES, "layer"):
        if key in given and not isinstance(given[key], str):
            raise InputError(f"{key} of {name} is {shown(given[key])}; allowed is a name or a file")
        beside = folder / given.get(key, "")
        if key in given and beside.is_file():
            given[key] = str(beside)
    for key in FILES:
        if key in given and not os.path.isfile(given[key]):
            raise InputError(
                f"{key} of {name} is {shown(given[key])}, no file; allowed is one beside the "
                "stack's"
            )
    if not isinstance(given.get("centred", False), bool):
        raise InputError(
            f"centred of {name} is {shown(given['centred'])}; allowed is true or false"
        )
    for key, read in MATERIALS.items():
        try:
            given |= {key: read(given[key])} if key in given else {}
        except InputError as error:
            raise InputError(f"{key} of {name}: {error}") from None
    return Ply(**given)
