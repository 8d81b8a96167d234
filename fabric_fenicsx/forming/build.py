"""The scene of a press: the blank is laid, the tools are placed, terms and supports are made."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ..job.job import Job, Result
from ..job.setup import Setup
from ..mechanics.contact.coulomb import Coulomb
from ..mechanics.contact.holder_pressure import BlankHolderPressure
from ..mechanics.contact.interaction import ToolInteraction
from ..mechanics.contact.self_contact import SelfContact
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.fingerprint import plain
from ..mechanics.load import EdgeTension
from ..mechanics.shell.bending import Bending
from ..mechanics.shell.membrane import Membrane
from ..mechanics.shell.metal import SheetMetal
from ..mechanics.springs import Springs
from ..mechanics.term import Term
from ..runtime.errors import InputError
from ..runtime.formatting import rounded
from ..runtime.rules import unknown_key
from ..runtime.status import task
from ..runtime.timing import phase
from ..scene import output
from ..scene.scene import Scene
from ..scene.supports import Support
from ..sheets.stack import Stack
from ..solve.checkpoint import STAGES
from ..tools.surfaces import Offset, Reversed, Surface
from ..tools.tool import Tool
from . import stack
from .checks import PRESSED, check_clearances, symmetry_warnings
from .flange import Flange
from .holders import PULLING, Holder, Where, holders_of
from .holding import HolderSite, holder_terms, nearest_nodes
from .laying import ON_PLANE, Laid, lay_blank
from .placement import Placement, face_of
from .press import Press
from .stages import Schedule
from .tools import DieOf

CLEARANCE = 1.2  # thicknesses between a tool and its die, by default
PLANES = [lambda x: x[0] < ON_PLANE, lambda x: x[1] < ON_PLANE]  # of symmetry of a quarter


@phase("setup")
@task("building the press")
def build(press: Press, comm: MPI.Comm | None = None) -> "FormingScene":
    """The `FormingScene` of a press. Raises InputError, on all ranks, for a blank that can't be
    meshed and for tools that can't stand or move as given."""
    comm, warnings = comm or MPI.COMM_WORLD, list[str]()
    laid = lay_blank(press, comm, warnings)
    placed = place(press, laid, comm, warnings)
    bench = Bench(press, laid, placed, warnings)
    between = bench.between()
    terms = [*bench.membranes(), *bench.bending(), *bench.contacts(), *bench.metals()]
    terms += [*bench.holders(between), *between, *bench.folds()]
    scene = Scene(laid.blank, terms, bench.supports())
    data = press.replace(sheets=laid.sheets)
    made = FormingScene(data, scene, warnings, laid, placed, bench.held)
    made.press_together(bench.die)
    return made


@dataclass(frozen=True)
class Placed:
    """Tools in their places: tools {name: `Tool`}, which the `schedule` moves, and the thickness of
    the blank without pressure [mm]."""

    tools: dict[str, Tool]
    schedule: Schedule
    thickness: float


@task("placing the tools")
def place(press: Press, laid: Laid, comm: MPI.Comm, warnings: list[str]) -> Placed:
    """The tools of a press in their places at its blank. Raises InputError, on all ranks, for tools
    that can't stand or move as given."""
    nodes, thickness, pressed = laid.flat_nodes(), press.thickness(), press.thickness(PRESSED)
    at, dies = Placement(nodes, thickness, comm, warnings), press.dies()
    given = {name: tool.surface for name, tool in press.tools.items()}
    clearances = {
        name: surface.clearance or CLEARANCE * thickness
        for name, surface in given.items()
        if isinstance(surface, DieOf)
    }
    usual_off = {of: max(0.0, clearances[name] - thickness) for name, of in dies.items()}
    stood: dict[str, tuple[Surface, np.ndarray]] = {}
    for name in (n for n in press.tools if n not in dies):
        stood[name] = at.stand(name, press.tool(name), usual_off.get(name, 0.0))
    for name, of in dies.items():
        face = face_of(stood[of][0], press.tools[of].towards)
        at.check_matched(of, face, press.quarter)
        check_clearance(f"tools.{name}.clearance", clearances[name], pressed, face)
        surface = Reversed(Offset(face, clearances[name]))
        try:
            die = dataclasses.replace(press.tool(name), surface=surface)
            stood[name] = at.stand(name, die, is_die=True)
        except InputError as error:
            raise InputError(
                f"tools.{name} can't be the die of {of}; allowed is the die of an open surface, as "
                f"double_dome or a file, not of a closed one, as a ball ({error})"
            ) from None
    reach = {
        of: float((stood[name][1] - stood[of][1]) @ press.tools[of].towards) + clearances[name]
        for name, of in dies.items()
    }
    schedule = press.schedule(reach, thickness)
    tools = {name: _tool(press, name, *stood[name], schedule) for name in press.tools}
    placed = Placed(tools, schedule, thickness)
    check_clearances(press, laid, placed, pressed, warnings)
    warnings += symmetry_warnings(press, laid, placed)
    sides = {tool.side for tool in press.tools.values()}
    if len(sides) == 1 and len(press.tools) > 1:
        warnings.append(
            f"{' and '.join(press.tools)} all stand {next(iter(sides))} the blank, and only "
            "holders resist them: `side` says where a tool stands"
        )
    return placed


def _tool(press, name, surface, start, schedule):
    given, force = press.tools[name], None
    share = 0.25 if press.quarter else 1.0
    if given.force is not None:
        size = schedule.force(name)

        def force(load):
            return share * size(load) * given.towards

    return Tool(surface, schedule.path(name, start), force=force, name=name)


def check_clearance(path: str, clearance: float, pressed: float, surface: Surface) -> None:
    """Raise InputError for a distance of tool and die [mm] that is less than the `pressed`
    thickness, or not below the least concave radius of the tool."""
    radius = surface.radii[1]
    if clearance < pressed:
        raise InputError(
            f"{path} is {rounded(clearance, 6)}, less than the blank's thickness under "
            f"{PRESSED:g} MPa; allowed is from {rounded(pressed)} mm"
        )
    if clearance >= radius:
        raise InputError(
            f"{path} is {rounded(clearance, 6)}, which is not below the tool's least concave radius"
            f"; allowed is from {rounded(pressed)} to below {radius:g} mm"
        )


@dataclass
class Bench:
    """A press with its blank laid and its tools placed; it makes terms and supports. die: the tool
    on which holders press the blank; held: terms of each holder, {name: terms}."""

    press: Press
    laid: Laid
    placed: Placed
    warnings: list[str]
    die: Tool | None = None
    held: dict[str, list[Term]] = field(default_factory=dict)

    @property
    def stack(self) -> Stack | None:
        """The blank, if it is a stack."""
        return self.laid.blank if isinstance(self.laid.blank, Stack) else None

    @property
    def planes(self) -> Sequence[Callable[[np.ndarray], np.ndarray]]:
        """Functions that mark the planes of symmetry."""
        return PLANES if self.press.quarter else ()

    def membranes(self) -> list[Term]:
        """The membrane of each sheet of fabric."""

        def membrane(sheet):
            weave = None if sheet.weave_angle is None else math.radians(sheet.weave_angle)
            return Membrane(sheet.fabric, integration=sheet.integration, weave_angle=weave)

        return self._on_sheets(membrane, "fabric")

    def bending(self) -> list[Term]:
        """Bending of each sheet of fabric that resists it."""

        def bend(sheet):
            return Bending(
                modulus=sheet.bending_modulus,
                twist_modulus=sheet.twist_modulus,
                in_plane=sheet.in_plane_bending,
                symmetric=self.planes,
            )

        return self._on_sheets(lambda s: bend(s) if s.bending_modulus else None, "fabric")

    def metals(self) -> list[Term]:
        """The `SheetMetal` of each sheet of metal."""
        return self._on_sheets(lambda s: SheetMetal(s.metal, symmetric=self.planes), "metal")

    def _on_sheets(self, make, kind):
        made = [(make(s), s.name) for s in self.laid.sheets if getattr(s, kind)]
        return [t.on(name) if self.stack else t for t, name in made if t is not None]

    def friction(self) -> Coulomb:
        """Friction of sheets on tools."""
        return self.press.interface.on_tools(self.laid.sheets)

    def contacts(self) -> list[Contact]:
        """Contact of all sheets with each tool."""
        interface, found = self.press.interface, []
        for name, tool in self.placed.tools.items():
            own = self.press.tools[name].friction
            friction = self.friction() if own is None else interface.coulomb(own)
            found.append(interface.contact(tool, friction))
        return found

    def between(self) -> list[Term]:
        """Contact of the sheets with one another."""
        if not self.stack:
            return []
        return stack.between(self.stack, self.laid.sheets, self.press.interface, self.planes)

    def folds(self) -> list[Term]:
        """Contact of each sheet with itself, if asked for."""
        interface = self.press.interface
        if not interface.self:
            return []
        found = [
            SelfContact(
                penalty=interface.penalty,
                lag=interface.lag_of_faces,
                symmetric=self.planes,
                friction=interface.coulomb(sheet.friction_to(sheet)),
            )
            for sheet in self.laid.sheets
        ]
        return [t.on(s.name) if self.stack else t for t, s in zip(found, self.laid.sheets)]

    def holders(self, between: Sequence[Term]) -> list[Term]:
        """The terms of all holders; between: contacts of the sheets."""
        self._taken: list[tuple[str, str, Where]] = []
        for name, given in self.press.holders.items():
            for k, holder in enumerate(holders_of(name, given)):
                segment = name if k == 0 else f"{name} {k + 1}"
                self.held[segment] = self._holder(segment, holder, between)
        return [term for terms in self.held.values() for term in terms]

    def _holder(self, name, holder, between):
        schedule, pressures = self.placed.schedule, self.press.pressures()
        if name in pressures and not schedule.is_constant(name):
            holder = dataclasses.replace(holder, pressure=schedule.pressure(name))
        die = self._against(name, holder)
        self.die = self.die if isinstance(holder, PULLING) else die
        pile = self.stack
        site = HolderSite(
            name,
            self.laid.blank,
            self.laid.centre,
            not self.press.quarter,
            die,
            -self.press.tools[die.name].towards,
            self.placed.thickness,
            self.press.interface,
            self.friction(),
            self.warnings,
            [sheet.name for sheet in self.laid.sheets] if pile else (),
            stack.rims(pile, self.laid.sheets) if pile else (),
            stack.neighbours(between, self.laid.sheets) if pile else (),
            self._taken,
        )
        return holder_terms(holder, site)

    def _against(self, name: str, holder: Holder) -> Tool:
        """The tool on which a holder presses the blank."""
        tools, path = self.placed.tools, f"holders.{name}"
        asked = getattr(holder, "against", "")
        if asked and asked not in tools:
            raise unknown_key(asked, tools, f"{path}.against {asked}")
        still = [n for n in tools if not self.placed.schedule.is_moved(n)]
        if asked and asked not in still:
            raise InputError(
                f"{path}.against is {asked}, which moves; allowed is a tool that stands still, or "
                "a holder that is a tool with a force"
            )
        flat = [n for n in ([asked] if asked else still) if self._is_flat(tools[n])]
        if isinstance(holder, PULLING):
            return tools[(flat or list(tools))[0]]
        if not flat:
            which = f"{asked} has" if asked else "no tool that stands still has"
            raise InputError(
                f"{path} has nothing to press the blank on: {which} a flat face on it; allowed is "
                "a tool with one, or a holder that is a tool with a force"
            )
        if len(flat) > 1:
            raise InputError(
                f"{path} needs `against`, the name of the tool that it presses the blank on: "
                f"{' or '.join(flat)}"
            )
        return tools[flat[0]]

    def _is_flat(self, tool):
        up, extent = -self.press.tools[tool.name].towards[2], self.laid.blank.extent()
        flange = Flange(tool, self.placed.thickness, up, extent)
        share = flange(self.laid.flat_nodes().T)
        return bool(self.laid.blank.mesh.comm.allreduce(int((share > 0).sum())))

    def supports(self) -> list[Support]:
        """The planes of symmetry of a quarter; or the nodes of a whole blank nearest to its
        centroid and to the end of the axis there, which keep it from moving and turning in its
        plane."""
        if self.press.quarter:
            return [
                Support("plane of symmetry x = 0", PLANES[0], (0,)),
                Support("plane of symmetry y = 0", PLANES[1], (1,)),
            ]
        blank = self.laid.blank
        parts = list(blank.parts.values()) or [blank.whole]
        ends = self.laid.centre, self.laid.centre + [self.laid.sides[0] / 2, 0.0]
        fixed = [nearest_nodes(parts, at) for at in ends]
        return [
            Support("centre", fixed[0], (0, 1), locates=True),
            Support("end of the axis", fixed[1], (1,), locates=True),
        ]


class FormingScene(Setup):
    """A press that is built: its `scene`, and

    - blank, sheets: what is laid, with final names, materials and meshes
    - tools {name: `Tool`}, schedule, thickness [mm] of the blank without pressure
    - pressing, contacts: terms that press the blank, and those of them that are contact with tools
    - holders: {name of a holder or segment: its terms}
    - wrinkle_heights: {name of a sheet: `height_map`} of the last result, on rank 0
    """

    data: Press

    def __init__(
        self,
        data: Press,
        scene: Scene,
        warnings: list[str],
        laid: Laid,
        placed: Placed,
        holders: Mapping[str, Sequence[Term]],
    ) -> None:
        super().__init__(data, scene, warnings)
        self.holders = holders
        self.laid, self.blank, self.sheets = laid, laid.blank, laid.sheets
        self.tools, self.schedule = placed.tools, placed.schedule
        self.thickness, self.comm = placed.thickness, scene.comm
        self.extent = laid.blank.extent()
        self.pressing = [term for term in scene.terms if isinstance(term, ToolInteraction)]
        self.contacts = [term for term in self.pressing if isinstance(term, Contact)]
        self.wrinkle_heights: dict[str, Any] = {}

    def press_together(self, die: Tool | None) -> None:
        """Press the sheets of a stack together and onto the die, as its holder does: otherwise
        they do not touch at first, and sheets that do not touch resist nothing."""
        holders = [t for t in self.pressing if isinstance(t, BlankHolderPressure) and t.now]
        if not (isinstance(self.blank, Stack) and holders):
            return
        on_die = next(term for term in self.contacts if term.tool is die)
        pairs = stack.neighbours(self.scene.terms, self.sheets)
        stack.press(self.blank, pairs, on_die, holders, any(s.metal for s in self.sheets))

    def leader(self, load: float = 1.0) -> Tool:
        """The tool whose force the curve shows at a load factor: the one that moves furthest in the
        stage there."""
        names = self.schedule.leaders()
        known = [name for name in names[: self.schedule.stage_at(load) + 1] if name]
        return self.tools[known[-1] if known else next(iter(self.tools))]

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Travel [mm] and force [N], towards the blank, of the leading tools."""
        tool = self.leader(load)
        force = output.tool_force(scene, tool) @ self.data.tools[tool.name].towards
        return self.schedule.travel(load), float(force)

    def columns(self, scene: Scene) -> dict[str, float]:
        """{name: value} of each tool's travel since the start [mm] and its force on the modelled
        part [N], both along z; of each holder the force on the whole blank [N]: along z, or the sum
        of its pulls."""
        found = {}
        for name, tool in self.tools.items():
            way = tool.displacement[2] - np.asarray(tool.path(0.0))[2]
            found[f"{name}_way_mm"] = float(way)
            found[f"{name}_force_N"] = float(output.tool_force(scene, tool)[2])
        for name, terms in self.holders.items():
            forces = [force for term in terms if (force := self._held_by(term)) is not None]
            if forces:
                column = f"{'_'.join(name.split())}_force_of_whole_N"
                found[column] = sum(forces) / self.modelled_share()
        return found

    def _held_by(self, term):
        """Force of a holder's term on the modelled part [N], None of one that tells none."""
        if isinstance(term, ToolInteraction):
            return float(term.tool_force()[2])
        if isinstance(term, EdgeTension):
            return self.comm.allreduce(float(abs(term.applied_forces()).sum()))
        return term.pull() if isinstance(term, Springs) else None

    def force_name(self) -> str:
        """As in `Setup`."""
        names = dict.fromkeys(name for name in self.schedule.leaders() if name)
        of = " or ".join(names) or next(iter(self.tools))
        return f"force of {of}" + (" on a quarter of the blank" if self.data.quarter else "")

    def modelled_share(self) -> float:
        """As in `Setup`."""
        return 0.25 if self.data.quarter else 1.0

    def of_whole(self, quantities: Mapping[str, Any]) -> str:
        """Text that follows the force on a quarter, "" for a whole blank."""
        whole = quantities["force_of_whole_blank_N"]
        return f", {rounded(whole, 5)} N on all of it" if self.data.quarter else ""

    def title_and_text(self) -> tuple[str, str]:
        """As in `Setup`."""
        count = len(self.sheets)
        plies = "a ply" if count == 1 else f"{count} plies"
        stages = ", then ".join(stage.name for stage in self.schedule.stages)
        of = f"Forming of {plies} by {', '.join(self.tools)}: {stages}."
        return self.data.title or "A press", of

    def fingerprint(self) -> dict[str, Any]:
        """As in `Setup`: the press as its file says it, without unloading, and the steps of its
        stages."""
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

    def coarser(self) -> Press | None:
        """As in `Setup`: for rectangles and outlines, which the program meshes."""
        coarse = [sheet.coarser(each) for sheet, each in zip(self.sheets, self.laid.extents())]
        return None if None in coarse else self.data.replace(sheets=coarse)

    def finer(self, times: float) -> Press:
        """The press with `times` as many cells along each side of all sheets. Raises InputError for
        a mesh from a file."""
        return self.data.replace(sheets=[sheet.finer(times) for sheet in self.sheets])

    def disturbed(self, aside: float) -> Press:
        """The press of the whole blank with its leading tool moved `aside` [mm], along no axis:
        what symmetry hides shows there. Raises InputError for a quarter from a file."""
        press, name = self.data, self.leader().name
        if press.quarter:
            if known := [sheet.sheet_file for sheet in self.sheets if sheet.sheet_file]:
                raise InputError(
                    f"{known[0]} is a quarter, which can't be disturbed; allowed is the whole blank"
                )
            press = self.finer(2.0).replace(quarter=False)
        x, y, *z = np.asarray(press.tool(name).at).tolist()
        at = x + aside * math.cos(math.pi / 6), y + aside * math.sin(math.pi / 6), *z
        moved = dataclasses.replace(press.tools[name], at=at)
        return press.replace(tools={**press.tools, name: moved})

    def job(self, **changes: Any) -> Job:
        """As in `Setup`, with the steps of the stages; a step ends at the end of each stage."""
        ends = tuple(float(each) for each in self.schedule.joints[1:-1])
        usual: dict[str, Any] = {"first_picture": self.first_picture, "columns": self.columns}
        usual["stage"] = lambda load: self.schedule.stages[self.schedule.stage_at(load)].name
        headlines = (*self.data.HEADLINES, f"{self.leader().name}_force_N")
        usual |= {"milestones": ends, "limits": self.data.limits, "headlines": headlines} | changes
        return super().job(**usual | {"steps": changes.get("steps") or self.schedule.steps})

    def quantities(self, result: Result) -> dict[str, Any]:
        """As in `Setup`: forces, penetration, shear, strains, draw-in, thickness and wrinkles."""
        with phase("imports"):
            from . import quantities

        return quantities.all_of(self, result)

    def tables(self, result: Result, folder: Path) -> None:
        """As in `Setup`: the heights of wrinkles, if any are told of."""
        from ..postprocess.wrinkles import HEIGHT, LEAST

        for name, ply in self.wrinkle_heights.items():
            file = folder / f"{'_'.join(['wrinkles', *name.split()])}.vtu"
            file.unlink(missing_ok=True)  # of stages before
            if abs(ply[HEIGHT]).max() >= LEAST:
                ply.save(file)

    def first_picture(self, folder: Path) -> None:
        """The tools and the flat blank before anything moves; called on all ranks."""
        from . import pictures

        pictures.draw_setup(self, folder)

    def pictures(self, result: Result, folder: Path) -> None:
        """As in `Setup`: the stroke as a filmstrip, the formed plies, thickness and outline."""
        from . import pictures

        pictures.draw(self, result, folder)
