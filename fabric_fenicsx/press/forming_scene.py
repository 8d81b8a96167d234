"""A press that is built: its scene, what its job measures, writes and draws."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..contact.contact_term import ToolContactTerm
from ..contact.coulomb import MAX_SLIP
from ..contact.holder_pressure import LineBead
from ..contact.tool_contact import Contact
from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.formatting import of_sheet, rounded, share
from ..energy.fingerprint import plain
from ..energy.load import EdgeTension, Gravity
from ..energy.springs import Springs
from ..energy.term import Term
from ..io.field import Field
from ..job.job import Job
from ..job.setup import Measured, Setup
from ..results import measures, quantities
from ..results.history import energies_of, stretching
from ..results.ply import Grid
from ..results.result import Result
from ..results.shape import asymmetry
from ..results.verdict import Numbers, Reason
from ..results.wrinkles import HEIGHT, MIN_HEIGHT, height_map, wrinkles
from ..scene import output
from ..scene.scene import Scene
from ..sheet.part import Part
from ..solve.checkpoint import STAGES
from ..surfaces.tool import Tool
from .holders import segments
from .laying import Laid, mirrored_yarns
from .placement import mirrored_tools
from .press_data import PressData
from .schema import document_of
from .stages import Schedule


class FormingScene(Setup):
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
        of its pulls or, of a bead, along the flange."""
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
        if isinstance(term, LineBead):
            return term.restrained()
        if isinstance(term, ToolContactTerm):
            return float(term.tool_force()[2])
        if isinstance(term, EdgeTension):
            return self.scene.comm.allreduce(float(abs(term.applied_forces()).sum()))
        return term.pull() if isinstance(term, Springs) else None

    def quantities(self, result: Result) -> Numbers:
        """Forces, penetrations, shear, strains, draw-in, thickness, wrinkles; for metal thinning,
        plastic strain and stress; for a stack the pressure between sheets. Those of a stack are for
        all sheets together; `plies` has those of each sheet."""
        numbers = self._of_contact(result) | self._of_sheets(result)
        if fields := self.field_ranges():
            numbers["fields"] = fields
        if "sheet_pressure" in result.fields:  # means of cells on the next sheet
            pressure = np.nan_to_num(result.fields["sheet_pressure"])
            numbers["sheet_pressure_largest_MPa"] = measures.extremes(self.scene.comm, pressure)[1]
        tools = {tool.name: tool.frame() for tool in (self.leader(), *self.tools.values())}
        (leader, frame), *_ = tools.items()
        for own in (numbers, *numbers.get("plies", {}).values()):
            places = {key: at for key, at in own.items() if key.endswith("_formed_at_mm")}
            for key, at in places.items():
                own[key.replace("_formed_at", f"_in_{leader}_at")] = frame.inside(at).tolist()
        numbers["tool_places"] = {
            name: {
                "placed_at_mm": frame.at.tolist(),
                "turned_by_deg": Rotation.from_matrix(frame.axes).as_euler("xyz", True).tolist(),
            }
            for name, frame in tools.items()
        }
        return numbers

    def field_ranges(self) -> dict[str, str]:
        """{name: least to largest value and source} of what is a field; on all ranks."""
        units = {"fibre_angle": "deg", "thickness": "mm", "temperature": "C"}
        found = dict[str, tuple[Field, np.ndarray]]()
        for path, sheet, blank in zip(self.data.paths(), self.sheets, self.laid.blanks):
            of_sheet = {f"{path}.{name}_{units[name]}": getattr(sheet, name) for name in units}
            given = {name: value for name, value in of_sheet.items() if isinstance(value, Field)}
            found |= {name: (value, value.at(blank.centres())) for name, value in given.items()}
        for term in self.scene.terms:
            owner = term.tool.name if term.tool else term.name
            for name, (field, _, values) in term.fields.items():
                if name.startswith("friction"):
                    found[f"{name} on {owner}"] = field, values
        extremes = partial(measures.extremes, self.scene.comm)
        return {name: field.in_words(*extremes(values)) for name, (field, values) in found.items()}

    def _of_contact(self, result):
        """Force of the leading tool towards the modelled part and the whole blank; of each tool the
        force along z on the whole blank and the size of the contact force on the modelled part [N];
        forces that are not in balance, penetration, and what else checks the contact."""
        scene, interface, energies = self.scene, self.data.interface, energies_of(result.rows[-1])
        part = self.modelled_share
        loads = [t for t in scene.terms if isinstance(t, Springs | Gravity)]
        tools = [(t.tool.name, float(output.tool_force(scene, t.tool)[2])) for t in self.pressing]
        acting = sum(float(term.applied_forces()[2::3].sum()) for term in loads)
        return {
            f"{self.leader().name}_force_N": (force := result.rows[-1]["reaction_N"]),
            "force_of_whole_blank_N": force / part,
            "contact_forces_N": {
                term.tool.name: float(np.linalg.norm(term.force())) for term in self.pressing
            },
            "tool_forces_of_whole_blank_N": {name: z / part for name, z in tools},
            "unbalanced_force_N": abs(scene.comm.allreduce(acting) + sum(z for _, z in tools)),
            "penalty_N_per_mm3": interface.penalty,
            "penetration_mm": max(each.penetration() for each in self.contacts),
            "penetration_largest_mm": max(each.largest_penetration() for each in self.contacts),
            "penetration_of_thickness": output.deepest(scene)[0],
            "sticking_slip_mm": (interface.slip or MAX_SLIP) if interface.friction else None,
            "viscous_of_strain_energy": share(energies["viscous"], stretching(energies)),
        }

    def _of_sheets(self, result):
        """Quantities of the one sheet, or of all sheets of a stack together and of each."""
        blank, comm = self.scene.blank, self.scene.comm
        fabrics, metals = list[Part](), list[Part]()
        plies: dict[str, Numbers] = {}
        self.wrinkle_heights = self.height_maps(result)
        for sheet, (name, part) in zip(self.sheets, (blank.parts or {"": blank.whole}).items()):
            (metals if sheet.metal else fabrics).append(part)
            of_cells = quantities.metal_quantities if sheet.metal else quantities.fabric_quantities
            plies[name] = of_cells(result, [part]) | {"draw_in": result.draw_in(part.name)}
            plies[name]["wrinkles"] = on_root(comm, lambda: wrinkles(self.wrinkle_heights[name]))
        whole = plies.get("")
        if not whole:
            if name := quantities.middle_of(self.sheets):
                plies[name] |= quantities.middle_quantities(result, name)
            whole = quantities.stack_quantities(result, plies, fabrics, metals) | {"plies": plies}
        whole["shortening_mean"] = None
        if fabrics:  # of yarns by compression, over the area of fabric
            cells = measures.cells_of(fabrics)
            short, areas = quantities.shortening(result.fields)[cells], blank.areas()[cells]
            whole["shortening_mean"] = measures.mean(comm, short, areas)
        return whole

    def height_maps(self, result: Result) -> dict[str, Grid]:
        """{name of a sheet: its `height_map`}, on rank 0 only. What lies on a sheet on that side is
        between it and the tools."""
        parts = self.scene.blank.parts or {"": self.scene.blank.whole}
        waves = {n: quantities.shortest_wave_of(self.scene, part) for n, part in parts.items()}
        if self.scene.comm.rank:
            return {}
        thickness = np.array([sheet.thickness_under(0.0) for sheet in self.sheets])
        below = thickness.cumsum() - thickness / 2
        tools, heights = output.tools(result.scene), {}
        for (name, wave), z in zip(waves.items(), below):
            off = partial(_off_tools, tools, z, thickness.sum() - z)
            shortest = wave if wave and np.isfinite(wave) else 0.0
            heights[name] = height_map(result.grids[name], off, shortest)
        return heights

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
        coarse = [sheet.with_larger_cells(blank.sides()[:2]) for sheet, blank in both]
        return None if None in coarse else self.data.replace(sheets=coarse)

    def finer(self, times: float) -> PressData:
        """The press with `times` as many cells along each side; InputError for a mesh's file."""
        return self.data.replace(sheets=[sheet.finer(times) for sheet in self.sheets])

    def disturbed(self, aside: float) -> PressData:
        """The press of the whole blank with its leading tool moved `aside` [mm], along no axis:
        what symmetry hides shows there. Raises InputError for a part from a file."""
        press, name = self.data, self.leader().name
        if press.planes:
            files = [sheet.sheet_file for sheet in self.sheets if sheet.sheet_file]
            if files := files + ["the blank"] * any(press.planes.values()):
                flaw = f"{files[0]} is modelled by a {press.modelled}, which cannot be disturbed"
                raise InputError(f"{flaw}; expected the whole blank")
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
                    f"the press is symmetric about {'xy'[axis]} = 0, but the blank, which moves by "
                    "up to {} mm in plan, is off its image by {} mm at {}; use more steps"
                )
                found.append(Reason(words.format(*map(rounded, apart[:2]), of_sheet(apart[2]))))
        return found

    def _is_symmetric(self, axis):
        """True if tools, yarns and holders are known to be mirrored by the plane across an axis."""
        press, extent, plane = self.data, np.array(self.laid.blank.extent()), {axis: 0.0}
        across = any(t.acceleration[axis] for t in self.scene.terms if isinstance(t, Gravity))
        yarns = [mirrored_yarns(*each, plane) for each in zip(self.sheets, self.laid.blanks)]
        tools = on_root(self.scene.comm, lambda: mirrored_tools(press, self.tools, extent, plane))
        held = [each for name, holder in press.holders.items() for each in segments(name, holder)]
        whole = all(getattr(h, "presses", False) and getattr(h, "where", h) is None for h in held)
        return whole and not (across or any(yarns) or tools or self.field_ranges())

    def begin(self, folder: Path, pictures: bool) -> None:
        """Draw the tools and the flat blank before the first step."""
        if pictures:
            from .pictures import draw_setup  # takes long to import

            motions = {name: self.schedule.first_move(name) for name in self.tools}
            draw_setup(folder / "setup.png", self.scene, self.tools, self.holders, motions)

    def end(self, result: Result, folder: Path) -> None:
        """Write the heights of wrinkles, if any are reported."""
        for name, ply in self.wrinkle_heights.items():
            file = folder / f"{'_'.join(['wrinkles', *name.split()])}.vtu"
            file.unlink(missing_ok=True)  # of stages before
            if abs(ply[HEIGHT]).max() >= MIN_HEIGHT:
                ply.save(file)

    def pictures(self, result: Result, folder: Path) -> None:
        """As in `Setup`: the formed plies, shear, strain states, thickness and paths."""
        from .pictures import draw

        draw(result, folder, self.leader(), self.sheets)


def _off_tools(tools, below, above, x):
    """Distance of places x (n, 3) of a sheet from the nearest tool, less what lies below or above
    the sheet [mm]."""
    least = np.full(len(x), np.inf)
    for near in (tool.evaluate(x) for tool in tools):
        least = np.fmin(least, near.gap - np.where(near.normal[:, 2] > 0, below, above))
    return least
