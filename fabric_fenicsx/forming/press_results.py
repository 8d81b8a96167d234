"""What a run of a press tells: its numbers, and its pictures."""

import logging
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..job.job import Result
from ..results import measures
from ..results.quantities import shortening
from ..runtime.logs import MARKED
from ..scene import output as reports
from . import measuring

log = logging.getLogger("fabric_fenicsx")


def quantities(press: Any, result: Result) -> dict[str, Any]:
    """Of a `Press`: the force of the leading tool and of each tool along z, on what is modelled and
    on the whole blank [N]; contact, shear, strains, draw-in; and `wrinkles`: how much compression
    shortens yarns in the mean over the fabric's area, and the length that a yarn loses so."""
    rows, share = result.rows, press.modelled()
    force = rows[-1]["reaction_N"]
    found = {
        "force_N": force,
        "force_of_whole_blank_N": force / share,
        "tool_forces_of_whole_blank_N": {
            term.tool.name: float(reports.tool_force(press.scene, term.tool)[2]) / share
            for term in press.pressing
        },
    }
    tool = press.leader(1.0)
    plies = measuring.of_plies(press, result, tool, False)
    found |= measuring.of_contact(press, result) | plies
    return found | {"wrinkles": _wrinkles(press, result, plies)}


def _wrinkles(press, result, found):
    blank = press.blank
    parts = list(blank.parts.values()) or [blank.whole]
    of_fabric = [part.cells for part, ply in zip(parts, press.plies) if ply.fabric]
    if not of_fabric:
        return None
    cells = np.concatenate(of_fabric)
    short, areas = shortening(result.fields)[cells], measures.areas(blank)[cells]
    return {
        "shortening": measures.mean(press.comm, short, areas),
        "excess_length_mm": found.get("excess_length_mm"),
    }


def draw_setup(press: Any, folder: Path) -> None:
    """setup.png: the tools of a `Press` and its flat blank before anything moves; called on all
    ranks."""
    from ..plot import press_pictures

    moves = {name: press.course.first_move(name) for name in press.tools}
    motions = {name: move for name, move in moves.items() if move.any()}
    plies = press_pictures.flat_grids(press.blank)
    if press.comm.rank:
        return
    with _told("setup.png"):
        press_pictures.setup_picture(folder / "setup.png", plies, press.rigid, motions)


def draw(press: Any, result: Result, folder: Path) -> None:
    """The stroke, the formed plies, thickness and shortening of a `Press`; called on rank 0."""
    from ..plot import forming_pictures, press_pictures
    from ..postprocess.tool_surfaces import tool_mesh

    with _told("filmstrip.png"):
        press_pictures.filmstrip(folder / "filmstrip.png", folder, press.course.shown())
    with _told("thickness.png"):
        press_pictures.draw_formed(folder, result.grids)
    angles = [
        (ply.fibre_angle, ply.fibre_angle + ply.yarn_angle) if ply.fabric else ()
        for ply in press.plies
    ]
    tool = press.leader(1.0)
    low, high = press.extent
    room = np.array([0.0, 0.0, float((high - low).max())])
    low, high = low - room - tool.displacement, high + room - tool.displacement
    with _told("formed.png"):
        forming_pictures.draw_plies(folder, result.grids, angles, tool_mesh(tool, low, high))


@contextmanager
def _told(picture):
    """Where nothing can be drawn, that is said and no reason to lose a run."""
    try:
        yield
    except Exception as error:  # whatever VTK finds
        log.warning("%s was not drawn: %s", picture, error, extra=MARKED)
