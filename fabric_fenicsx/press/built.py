"""A press that is built: its scene, and what its job measures."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..contact.contact_term import ToolContactTerm
from ..contact.tool_contact import Contact
from ..energy.load import EdgeTension
from ..energy.springs import Springs
from ..energy.term import Term
from ..job.setup import Measured, Setup
from ..results.ply import Grid
from ..scene import output
from ..scene.scene import Scene
from ..surfaces.tool import Tool
from .laying import Laid
from .press_data import PressData
from .stages import Schedule


class BuiltPress(Setup):
    """A press that is built: its `scene`, and

    - laid, sheets: what is laid, with final names, materials and meshes
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
        self.laid, self.sheets, self.holders = laid, laid.sheets, holders
        self.tools, self.schedule = tools, schedule
        self.thickness = data.thickness()
        self.pressing = [term for term in scene.terms if isinstance(term, ToolContactTerm)]
        self.contacts = [term for term in self.pressing if isinstance(term, Contact)]
        self.wrinkle_heights: dict[str, Grid] = {}
        leaders = dict.fromkeys(filter(None, schedule.leaders()))
        of_part = f" on a {data.modelled} of the blank" if data.planes else ""
        self.force_name = f"force of {' or '.join(leaders) or next(iter(tools))}{of_part}"
        self.modelled_share = data.share
        names = [stage.name for stage in schedule.stages]
        self.stages = list(zip(schedule.joints[1:].tolist(), names))
        plies = "a ply" if len(self.sheets) == 1 else f"{len(self.sheets)} plies"
        self.title = data.title or "A press"
        self.text = f"Forming of {plies} by {', '.join(self.tools)}: {', then '.join(names)}."
        fields = "nx", "ny", "size", "pattern", "element", "integration"
        self.resolved = {name: getattr(laid.first, name) for name in fields}
        self.resolved |= dict(zip(("length", "width"), laid.sides))

    def leader(self, load: float = 1.0) -> Tool:
        """The tool whose force the curve shows: that which moves furthest in the stage there."""
        led = self.schedule.leaders()[: self.schedule.stage_at(load) + 1]
        return self.tools[next(filter(None, reversed(led)), next(iter(self.tools)))]

    def measure(self, scene: Scene, load: float) -> Measured:
        """Travel [mm] and force [N], towards the blank, of the leading tools; `columns`."""
        tool = self.leader(load)
        force = output.tool_force(scene, tool) @ self.data.tools[tool.name].towards
        return self.schedule.travel(load), float(force), self.columns(scene)

    def columns(self, scene: Scene) -> dict[str, float]:
        """{name: value} of each tool's travel since the start [mm] and its force on the modelled
        part [N], both along z; of each holder the force on the whole blank [N]: along z, or the sum
        of its pulls."""
        columns = {}
        for name, tool in self.tools.items():
            travel = tool.displacement[2] - np.asarray(tool.path(0.0))[2]
            columns[f"{name}_travel_mm"] = float(travel)
            columns[f"{name}_force_N"] = float(output.tool_force(scene, tool)[2])
        for name, terms in self.holders.items():
            forces = [force for term in terms if (force := self._held_by(term)) is not None]
            if forces:
                column = f"{'_'.join(name.split())}_force_of_whole_N"
                columns[column] = sum(forces) / self.modelled_share
        return columns

    def _held_by(self, term):
        """Force of a holder's term on the modelled part [N], None of one that tells none."""
        if isinstance(term, ToolContactTerm):
            return float(term.tool_force()[2])
        if isinstance(term, EdgeTension):
            return self.scene.comm.allreduce(float(abs(term.applied_forces()).sum()))
        return term.pull() if isinstance(term, Springs) else None
