"""What a press is, as data: sheets, tools, holders and stages; no mesh, no MPI."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from ..core.errors import InputError
from ..core.fields import KnowsItsFields, check_fields, flag
from ..core.rules import FINITE, repr_short, unknown_key
from ..energy.load import Gravity
from ..material.laws import Law
from ..material.metal import Metal
from ..sheet.sheet import Sheet
from ..solve.limits import Limits
from .holders import Holder, segments
from .interface import Interface
from .stages import Schedule, Stage
from .tools import DieOf, PressTool


@dataclass(frozen=True, kw_only=True)
class PressData(KnowsItsFields):
    """The fields of a `Press`. Raises InputError for parts that do not fit together."""

    sheets: Sequence[Sheet]
    symmetry: str | Mapping[str, float] = "none"
    interface: Interface = Interface()
    tools: Mapping[str, PressTool] = field(default_factory=dict)
    holders: Mapping[str, Holder | Sequence[Holder]] = field(default_factory=dict)
    stages: Sequence[Stage] = ()
    limits: Limits = Limits()
    stop_when_invalid: bool = flag("end the run at the step where the ply cannot be formed")
    title: str = ""
    gravity: float | Sequence[float] = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "limits.{}".format)
        places = self.symmetry if isinstance(self.symmetry, Mapping) else {}
        if not places.keys() <= {*"xy"} or self.symmetry not in ("none", "x", "y", "xy", places):
            flaw = f"blank.symmetry is {repr_short(self.symmetry)}; expected one of none, x, y"
            raise InputError(f"{flaw}, xy, or a table of places [mm], as {{y = -400}}")
        for axis, place in places.items():
            FINITE.check(f"blank.symmetry.{axis}", place)
        if Gravity(self.gravity).acceleration[list(self.planes)].any():
            flaw = f"`gravity` is {self.gravity}, across a plane of symmetry"
            raise InputError(f"{flaw}; expected one along it")
        object.__setattr__(self, "sheets", _all_of(Sheet, "plies", self.sheets))
        object.__setattr__(self, "stages", _all_of(Stage, "stages", self.stages))
        _all_of(PressTool, "tools", list(self.tools.values()))
        for name, holder in self.holders.items():
            segments(name, holder)
        self._check_sides()
        self.schedule({die.tool: 0.0 for die in self.dies().values()}, 0.0)

    def _check_sides(self):
        if len({tool.side for tool in self.tools.values()}) == 1 and not self.holders:
            side = next(iter(self.tools.values())).side
            flaw = f"all tools are {side} the blank, and nothing resists them"
            raise InputError(f"{flaw}; expected a tool on the other side, or a holder")
        surfaces = [name for name in self.tools if name not in self.dies()]
        for name, die in self.dies().items():
            if die.tool in self.tools and die.tool not in surfaces:
                flaw = f"tools.{name}.die_of {die.tool} refers to a tool that is itself a `die_of`"
                raise InputError(f"{flaw}; expected one with a `shape` or `file`")
            if die.tool not in surfaces:
                raise unknown_key(die.tool, surfaces, f"tools.{name}.die_of {die.tool}")

    @property
    def planes(self) -> dict[int, float]:
        """Axes to which the planes of symmetry are perpendicular, 0 for x, 1 for y, and where these
        cut the axes [mm]."""
        places = self.symmetry if isinstance(self.symmetry, Mapping) else dict.fromkeys("xy", 0.0)
        return {axis: float(places[n]) for axis, n in enumerate("xy") if n in self.symmetry}

    @property
    def share(self) -> float:
        """Share of the whole blank that is modelled."""
        return 0.5 ** len(self.planes)

    @property
    def modelled(self) -> str:
        """Name of what is modelled of the blank."""
        return ("whole", "half", "quarter")[len(self.planes)]

    @property
    def fabric(self) -> Law | Metal:
        """The first sheet's fabric, or metal."""
        found: list = [sheet.fabric for sheet in self.sheets if sheet.fabric]
        return [*found, self.sheets[0].metal][0]

    def paths(self) -> list[str]:
        """The path of each sheet's table in a file."""
        names = [sheet.name.removeprefix("ply ") for sheet in self.sheets]
        return [f"ply.{name or k}" for k, name in enumerate(names, 1)] if names[1:] else ["blank"]

    def replace(self, **changes: Any) -> Self:
        """The press with other fields."""
        return replace(self, **changes)

    def with_fabrics(self, change: Callable[[Law], Law]) -> Self:
        """The press with `change` made in the fabric of each sheet."""
        changed = [sheet.fabric and change(sheet.fabric) for sheet in self.sheets]
        if changed == [sheet.fabric for sheet in self.sheets]:
            return self
        return self.replace(sheets=[replace(s, fabric=f) for s, f in zip(self.sheets, changed)])

    def dies(self) -> dict[str, DieOf]:
        """{name of a die: what it is the die of}."""
        surfaces = {name: tool.surface for name, tool in self.tools.items()}
        return {name: s for name, s in surfaces.items() if isinstance(s, DieOf)}

    def tool(self, name: str) -> PressTool:
        """The tool of this name with its `at`, of a die by default that of its tool."""
        tool = self.tools[name]
        of = self.tools[tool.surface.tool] if isinstance(tool.surface, DieOf) else tool
        return tool if tool.at else replace(tool, at=(of.at or (0.0, 0.0))[:2])

    def schedule(self, reach: Mapping[str, float], thickness: float) -> Schedule:
        """What tools and holders do over the load factor; reach, thickness: as in `Schedule`."""
        return Schedule(self.stages, self.tools, self.holders, reach, thickness)

    def thickness(self, pressure: float = 0.0) -> float:
        """Thickness of all sheets together under a pressure [MPa], [mm]."""
        rigid = self.interface.is_rigid
        return sum(sheet.thickness_under(pressure, rigid) for sheet in self.sheets)


def _all_of(kind, what, values):
    """One object of a kind, or several, as a tuple. Raises InputError for others, for none, and for
    two of one name."""
    values = (values,) if isinstance(values, kind) else tuple(values)
    names = [name for each in values if (name := getattr(each, "name", ""))]
    flaws = [f"one of the {what} is {repr_short(v)}" for v in values if not isinstance(v, kind)]
    flaws += [f"two {what} have the name {name}" for name in names if names.count(name) > 1]
    flaws += [] if values else [f"there are no {what}"]
    if flaws:
        kinds = f"`{kind.__name__}(...)`, or several with different names"
        raise InputError(f"{flaws[0]}; expected {kinds}")
    return values
