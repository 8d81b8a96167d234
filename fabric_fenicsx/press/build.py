"""The scene of a press: the blank is laid, the tools are placed, terms and supports are made."""

import math
from dataclasses import replace
from functools import partial
from itertools import chain

from mpi4py import MPI

from ..contact.holder_pressure import BlankHolderPressure
from ..contact.self_contact import SelfContact
from ..contact.tool_contact import Contact
from ..core.errors import InputError
from ..core.rules import unknown_key
from ..core.status import task
from ..core.timing import phase
from ..energy.bending import Bending
from ..energy.load import Gravity
from ..energy.membrane import Membrane
from ..energy.metal import SheetMetal
from ..energy.term import Term
from ..io.field import Field
from ..results.measures import PLANE_OF_SYMMETRY
from ..scene.scene import Scene
from ..scene.supports import Support
from ..scene.tool_warnings import cells_on_tools
from .forming_scene import FormingScene
from .holders import PressureHolder, segments
from .interface import press_together
from .laying import Laid, lay_blank, on_plane
from .placement import place_tools
from .press_data import PressData
from .site import Flange, HolderSite, Where

# of default cells, or halves of quadratic ones: length over the least radius of the tools (forces
# of trays on cells of 0.7 were 3 % off, on halves of 0.84 of it 9 %), times as fine as `CELLS`
CELLS_OVER_RADIUS, MAX_FINER = 0.6, 2.0


@phase("setup")
@task("building the press")
def build(press: PressData, comm: MPI.Comm | None = None) -> FormingScene:
    """The `FormingScene` of a press. Raises InputError, on all ranks, for a blank that can't be
    meshed and for tools that can't stand or move as given."""
    comm, interface = comm or MPI.COMM_WORLD, press.interface
    lay = partial(lay_blank, press.sheets, press.planes, comm, interface.is_rigid)
    laid, warnings = lay(1.0)
    tools, schedule, doubts = place_tools(press.replace(sheets=laid.sheets), laid)
    finer = cells_on_tools(laid.blank, tools.values())[0] / CELLS_OVER_RADIUS
    if finer > 1 and not all(s.nx or s.size or s.mesh for s in press.sheets):
        laid, warnings = lay(min(finer, MAX_FINER))
        tools, schedule, doubts = place_tools(press.replace(sheets=laid.sheets), laid)
    press = press.replace(sheets=laid.sheets)
    sheets, planes = laid.sheets, [on_plane(*plane) for plane in press.planes.items()]

    fabrics = [sheet for sheet in sheets if sheet.fabric]
    terms = [laid.on(s, _membrane(s)) for s in fabrics]
    terms += [laid.on(s, _bending(s, planes)) for s in fabrics if s.bending_modulus]
    on_tools = interface.on_tools(sheets)
    for name, tool in tools.items():
        own = press.tools[name].friction
        friction = on_tools if own is None else interface.coulomb(own)
        terms.append(Contact(tool, penalty=interface.penalty, friction=friction))
    terms += [laid.on(s, SheetMetal(s.metal, symmetric=planes)) for s in sheets if s.metal]
    between = interface.between(laid, planes)
    held, on_die, more = _hold(press, laid, tools, schedule, on_tools)
    terms += [*chain(*held.values()), *between]
    for sheet in sheets if interface.self else ():
        friction = interface.coulomb(sheet.friction_to(sheet))
        k, lag = interface.penalty, interface.lag_of_faces
        folds = SelfContact(penalty=k, lag=lag, symmetric=planes, friction=friction)
        terms.append(laid.on(sheet, folds))

    terms += [Gravity(press.gravity)] if press.gravity else []
    scene = Scene(laid.blank, terms, _supports(press, laid))
    press_together(laid, scene.terms, on_die)
    warnings = list(dict.fromkeys([*warnings, *doubts, *more]))
    return FormingScene(press, scene, warnings, laid, tools, schedule, held)


def _membrane(sheet):
    return Membrane(
        sheet.fabric,
        integration=sheet.integration,
        weave_angle=None if sheet.weave_angle is None else math.radians(sheet.weave_angle),
        temperature=sheet.temperature,
        thickness=sheet.thickness if isinstance(sheet.thickness, Field) else None,
    )


def _bending(sheet, planes):
    return Bending(
        modulus=sheet.bending_modulus,
        twist_modulus=sheet.twist_modulus,
        in_plane=sheet.in_plane_bending,
        in_plane_stiffness=sheet.in_plane_stiffness,
        symmetric=planes,
    )


def _supports(press: PressData, laid: Laid) -> list[Support]:
    """The planes of symmetry, and what keeps the blank from moving and turning in its plane: the
    nodes nearest to its centroid, and without planes to the end of the axis there."""
    supports = [
        Support(f"{PLANE_OF_SYMMETRY} {'xy'[axis]} = {place:g}", on_plane(axis, place), (axis,))
        for axis, place in press.planes.items()
    ]
    if free := tuple(axis for axis in (0, 1) if axis not in press.planes):
        middle = laid.nearest_nodes(laid.centre)
        supports.append(Support("centre", middle, free, locates=True))
    if not press.planes:
        end = laid.nearest_nodes(laid.centre + [laid.sides[0] / 2, 0.0])
        supports.append(Support("end of the axis", end, (1,), locates=True))
    return supports


# -- holders


def _hold(press, laid, tools, schedule, friction):
    """{name of a holder or segment: its terms}, the last tool on which one presses, and doubts.
    friction: of tools."""
    held, on_die, doubts = dict[str, list[Term]](), None, list[str]()
    taken: dict[str, dict[str, Where]] = {}
    for name, holder in _segments(press, schedule):
        die = _die_of(name, holder, press, laid, tools, schedule)
        on_die = die if getattr(holder, "presses", True) else on_die
        site = HolderSite(
            name=name,
            die=die,
            up=-press.tools[die.name].towards,
            thickness=press.thickness(),
            laid=laid,
            blank=laid.blank,
            centre=laid.centre,
            planes=press.planes,
            share=press.share,
            interface=press.interface,
            friction=friction,
            lag=press.interface.lag,
            taken=taken,
        )
        held[name] = terms = list(holder.terms(site))
        unnamed = [term.tool for term in terms if term.tool and term.tool.name == term.name]
        for k, tool in enumerate(unnamed, 1):
            tool.name = name if len(unnamed) == 1 else f"{name}, {k}"
        doubts += site.warnings
        doubts += [
            f"the pressure of {name} is directed away from the die: towards it is "
            f"(0, 0, {site.up[2]:g})"
            for term in terms
            if isinstance(term, BlankHolderPressure) and term.direction @ site.up < 0
        ]
    return held, on_die, doubts


def _segments(press, schedule):
    """Name and holder of each segment, with the pressure over all stages."""
    for name, options in press.holders.items():
        changing = schedule.pressure(name)
        for k, holder in enumerate(segments(name, options), 1):
            if changing and isinstance(holder, PressureHolder):
                holder = replace(holder, pressure=changing)
            yield (f"{name} {k}" if k > 1 else name), holder


def _die_of(name, holder, press, laid, tools, schedule):
    """The tool on which a holder presses the blank; of one that only pulls any."""
    path, asked = f"holders.{name}.against", getattr(holder, "against", "")
    if asked and asked not in tools:
        raise unknown_key(asked, tools, f"{path} {asked}")

    def is_flat(tool):
        up = -press.tools[tool.name].towards[2]
        share = Flange(tool, press.thickness(), up, laid.blank.extent())(laid.flat_nodes().T)
        return laid.blank.mesh.comm.allreduce(int((share > 0).sum())) > 0

    still = [tools[n] for n in ([asked] if asked else tools) if not schedule.is_moved(n)]
    flat = [tool for tool in still if is_flat(tool)]
    if not getattr(holder, "presses", True):
        return (flat or list(tools.values()))[0]
    if len(flat) != 1:
        names = ", ".join(tool.name for tool in flat) or "there is none"
        flaw = f"is {asked}{'' if still else ', which moves'}" if asked else f"is one of: {names}"
        raise InputError(
            f"{path} {flaw}; expected a tool that does not move and has a flat face on the blank, "
            "or a tool with a force instead of a holder"
        )
    return flat[0]
