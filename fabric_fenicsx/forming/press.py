"""A press as data: sheets, tools, holders and stages; no mesh, no MPI."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from ..runtime.errors import InputError
from ..runtime.fields import KnowsItsFields
from ..runtime.rules import shown, unknown_key
from ..sheets.sheet import Sheet
from ..solve.limits import Limits
from . import schema
from .holders import Holder, PressureHolder, holders_of
from .interface import Interface
from .stages import Schedule, Stage
from .tools import DieOf, PressTool

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..job.job import Job
    from ..material.laws import Law
    from .forming_scene import FormingScene

SYMMETRIES = "none", "x", "y", "xy"
EXAMPLES = Path(__file__).parents[1] / "studies" / "presses"


@dataclass(frozen=True, kw_only=True)
class Press(KnowsItsFields):
    """A blank, one sheet or several, formed by rigid tools in stages.

    The flat blank lies in z = 0; tools and sheets may lie anywhere along x and y.

    Parameters
    ----------
    sheets
        The lowest first; one alone needs no list.
    symmetry
        "x": x = 0 is a plane of symmetry, and x >= 0 is modelled; "y" likewise, "xy" for both: a
        quarter. "none" for the whole blank.
    interface
        How sheets and tools touch.
    tools
        {name: `PressTool`}.
    holders
        {name: holder}, as `PressureHolder(0.1)`, or a list of holders as segments. A holder presses
        the blank on the tool that its `against` names, by default on the tool that does not move
        and has a flat face on the blank.
    stages
        One after the other.
    limits
        Beyond which a result is invalid.
    stop_when_invalid
        True: the run ends at the step where the ply can't be formed, see `Settings`.
    title
        Of the report.

    Raises
    ------
    InputError
        For parts that do not fit together; when built, for tools that can't stand or move as given.

    Examples
    --------
    >>> press = ff.Press.read("hemisphere", ["blank.nx=4"])
    >>> press.sheets[0].nx, press.tools["punch"].surface.radius
    (4, 50.0)
    >>> press == press.replace(symmetry="xy")
    True
    """

    NAME: ClassVar[str] = "form"
    HEADLINES: ClassVar[tuple[str, ...]] = (
        *("shear_angle_max_deg", "shear_angle_99_percent_deg"),
        *("draw_in.largest_mm", "shortening_mean"),
    )
    FULL: ClassVar[Mapping[str, Any]] = {"balance": 0.02}
    QUICK: ClassVar[Mapping[str, Any]] = {"balance": None}
    SOLVER: ClassVar[Mapping[str, Any]] = {"path_tolerance": 1e-5, "every": 5}
    CHEAP_FROM: ClassVar[int] = 0  # errors are estimated when asked for

    sheets: Sequence[Sheet]
    symmetry: str = "none"
    interface: Interface = Interface()
    tools: Mapping[str, PressTool] = field(default_factory=dict)
    holders: Mapping[str, Holder | Sequence[Holder]] = field(default_factory=dict)
    stages: Sequence[Stage] = ()
    limits: Limits = Limits()
    stop_when_invalid: bool = False
    title: str = ""

    def __post_init__(self) -> None:
        if self.symmetry not in SYMMETRIES:
            raise InputError(
                f"blank.symmetry is {shown(self.symmetry)}; allowed are {', '.join(SYMMETRIES)}"
            )
        alone: Any = self.sheets
        given: list[Sheet] = [alone] if isinstance(alone, Sheet) else list(alone)
        if not given:
            raise InputError("`sheets` is empty; allowed are one or more")
        if other := [each for each in given if not isinstance(each, Sheet)]:
            raise InputError(f"`sheets` holds {other[0]!r}; allowed are sheets, as `Sheet(...)`")
        object.__setattr__(self, "sheets", tuple(given))
        if not self.tools:
            raise InputError("`tools` is empty; allowed are one or more")
        for name, tool in self.tools.items():
            if not isinstance(tool, PressTool):
                raise InputError(f"tools.{name} is {shown(tool)}; allowed is a `PressTool(...)`")
        alone = self.stages
        stages: tuple[Stage, ...] = (alone,) if isinstance(alone, Stage) else tuple(alone)
        for stage in stages:
            if not isinstance(stage, Stage):
                raise InputError(f"`stages` holds {shown(stage)}; allowed are `Stage(...)`")
        object.__setattr__(self, "stages", stages)
        for name, holder in self.holders.items():
            holders_of(name, holder)
        if len({tool.side for tool in self.tools.values()}) == 1 and not self.holders:
            raise InputError(
                f"all tools stand {tool.side} the blank, and nothing resists them; allowed is a "
                "tool on the other side, or a holder, as springs at the edges"
            )
        for name, tool in self.tools.items():
            if isinstance(tool.surface, DieOf):
                self._check_die(name, tool)
        self.schedule(dict.fromkeys(self.dies().values(), 0.0), 0.0)

    @property
    def planes(self) -> tuple[int, ...]:
        """Axes to which the planes of symmetry are perpendicular: 0 for x, 1 for y."""
        return tuple(axis for axis in (0, 1) if "xy"[axis] in self.symmetry)

    @property
    def share(self) -> float:
        """Share of the whole blank that is modelled."""
        return 0.5 ** len(self.planes)

    @property
    def modelled(self) -> str:
        """Name of what is modelled of the blank."""
        return ("whole", "half", "quarter")[len(self.planes)]

    def paths(self) -> list[str]:
        """The path of each sheet's table in a file."""
        names = [sheet.name.removeprefix("ply ") for sheet in self.sheets]
        return [f"ply.{name or k}" for k, name in enumerate(names, 1)] if names[1:] else ["blank"]

    def _check_die(self, name, tool):
        of = tool.surface.tool
        if of not in self.tools or isinstance(self.tools[of].surface, DieOf):
            others = [n for n, t in self.tools.items() if not isinstance(t.surface, DieOf)]
            raise unknown_key(of, others, f"tools.{name}.die_of {of}")
        if self.tools[of].side == tool.side:
            raise InputError(
                f"tools.{name}.side is {tool.side}, the side of {of}, whose die it is; allowed is "
                "the other side"
            )

    @classmethod
    def read(cls, path: str | os.PathLike[str], changes: Sequence[str] = ()) -> Self:
        """The press in a TOML file, or the example of that name in studies/presses.

        changes: of its entries, as "tools.punch.radius=40", or of all plies, as "nx=8". Raises
        InputError that names file, table and key.
        """
        example = EXAMPLES / f"{path}.toml"
        file = example if not os.path.isfile(path) and example.is_file() else Path(path)
        document = {"title": file.stem.replace("_", " ")}
        document |= schema.read_document(file, changes)
        try:
            return cls(**schema.fields_of(document, file.parent))
        except InputError as error:
            raise InputError(f"{file}: {error}") from None

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a file that `read` reads; materials that are no presets go into files beside it.
        Raises InputError for what a file cannot hold, as functions and surfaces of your own."""
        schema.write(self, path)

    def replace(self, **changes: Any) -> Self:
        """The press with other fields."""
        return dataclasses.replace(self, **changes)

    def with_fabrics(self, change: Callable[[Law], Law]) -> Self:
        """The press with `change` made in the fabric of each sheet."""
        made = [dataclasses.replace(s, fabric=s.fabric and change(s.fabric)) for s in self.sheets]
        return self.replace(sheets=made)

    @property
    def fabric(self) -> Any:
        """The first sheet's fabric, or metal."""
        fabrics = [sheet.fabric for sheet in self.sheets if sheet.fabric]
        return fabrics[0] if fabrics else self.sheets[0].metal

    def dies(self) -> dict[str, str]:
        """{name of a die: the tool that it is the die of}."""
        surfaces = {name: tool.surface for name, tool in self.tools.items()}
        return {name: s.tool for name, s in surfaces.items() if isinstance(s, DieOf)}

    def tool(self, name: str) -> PressTool:
        """The tool of this name with its `at`, of a die by default that of its tool."""
        tool = self.tools[name]
        if tool.at is not None:
            return tool
        of = self.tools.get(self.dies().get(name, ""), tool)
        return dataclasses.replace(tool, at=(of.at or (0.0, 0.0))[:2])

    def pressures(self) -> dict[str, float]:
        """{name: pressure at the start} of the holders whose pressure is a number [MPa]."""
        return {
            name: float(holder.pressure)
            for name, holder in self.holders.items()
            if isinstance(holder, PressureHolder) and not callable(holder.pressure)
        }

    def schedule(self, reach: Mapping[str, float], thickness: float) -> Schedule:
        """What tools and holders do over the load factor; reach, thickness: as in `Schedule`."""
        towards = {name: tool.towards for name, tool in self.tools.items()}
        forces = {n: float(t.force) for n, t in self.tools.items() if t.force is not None}
        return Schedule(self.stages, towards, forces, self.pressures(), reach, thickness)

    def thickness(self, pressure: float = 0.0) -> float:
        """Thickness of all sheets together under a pressure [MPa], [mm]."""
        rigid = self.interface.is_rigid
        return sum(sheet.thickness_under(pressure, rigid) for sheet in self.sheets)

    def build(self, comm: MPI.Comm | None = None) -> FormingScene:
        """The scene of the press. Raises InputError for tools that can't stand or move as given."""
        from .build import build

        return build(self, comm)

    def job(self, **changes: Any) -> Job:
        """The `Job` of the built press, with `changes` in its fields."""
        return self.build().job(**changes)
