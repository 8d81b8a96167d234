"""A press that is built: its scene, and what its job measures, writes and draws."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..job.job import Job, Result
from ..job.setup import Setup
from ..mechanics.contact.interaction import ToolInteraction
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.fingerprint import plain
from ..mechanics.load import EdgeTension
from ..mechanics.springs import Springs
from ..mechanics.term import Term
from ..readers.field import Field
from ..results.measures import extremes
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..runtime.timing import phase
from ..scene import output
from ..scene.scene import Scene
from ..solve.checkpoint import STAGES
from ..tools.tool import Tool
from .laying import Laid
from .press_data import PressData
from .stages import Schedule


class FormingScene(Setup):
    """A press that is built: its `scene`, and

    - blank, sheets: what is laid, with final names, materials and meshes
    - tools {name: `Tool`}, schedule, thickness [mm] of the blank without pressure
    - pressing, contacts: terms that press the blank, and those of them that are contact with tools
    - holders: {name of a holder or segment: its terms}
    - wrinkle_heights: {name of a sheet: `height_map`} of the last result, on rank 0
    """

    data: PressData

    def __init__(
        self,
        data: PressData,
        scene: Scene,
        warnings: list[str],
        laid: Laid,
        tools: Mapping[str, Tool],
        schedule: Schedule,
        holders: Mapping[str, Sequence[Term]],
    ) -> None:
        super().__init__(scene, data, warnings)
        self.holders = holders
        self.laid, self.blank, self.sheets = laid, laid.blank, laid.sheets
        self.tools, self.schedule = tools, schedule
        self.thickness, self.comm = data.thickness(), scene.comm
        self.extent = laid.blank.extent()
        self.pressing = [term for term in scene.terms if isinstance(term, ToolInteraction)]
        self.contacts = [term for term in self.pressing if isinstance(term, Contact)]
        self.wrinkle_heights: dict[str, Any] = {}

    def fields(self) -> dict[str, str]:
        """{name: least to largest value and source} of what is a field; on all ranks."""
        units = {"fibre_angle": "deg", "thickness": "mm", "temperature": "C"}
        found = dict[str, tuple[Field, np.ndarray]]()
        for path, sheet, blank in zip(self.data.paths(), self.sheets, self.laid.blanks):
            of_sheet = {f"{path}.{name}_{units[name]}": getattr(sheet, name) for name in units}
            given = {n: v for n, v in of_sheet.items() if isinstance(v, Field)}
            found |= {name: (v, v.at(blank.centres())) for name, v in given.items()}
        for term in self.scene.terms:
            owner = term.tool.name if term.tool else term.name
            for name, (field, _, values) in term.fields.items():
                if name.startswith("friction"):
                    found[f"{name} on {owner}"] = field, values
        return {n: field.told(*extremes(self.comm, values)) for n, (field, values) in found.items()}

    def leader(self, load: float = 1.0) -> Tool:
        """The tool whose force the curve shows: that which moves furthest in the stage there."""
        names = self.schedule.leaders()
        leaders = [name for name in names[: self.schedule.stage_at(load) + 1] if name]
        return self.tools[leaders[-1] if leaders else next(iter(self.tools))]

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Travel [mm] and force [N], towards the blank, of the leading tools."""
        tool = self.leader(load)
        force = output.tool_force(scene, tool) @ self.data.tools[tool.name].towards
        return self.schedule.travel(load), float(force)

    def columns(self, scene: Scene) -> dict[str, float]:
        """{name: value} of each tool's travel since the start [mm] and its force on the modelled
        part [N], both along z; of each holder the force on the whole blank [N]: along z, or the sum
        of its pulls."""
        columns = {}
        for name, tool in self.tools.items():
            way = tool.displacement[2] - np.asarray(tool.path(0.0))[2]
            columns[f"{name}_way_mm"] = float(way)
            columns[f"{name}_force_N"] = float(output.tool_force(scene, tool)[2])
        for name, terms in self.holders.items():
            forces = [force for term in terms if (force := self._held_by(term)) is not None]
            if forces:
                column = f"{'_'.join(name.split())}_force_of_whole_N"
                columns[column] = sum(forces) / self.modelled_share()
        return columns

    def _held_by(self, term):
        """Force of a holder's term on the modelled part [N], None of one that tells none."""
        if isinstance(term, ToolInteraction):
            return float(term.tool_force()[2])
        if isinstance(term, EdgeTension):
            return self.comm.allreduce(float(abs(term.applied_forces()).sum()))
        return term.pull() if isinstance(term, Springs) else None

    def force_name(self) -> str:
        names = dict.fromkeys(name for name in self.schedule.leaders() if name)
        of = " or ".join(names) or next(iter(self.tools))
        return f"force of {of}" + (
            f" on a {self.data.modelled} of the blank" if self.data.planes else ""
        )

    def modelled_share(self) -> float:
        return self.data.share

    def of_whole(self, quantities: Mapping[str, Any]) -> str:
        """Text that follows the force on a part of the blank, "" for a whole one."""
        whole = quantities["force_of_whole_blank_N"]
        return f", {rounded(whole, 5)} N on all of it" if self.data.planes else ""

    def title_and_text(self) -> tuple[str, str]:
        count = len(self.sheets)
        plies = "a ply" if count == 1 else f"{count} plies"
        stages = ", then ".join(stage.name for stage in self.schedule.stages)
        of = f"Forming of {plies} by {', '.join(self.tools)}: {stages}."
        return self.data.title or "A press", of

    def fingerprint(self) -> dict[str, Any]:
        """As in `Setup`: the press as its file says it, without unloading, and its steps."""
        from .schema import document_of

        press = plain(document_of(self.data))
        press["stage"] = [each for each in press["stage"] if not each.get("unload")]
        return {
            "press": press,
            STAGES: {k: stage.steps for k, stage in enumerate(self.schedule.stages, 1)},
        }

    def resolved(self) -> dict[str, Any]:
        """As in `Setup`: the mesh of the first sheet, and the sides of the blank."""
        names = "nx", "ny", "size", "pattern", "element", "integration"
        first = {name: getattr(self.laid.first, name) for name in names}
        return first | dict(zip(("length", "width"), self.laid.sides))

    def coarser(self) -> PressData | None:
        """As in `Setup`: for rectangles and outlines, which the program meshes."""
        coarse = [sheet.coarser(each) for sheet, each in zip(self.sheets, self.laid.extents())]
        return None if None in coarse else self.data.replace(sheets=coarse)

    def finer(self, times: float) -> PressData:
        """The press with `times` as many cells along each side; InputError for a mesh's file."""
        return self.data.replace(sheets=[sheet.finer(times) for sheet in self.sheets])

    def disturbed(self, aside: float) -> PressData:
        """The press of the whole blank with its leading tool moved `aside` [mm], along no axis:
        what symmetry hides shows there. Raises InputError for a part from a file."""
        press, name = self.data, self.leader().name
        if press.planes:
            if files := [sheet.sheet_file for sheet in self.sheets if sheet.sheet_file]:
                raise InputError(
                    f"{files[0]} is modelled by a {press.modelled}, which can't be disturbed; "
                    "allowed is the whole blank"
                )
            sheets = [sheet.mirrored(press.planes) for sheet in self.sheets]
            press = press.replace(sheets=sheets, symmetry="none")
        x, y, *z = np.asarray(press.tool(name).at).tolist()
        at = x + aside * math.cos(math.pi / 6), y + aside * math.sin(math.pi / 6), *z
        moved = dataclasses.replace(press.tools[name], at=at)
        return press.replace(tools={**press.tools, name: moved})

    def job(self, **changes: Any) -> Job:
        """As in `Setup`, with the steps of the stages; a step ends at the end of each stage."""
        ends = tuple(float(each) for each in self.schedule.joints[1:-1])
        usual = {"milestones": ends, "limits": self.data.limits}
        usual |= {"stop_when_invalid": self.data.stop_when_invalid} | changes
        return super().job(**usual | {"steps": changes.get("steps") or self.schedule.steps})

    def stage(self, load: float) -> str:
        return self.schedule.stages[self.schedule.stage_at(load)].name

    def headlines(self) -> Sequence[str]:
        return (*super().headlines(), f"{self.leader().name}_force_N")

    def quantities(self, result: Result) -> dict[str, Any]:
        """As in `Setup`: forces, penetration, shear, strains, draw-in, thickness and wrinkles."""
        with phase("imports"):
            from . import quantities

        return quantities.all_of(self, result)

    def tables(self, result: Result, folder: Path) -> None:
        """As in `Setup`: the heights of wrinkles, if any are told of."""
        from ..postprocess.wrinkles import HEIGHT, MIN_HEIGHT

        for name, ply in self.wrinkle_heights.items():
            file = folder / f"{'_'.join(['wrinkles', *name.split()])}.vtu"
            file.unlink(missing_ok=True)  # of stages before
            if abs(ply[HEIGHT]).max() >= MIN_HEIGHT:
                ply.save(file)

    def first_picture(self, folder: Path) -> None:
        """The tools and the flat blank before anything moves; called on all ranks."""
        from . import pictures

        pictures.draw_setup(self, folder)

    def pictures(self, result: Result, folder: Path) -> None:
        """As in `Setup`: the stroke as a filmstrip, the formed plies, thickness and outline."""
        from . import pictures

        pictures.draw(self, result, folder)
