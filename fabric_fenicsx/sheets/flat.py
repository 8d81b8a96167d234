"""Flat sheets as arrays: rectangles and outlines, their place and the directions of their yarns."""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from ..meshes.outline import outline_mesh
from ..meshes.outline_files import read_outline
from ..meshes.rings import centred, mirrored_half, sheet_of
from ..meshes.specimen import specimen
from ..readers.field import Field
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..runtime.rules import FINITE
from .mesh_checks import MeshArrays
from .sheet import Layout, Values

FLAT_TOLERANCE = 1e-6  # of its size, up to which a sheet is flat


class BlankOptions(TypedDict, total=False):
    """Directions, degree and frame of a `Blank`."""

    a: float | Callable[[np.ndarray], np.ndarray]
    b: float | Callable[[np.ndarray], np.ndarray]
    degree: int | None
    frame: np.ndarray


@dataclass(frozen=True, kw_only=True)
class FlatSheet:
    """A sheet in a plane z = const with the fields of a `Layout`, checked before. turned: from x to
    its length [rad]; centred: whether its middle is the origin, or one for each side."""

    nx: int
    ny: int | None
    pattern: str
    element: str | None
    fibre_angle: float | Field
    yarn_angle: float
    turned: float = 0.0
    centred: bool | Sequence[bool] = False

    source = "the specimen"

    @classmethod
    def checked(
        cls,
        shape: Values,
        *,
        turned: float = 0.0,
        centred: bool | Sequence[bool] = False,
        **layout: Any,
    ) -> Self:
        """A sheet of this shape, fields of the subclass. Raises InputError for a `turned` or a
        field of the `Layout` that is not allowed."""
        turned = FINITE.check("`turned`", turned)
        return cls(turned=turned, centred=centred, **shape, **vars(Layout(**layout)))

    def arrays(self) -> MeshArrays:
        """Its mesh, not checked yet."""
        raise NotImplementedError

    @property
    def axes(self) -> np.ndarray:
        """Directions of length and width, as rows (2, 2)."""
        c, s = math.cos(self.turned), math.sin(self.turned)
        return np.array([[c, s], [-s, c]])

    def options(self) -> BlankOptions:
        """Of the `Blank` that lies so."""
        options: BlankOptions = {"a": self._direction(self.turned)}
        options["degree"] = int(self.element[1]) if self.element else None
        if self.turned:
            options["frame"] = self.axes
        if self.yarn_angle != 90:
            options["b"] = self._direction(self.turned + math.radians(self.yarn_angle))
        return options

    def _direction(self, more):
        """Direction of yarns a and `more`, or a function of places (3, n) to it [rad]."""
        angle = self.fibre_angle
        if isinstance(angle, Field):
            return lambda x: np.radians(angle.at(x.T)) + more
        return math.radians(angle) + more

    def _yarns_at(self, place):
        """Angle from the length to yarns a, and from there to yarns b, [rad] at a place (x, y)."""
        angle = self.fibre_angle
        if isinstance(angle, Field):
            angle = float(angle.at(np.array([[*place, 0.0]]))[0])
        return math.radians(angle), math.radians(self.yarn_angle)


@dataclass(frozen=True, kw_only=True)
class Rectangle(FlatSheet):
    """A rectangle of these `sides` [mm], with a corner or its middle at the origin."""

    sides: Sequence[float]

    def arrays(self) -> MeshArrays:
        """Cells along the yarns follow those in the middle."""
        (length, width), centred = self.sides, np.broadcast_to(self.centred, 2)
        ny = self.ny or max(1, round(self.nx * width / length))
        cell = "quadrilateral" if (self.element or "P")[0] == "Q" else "triangle"
        middle = np.array(self.sides) / 2
        yarns = self._yarns_at(np.where(centred, 0.0, middle) @ self.axes)
        points, cells, kind = specimen(length, width, self.nx, ny, self.pattern, cell, *yarns)
        points[:, :2] = (points[:, :2] - middle * centred) @ self.axes
        return MeshArrays(points, cells, kind, [])


@dataclass(frozen=True, kw_only=True)
class Outline(FlatSheet):
    """The inside of an `outline`, as in `Blank.outline`."""

    outline: Path | str | Sequence[ArrayLike]
    size: float | None = None
    layer: str | None = None
    planes: Sequence[int] = ()

    @property
    def source(self) -> str:  # type: ignore[override]
        """What messages call it."""
        is_file = isinstance(self.outline, str | os.PathLike)
        return f"outline {self.outline}" if is_file else "the outline"

    def arrays(self) -> MeshArrays:
        """Triangles, and what was left out of the outline."""
        if (self.element or "P")[0] != "P":
            raise InputError(
                f"`element` is {self.element}; allowed for an outline are triangles (P)"
            )
        notes: list[str] = []
        if isinstance(self.outline, str | os.PathLike):
            sheet, notes = read_outline(self.outline, self.layer)
        else:
            sheet = sheet_of([np.asarray(ring, float) for ring in self.outline], self.source)
        if self.centred:
            sheet = centred(sheet)
        for axis in self.planes:
            sheet = mirrored_half(sheet, axis, self.source)
        low, high = np.reshape(sheet.bounds, (2, 2))
        angle, between = self._yarns_at(sheet.centroid.coords[0])
        yarns = angle + self.turned, angle + self.turned + between
        size = (high - low)[0] / self.nx if self.size is None else self.size
        try:
            points, cells, kind, left_out = outline_mesh(sheet, size, self.pattern, yarns)
        except InputError as error:
            raise InputError("; ".join([str(error), *notes])) from None
        return MeshArrays(points, cells, kind, notes + left_out)


def moved_sheet(
    points: np.ndarray, source: str, centred: bool, height: float | None
) -> tuple[np.ndarray, list[str]]:
    """Points (n, 2 or 3) [mm] of a sheet with the middle of its extent at the origin if it is to be
    `centred`, and at z = `height` unless that is None; with a warning where z changes. Raises
    InputError for a sheet that is not flat and has a `height`."""
    points, warnings = points.copy(), list[str]()
    low, high = points.min(0), points.max(0)
    if centred:
        points[:, :2] -= (low + high)[:2] / 2
    if height is not None and len(low) == 3:
        if high[2] - low[2] > FLAT_TOLERANCE * (high - low).max():
            raise InputError(
                f"{source} reaches from z = {rounded(low[2], 4)} to {rounded(high[2], 4)} mm; "
                "allowed is a flat sheet, in a plane z = const"
            )
        points[:, 2] = height
        if abs(low[2] - height) > FLAT_TOLERANCE * (high - low).max():
            warnings.append(
                f"{source} lies in z = {rounded(low[2], 4)} mm and was put in z = {height:g}, "
                "where the blank of a press is"
            )
    return points, warnings
