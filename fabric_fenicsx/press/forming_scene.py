"""A press that is built, and what its job writes and draws."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.formatting import of_sheet, rounded
from ..energy.fingerprint import plain
from ..job.job import Job, Result
from ..results.shape import asymmetry
from ..results.verdict import Numbers, Reason
from ..results.wrinkles import HEIGHT, MIN_HEIGHT
from ..solve.checkpoint import STAGES
from .built import BuiltPress
from .holders import segments
from .laying import mirrored_yarns
from .placement import mirrored_tools
from .press_data import PressData
from .schema import document_of


class FormingScene(BuiltPress):
    """A press that is built, with its job, its numbers, files and pictures."""

    def job(self, **changes: Any) -> Job:
        """The `Job` with the steps of the stages, at the end of each of which a step ends;
        `changes` in its fields."""
        steps = changes.pop("steps", None) or self.schedule.steps
        ends = [end for end, _ in self.stages[:-1]]
        usual = {"milestones": ends, "limits": self.data.limits, "steps": steps}
        return Job.of(self, **usual | {"stop_when_invalid": self.data.stop_when_invalid} | changes)

    def fingerprint(self) -> Numbers:
        """What a checkpoint must agree in: the press as its file says it, without unloading, and
        its steps."""
        press = plain(document_of(self.data))
        press["stage"] = [each for each in press["stage"] if not each.get("unload")]
        steps = {k: stage.steps for k, stage in enumerate(self.schedule.stages, 1)}
        return {"press": press, STAGES: steps}

    def coarser(self) -> PressData | None:
        """As in `Setup`: for rectangles and outlines, which the program meshes."""
        both = zip(self.sheets, self.laid.blanks)
        coarse = [sheet.coarser(blank.sides()[:2]) for sheet, blank in both]
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
                flaw = f"{files[0]} is modelled by a {press.modelled}, which can't be disturbed"
                raise InputError(f"{flaw}; allowed is the whole blank")
            sheets = [sheet.mirrored(press.planes) for sheet in self.sheets]
            press = press.replace(sheets=sheets, symmetry="none")
        x, y, *z = np.asarray(press.tool(name).at).tolist()
        at = x + aside * math.cos(math.pi / 6), y + aside * math.sin(math.pi / 6), *z
        moved = dataclasses.replace(press.tools[name], at=at)
        return press.replace(tools={**press.tools, name: moved})

    def doubts(self, result: Result) -> list[Reason]:
        """A doubt for each plane in which the press is its own mirror image, but not the answer."""
        found, axes = list[Reason](), [axis for axis in (0, 1) if axis not in self.data.planes]
        answer = on_root(self.scene.comm, lambda: [asymmetry(result.grid, axis) for axis in axes])
        for axis, apart in zip(axes, answer):
            if apart and self._is_symmetric(axis):
                words = (
                    f"the press is its own mirror image in {'xy'[axis]} = 0, but the blank, which "
                    "moves by up to {} mm in plan, is {} mm off its image at {}; take more steps"
                )
                found.append(Reason(words.format(*map(rounded, apart[:2]), of_sheet(apart[2]))))
        return found

    def _is_symmetric(self, axis):
        """True if tools, yarns and holders are known to be mirrored by the plane across an axis."""
        data, extent = self.data, np.array(self.laid.blank.extent())
        yarns = [mirrored_yarns(*each, [axis]) for each in zip(self.sheets, self.laid.blanks)]
        tools = on_root(self.scene.comm, lambda: mirrored_tools(data, self.tools, extent, [axis]))
        held = [each for name, holder in data.holders.items() for each in segments(name, holder)]
        whole = all(getattr(h, "presses", False) and getattr(h, "where", h) is None for h in held)
        return whole and not (any(yarns) or tools or self.field_ranges())

    def of_whole(self, numbers: Numbers) -> str:
        """Text that follows the force on a part of the blank, "" for a whole one."""
        whole = numbers["force_of_whole_blank_N"]
        return f", {rounded(whole, 5)} N on all of it" if self.data.planes else ""

    def begin(self, folder: Path, pictures: bool) -> None:
        """Draw the tools and the flat blank before anything moves."""
        if pictures:
            from . import pictures as drawn  # takes long to import

            drawn.draw_setup(self, folder)

    def end(self, result: Result, folder: Path) -> None:
        """Write the heights of wrinkles, if any are told of."""
        for name, ply in self.wrinkle_heights.items():
            file = folder / f"{'_'.join(['wrinkles', *name.split()])}.vtu"
            file.unlink(missing_ok=True)  # of stages before
            if abs(ply[HEIGHT]).max() >= MIN_HEIGHT:
                ply.save(file)

    def pictures(self, result: Result, folder: Path) -> None:
        """As in `Setup`: the formed plies, shear, strain states, thickness and paths."""
        from . import pictures

        pictures.draw(self, result, folder)
