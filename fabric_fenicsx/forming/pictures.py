"""The pictures of a press: its tools at the start, the stroke, and the formed blank."""

from collections.abc import Mapping
from contextlib import contextmanager
from pathlib import Path

from ..job.job import Result
from ..plot import forming_pictures, press_pictures
from ..results.measures import planes_of_symmetry
from ..results.quantities import middle_of
from ..runtime.logs import MARKED, log
from ..runtime.status import task
from .build import FormingScene


def draw_setup(made: FormingScene, folder: Path) -> None:
    """setup.png: the tools and the flat blank before anything moves; called on all ranks."""
    moves = {name: made.schedule.first_move(name) for name in made.tools}
    motions = {name: move for name, move in moves.items() if move.any()}
    plies = press_pictures.flat_grids(made.blank, planes_of_symmetry(made.scene))
    if made.comm.rank:
        return
    with _no_loss("setup.png"):
        press_pictures.setup_picture(folder / "setup.png", plies, made.tools, motions)


def draw(made: FormingScene, result: Result, folder: Path) -> None:
    """The stroke, the formed plies, strain states, paths, thickness and metal; called on rank 0."""
    with _no_loss("filmstrip.png"):
        press_pictures.filmstrip(folder / "filmstrip.png", folder, made.schedule.shown())
    with _no_loss("formed.png"):
        forming_pictures.draw_plies(folder, result.grids, made.leader().name)
    compare(made, {"": result}, folder)


def compare(made: FormingScene, results: Mapping[str, Result], folder: Path) -> None:
    """Draw outlines and paths of runs {label: `Result`} into `folder`, side by side; of a laminate
    also its middle ply."""
    grids = {
        " ".join(filter(None, (label, name))): grid
        for label, result in results.items()
        for name, grid in result.grids.items()
    }
    with _no_loss("paths.png"):
        forming_pictures.draw_compared(folder, grids, made.leader())
    layers = {label: result.grids for label, result in results.items()}
    metals = [sheet.name for sheet in made.sheets if sheet.metal]
    middle = middle_of(made.sheets)
    if middle and all({middle, metals[-1]} <= set(each) for each in layers.values()):
        forming_pictures.draw_laminate(folder, layers, middle, metals[-1], made.leader())


@contextmanager
def _no_loss(picture):
    """Log it if a picture can't be drawn: that is no reason to lose a run."""
    try:
        with task(f"drawing {picture}"):
            yield
    except Exception as error:  # whatever VTK finds
        log.warning("%s was not drawn: %s", picture, error, extra=MARKED)
