"""The pictures of a press: before anything moves, its stroke, and what was formed."""

import logging
from collections.abc import Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ..job.job import Result
from ..plot import press_pictures
from ..results import formed, laminate
from ..results.output import MARKED
from .build import FormingScene

log = logging.getLogger("fabric_fenicsx")


def draw_setup(made: FormingScene, folder: Path) -> None:
    """setup.png: the tools and the flat blank before anything moves; called on all ranks."""
    moves = {name: made.schedule.first_move(name) for name in made.tools}
    motions = {name: move for name, move in moves.items() if move.any()}
    plies = press_pictures.flat_grids(made.blank)
    if made.comm.rank:
        return
    with _no_loss("setup.png"):
        tools = list(made.tools.values())
        press_pictures.setup_picture(folder / "setup.png", plies, tools, motions)


def draw(made: FormingScene, result: Result, folder: Path) -> None:
    """The stroke, the formed plies, strain states, paths, thickness and metal; called on rank 0."""
    with _no_loss("filmstrip.png"):
        press_pictures.filmstrip(folder / "filmstrip.png", folder, made.schedule.shown())
    with _no_loss("thickness.png"):
        press_pictures.draw_formed(folder, result.grids)
    angles = [
        (s.fibre_angle, s.fibre_angle + s.yarn_angle) if s.fabric else () for s in made.sheets
    ]
    with _no_loss("formed.png"):
        formed.draw_plies(folder, result.grids, angles, _tool_mesh(made))
    compare(made, {"": result}, folder)


def compare(made: FormingScene, results: Mapping[str, Result], folder: Path) -> None:
    """Outlines and paths of runs {label: `Result`} side by side, into `folder`; of a laminate its
    middle ply."""
    grids = {
        " ".join(filter(None, (label, name))): grid
        for label, result in results.items()
        for name, grid in result.grids.items()
    }
    with _no_loss("paths.png"):
        formed.draw_compared(folder, grids, made.leader())
    layers = {label: result.grids for label, result in results.items()}
    metals = [sheet.name for sheet in made.sheets if sheet.metal]
    middle = laminate.middle_of(made.sheets)
    if middle and all({middle, metals[-1]} <= set(each) for each in layers.values()):
        laminate.draw(folder, layers, middle, metals[-1], made.leader())


def _tool_mesh(made):
    """The leading tool, where it is now, as far as the blank may have gone."""
    tool, (low, high) = made.leader(), made.extent
    room = np.array([0.0, 0.0, float((high - low).max())])
    place = tool.displacement
    return formed.tool_mesh(tool, low - room - place, high + room - place)


@contextmanager
def _no_loss(picture):
    """Where nothing can be drawn, that is said and no reason to lose a run."""
    try:
        yield
    except Exception as error:  # whatever VTK finds
        log.warning("%s was not drawn: %s", picture, error, extra=MARKED)
