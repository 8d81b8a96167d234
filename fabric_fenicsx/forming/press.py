"""A press with tools, holders and stages of one's own."""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from ..job.job import Job, Result
from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.fields import check_fields
from ..runtime.formatting import rounded
from ..runtime.rules import unknown_key
from ..scene import output as reports
from ..scene.scene import Scene
from ..tools.checks import check_equation
from ..tools.surfaces import Offset, Reversed
from ..tools.tool import Tool
from . import holding
from .between_tools import BetweenTools
from .flange import Flange
from .holding import ForceHolder, GapHolder, Holder, PressureHolder
from .press_checks import check_clearances, symmetry_warnings
from .press_tools import DieOf, Placement, PressTool
from .punch import PRESSED, clearance_of
from .stages import Course, Stage


@dataclass(kw_only=True)
class Press(BetweenTools):
    """A blank of `fabric`, or a stack, formed by `tools` in `stages`; all of it unless `full` is
    False.

    The flat blank lies in z = 0, its centre at the origin. tools: {name: `PressTool`}; holders:
    {name: holder}, as `PressureHolder(0.1)`, which press the blank on the tool that they call
    `against`, by default the one that stands still with its flat face on the blank. title: of the
    report. document: what a file said of it. `Press.read` takes all from a file.

    Raises InputError for tools that can't stand or move so, and as `Scenario` does.
    """

    NAME: ClassVar[str] = "form"
    HEADLINES = (
        *("force_N", "shear_angle_max_deg", "shear_angle_99_percent_deg"),
        *("draw_in.largest_mm", "wrinkles.shortening"),
    )
    FULL = {"nx": 24, "balance": 0.02}
    QUICK = {"nx": 12, "balance": None}
    SOLVER = {"path_tolerance": 1e-6, "every": 5}
    DEFAULT_SIZES = (200.0, 200.0)

    full: bool = True
    tools: Mapping[str, PressTool] = field(default_factory=dict)
    holders: Mapping[str, Holder] = field(default_factory=dict)
    stages: Sequence[Stage] = ()
    title: str = ""
    document: Mapping[str, Any] = field(default_factory=dict, repr=False)

    @classmethod
    def read(cls, path: str | os.PathLike[str], changes: Sequence[str] = (), **fields: Any) -> Self:
        """The press in a TOML file. changes: of its entries, as "tools.punch.radius=40"; fields: of
        the press besides. Raises InputError that names file, table and key."""
        from .press_file import read_press

        given = {"title": Path(path).stem.replace("_", " ")} | read_press(path, changes) | fields
        try:
            return cls(**given)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def prepare(self) -> None:
        """Make the blank, and put the tools in their places."""
        if not self.tools:
            raise InputError("there is no tool; allowed are one or more")
        sides = {tool.side for tool in self.tools.values()}
        if len(sides) == 1 and not self.holders:
            raise InputError(
                f"all tools stand {sides.pop()} the blank, and nothing resists them; allowed is a "
                "tool on the other side, or a holder, as springs at the edges"
            )
        if len(sides) == 1 and len(self.tools) > 1:
            self.warnings.append(
                f"{' and '.join(self.tools)} all stand {next(iter(sides))} the blank, and only "
                "holders resist them: `side` says where a tool stands"
            )
        self.lay_blank()
        place = Placement(self.flat_nodes(), self.thickness, self.comm, self.warnings)
        forces = {n: float(t.force) for n, t in self.tools.items() if t.force is not None}
        self._pressures = {
            name: float(holder.pressure)
            for name, holder in self.holders.items()
            if isinstance(holder, PressureHolder) and not callable(holder.pressure)
        }
        towards = {name: tool.towards for name, tool in self.tools.items()}
        self.course = Course(self.stages, towards, forces, self._pressures)
        dies = {n: t.surface for n, t in self.tools.items() if isinstance(t.surface, DieOf)}
        made = {n: self._tool(n, t, place) for n, t in self.tools.items() if n not in dies}
        for name, of in dies.items():
            die = dataclasses.replace(self.tools[name], surface=self._die(name, of, made))
            try:
                made[name] = self._tool(name, die, place)
            except InputError as error:
                raise InputError(
                    f"tool {name} can't be the die of {of.tool}, if that is closed all round as a "
                    f"ball is: allowed is the die of an open surface, as double_dome or a file "
                    f"without a back ({error})"
                ) from None
        self._named = {name: made[name] for name in self.tools}
        self.rigid = list(self._named.values())
        for tool in self.rigid:
            check_equation(tool, self.flat_nodes(), self.comm)
        check_clearances(self)
        self.warnings += symmetry_warnings(self)

    def _tool(self, name, given, place):
        surface, start = place.stand(name, given)
        path, force = self.course.path(name, start), None
        if given.force is not None:
            size = self.course.force(name)

            def force(load):
                return self.modelled() * size(load) * given.towards

        return Tool(surface, path, force=force, name=name)

    def _die(self, name, of, made):
        """The surface of a die `of` a tool that is made."""
        if of.tool not in made:
            raise unknown_key(of.tool, made, f"die_of of tool {name}: {of.tool}")
        if self.tools[of.tool].side == self.tools[name].side:
            raise InputError(
                f"side of tool {name} is {self.tools[name].side}, as of {of.tool}, whose die it "
                "is; allowed is the other side"
            )
        surface = made[of.tool].surface
        pressed = sum(ply.thickness_under(PRESSED) for ply in self.plies)
        clearance = clearance_of(of.clearance, self.thickness, pressed, surface)
        return Reversed(Offset(surface, clearance))

    def contact(self, tool: Tool) -> Contact:
        """As in `BetweenTools`, with the tool's own friction."""
        own = self.tools[tool.name].friction
        friction = self.tool_friction() if own is None else Coulomb(own, self.slip, self.lag)
        return Contact(tool, penalty=self.penalty, permitted=self.permitted, friction=friction)

    def held(self, between: Sequence[Term]) -> list[Term]:
        """As in `BetweenTools`: of each holder."""
        terms: list[Term] = []
        named = [
            (name if k == 1 else f"{name} {k}", holder)
            for name, given in self.holders.items()
            for k, holder in enumerate(holding.holders_of(given), 1)
        ]
        for name, holder in named:
            if isinstance(holder, PressureHolder) and name in self._pressures:
                self.warnings += check_fields(holder, "{} of `PressureHolder`".format)
                holder = dataclasses.replace(holder, pressure=self.course.pressure(name))
            die = self._against(name, holder)
            if isinstance(holder, (ForceHolder, GapHolder)):
                holder = dataclasses.replace(holder, where=self._on_flat(die, holder.where))
            up = -self.tools[die.name].towards[2]
            if not isinstance(holder, holding.PULLING):
                self.die = die
            terms += holding.terms_of(holder, self.rim(die, name, between, up))
        return terms

    def _against(self, name: str, holder: Holder) -> Tool:
        """The tool on which a holder presses the blank."""
        asked = getattr(holder, "against", "")
        if asked and asked not in self._named:
            raise unknown_key(asked, self._named, f"against of holder {name}: tool {asked}")
        still = [n for n in self._named if not self.course.is_moved(n)]
        if asked and asked not in still:
            raise InputError(
                f"holder {name} is against tool {asked}, which moves; allowed is one that stands "
                "still, or a holder that is a tool with a force"
            )
        flat = [n for n in ([asked] if asked else still) if self._is_flat(n)]
        if isinstance(holder, holding.PULLING):
            return self._named[(flat or list(self._named))[0]]
        if not flat:
            which = f"tool {asked} has" if asked else "no tool that stands still has"
            raise InputError(
                f"holder {name} has nothing to press the blank on: {which} a flat face on it; "
                "allowed is a tool with one, or a holder that is a tool with a force"
            )
        if len(flat) > 1:
            raise InputError(
                f"holder {name} may press the blank on {' or '.join(flat)}; allowed is `against` "
                "that says which"
            )
        return self._named[flat[0]]

    def _is_flat(self, name):
        share = self._flange(self._named[name])(self.flat_nodes().T)
        return bool(self.comm.allreduce(int((share > 0).sum())))

    def _flange(self, die):
        return Flange(die, self.thickness, -self.tools[die.name].towards[2])

    def _on_flat(self, die, where):
        """Function of points of the flat blank to whether they lie at the die's flat face, and
        where a segment is: a plate has the die's opening."""
        flange = self._flange(die)
        return lambda x: (flange(x) > 0) & (where(x) if where else True)

    def job(self, **changes: Any) -> Job:
        """As in `Scenario`, with the steps of the stages, whose ends are hit exactly."""
        steps = changes.pop("steps", None) or self.course.steps
        ends = tuple(float(each) for each in self.course.joints[1:-1])
        usual: dict[str, Any] = {"first_picture": self.first_picture, "columns": self.columns}
        return super().job(**usual | {"milestones": ends} | changes, steps=steps)

    def problem(self) -> dict[str, Any]:
        """As in `Scenario`: the file, or what stands for it."""
        return {"press": dict(self.document)}

    def leader(self, load: float) -> Tool:
        """The tool whose force the curve shows at a load factor: of the stage there, the one that
        goes farthest."""
        names = self.course.leaders()
        known = [name for name in names[: self.course.stage_at(load) + 1] if name]
        return self._named[known[-1] if known else next(iter(self._named))]

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Travel [mm] and force [N], towards the blank, of the leading tools."""
        tool = self.leader(load)
        force = reports.tool_force(scene, tool) @ self.tools[tool.name].towards
        return self.course.travel(load), float(force)

    def columns(self, scene: Scene) -> dict[str, float]:
        """Of each tool its way from where it stood and its force, both along z, the force of what
        is modelled {name: value} [mm], [N]."""
        found = {}
        for name, tool in self._named.items():
            way = tool.displacement[2] - np.asarray(tool.path(0.0))[2]
            found[f"{name}_way_mm"] = float(way)
            found[f"{name}_force_N"] = float(reports.tool_force(scene, tool)[2])
        return found

    def force_name(self) -> str:
        """As in `Scenario`."""
        names = dict.fromkeys(name for name in self.course.leaders() if name)
        of = " or ".join(names) or next(iter(self._named))
        return f"force of {of}" + ("" if self.full else " on a quarter of the blank")

    def of_whole(self, quantities: Mapping[str, Any]) -> str:
        """What to say behind the force on a quarter, "" for a whole blank."""
        whole = quantities["force_of_whole_blank_N"]
        return "" if self.full else f", {rounded(whole, 5)} N on all of it"

    def about(self) -> tuple[str, str]:
        """As in `Scenario`."""
        count = len(self.plies)
        plies = "a ply" if count == 1 else f"{count} plies"
        stages = ", then ".join(stage.name for stage in self.course.stages)
        of = f"Forming of {plies} by {', '.join(self.tools)}: {stages}."
        return self.title or "A press", of

    def quantities(self, result: Result) -> dict[str, Any]:
        """Forces of all tools, penetration, shear, strains, draw-in, thickness and wrinkles."""
        from . import press_results

        return press_results.quantities(self, result)

    def first_picture(self, folder: Path) -> None:
        """The tools and the flat blank before anything moves; called on all ranks."""
        from . import press_results

        press_results.draw_setup(self, folder)

    def pictures(self, result: Result, folder: Path) -> None:
        """The stroke as a filmstrip, the formed plies, thickness, shortening and outline."""
        from . import press_results

        press_results.draw(self, result, folder)
