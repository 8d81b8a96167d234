"""The scene of a press: the blank is laid, the tools are placed, terms and supports are made."""

import math
from itertools import chain

from mpi4py import MPI

from ..mechanics.contact.self_contact import SelfContact
from ..mechanics.contact.tool_contact import Contact
from ..mechanics.shell.bending import Bending
from ..mechanics.shell.membrane import Membrane
from ..mechanics.shell.metal import SheetMetal
from ..readers.field import Field
from ..runtime.status import task
from ..runtime.timing import phase
from ..scene.scene import Scene
from ..scene.supports import Support
from . import stack
from .forming_scene import FormingScene
from .laying import Laid, lay_blank, on_plane
from .placement import place
from .press import Press
from .site import hold


@phase("setup")
@task("building the press")
def build(press: Press, comm: MPI.Comm | None = None) -> FormingScene:
    """The `FormingScene` of a press. Raises InputError, on all ranks, for a blank that can't be
    meshed and for tools that can't stand or move as given."""
    comm, warnings, interface = comm or MPI.COMM_WORLD, list[str](), press.interface
    laid, doubts = lay_blank(press.sheets, press.planes, comm, interface.is_rigid)
    warnings += doubts
    press = press.replace(sheets=laid.sheets)
    placed = place(press, laid, comm, warnings)
    sheets, planes = laid.sheets, [on_plane(axis) for axis in press.planes]

    fabrics = [sheet for sheet in sheets if sheet.fabric]
    terms = [laid.on(s, _membrane(s)) for s in fabrics]
    terms += [laid.on(s, _bending(s, planes)) for s in fabrics if s.bending_modulus]
    for name, tool in placed.tools.items():
        own = press.tools[name].friction
        friction = interface.on_tools(sheets) if own is None else interface.coulomb(own)
        terms.append(Contact(tool, penalty=interface.penalty, friction=friction))
    terms += [laid.on(s, SheetMetal(s.metal, symmetric=planes)) for s in sheets if s.metal]
    between = stack.between(laid.stack, sheets, interface, planes) if laid.stack else []
    holders, on_die = hold(press, laid, placed, between, warnings)
    terms += [*chain(*holders.values()), *between]
    if interface.self:
        terms += [laid.on(s, _folds(s, press, planes)) for s in sheets]

    scene = Scene(laid.blank, terms, _supports(press, laid))
    if laid.stack:
        stack.press(laid.stack, sheets, scene.terms, on_die)
    return FormingScene(press, scene, warnings, laid, placed, holders)


def _membrane(sheet):
    weave = None if sheet.weave_angle is None else math.radians(sheet.weave_angle)
    return Membrane(
        sheet.fabric,
        integration=sheet.integration,
        weave_angle=weave,
        temperature=sheet.temperature,
        thickness=sheet.thickness if isinstance(sheet.thickness, Field) else None,
    )


def _bending(sheet, planes):
    return Bending(
        modulus=sheet.bending_modulus,
        twist_modulus=sheet.twist_modulus,
        in_plane=sheet.in_plane_bending,
        symmetric=planes,
    )


def _folds(sheet, press, planes):
    """Contact of a sheet with itself."""
    return SelfContact(
        penalty=press.interface.penalty,
        lag=press.interface.lag_of_faces,
        symmetric=planes,
        friction=press.interface.coulomb(sheet.friction_to(sheet)),
    )


def _supports(press: Press, laid: Laid) -> list[Support]:
    """The planes of symmetry, and what keeps the blank from moving and turning in its plane: the
    nodes nearest to its centroid, and without planes to the end of the axis there."""
    supports = [
        Support(f"plane of symmetry {'xy'[axis]} = 0", on_plane(axis), (axis,))
        for axis in press.planes
    ]
    free = tuple(axis for axis in (0, 1) if axis not in press.planes)
    if free:
        middle = laid.nearest_nodes(laid.centre)
        supports.append(Support("centre", middle, free, locates=True))
    if not press.planes:
        end = laid.nearest_nodes(laid.centre + [laid.sides[0] / 2, 0.0])
        supports.append(Support("end of the axis", end, (1,), locates=True))
    return supports
