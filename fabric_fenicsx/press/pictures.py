"""The pictures of a press: its tools at the start, the stroke, and the formed blank."""

from collections.abc import Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyvista

from ..contact.holder_pressure import BlankHolderPressure
from ..contact.tool_contact import Contact
from ..core.logs import MARKED, log
from ..core.status import task
from ..energy.load import EdgeTension
from ..energy.springs import Springs
from ..job.job import Result
from ..results import forming_pictures, press_pictures
from ..results.measures import planes_of_symmetry
from ..results.pictures import maps
from ..results.ply import Surface, ply_of
from ..results.quantities import middle_of
from ..results.wrinkles import HEIGHT
from .built import BuiltPress


def draw_setup(made: BuiltPress, folder: Path) -> None:
    """setup.png: the tools and the flat blank before anything moves; called on all ranks."""
    motions = {name: made.schedule.first_move(name) for name in made.tools}
    plies = press_pictures.flat_grids(made.scene.blank, planes_of_symmetry(made.scene))
    if made.scene.comm.rank:
        return
    with _no_loss("setup.png"):
        bodies = made.tools | _holders(made, plies)
        press_pictures.setup_picture(folder / "setup.png", plies, bodies, motions)


def _holders(made, plies):
    """{name: surface} of what holders press, a little away from the blank, and of what pulls."""
    size, surfaces = float(np.ptp(made.scene.blank.extent(), axis=0).max()), dict[str, Surface]()
    owners = {term: name for name, terms in made.holders.items() for term in terms}
    for term in made.scene.terms:
        ply = ply_of(plies[term.part_name] if term.part_name else next(iter(plies.values())))
        x, centres = ply.x, ply.x[ply.triangles].mean(1).T
        name = (term.tool or term).name
        if isinstance(term, BlankHolderPressure):
            surfaces[name] = _patch(ply, term.shares(centres) > 0.5, -0.02 * size * term.direction)
        elif isinstance(term, Contact) and term.where and name not in made.tools:
            up = term.tool.evaluate(centres.T[:1]).normal[0]
            surfaces[name] = _patch(ply, np.asarray(term.where(centres)), -0.02 * size * up)
        elif isinstance(term, Springs | EdgeTension):
            if isinstance(term, Springs):
                at, way = x[term.where(x.T)], np.asarray(term.arm, dtype=float)
                way = way * min(1.0, 0.15 * size / float(np.linalg.norm(way)))
            else:
                at, way = x[term.edge(x.T)], 0.15 * size * np.asarray(term.direction)
            ends, name = _pulls(at, way, size), owners.get(term, name)
            surfaces[name] = surfaces[name].merge(ends) if name in surfaces else ends
    return {name: surface for name, surface in surfaces.items() if surface.n_points}


def _patch(ply, pressed, shift):
    """Surface of the triangles where a mask (m,) is true, moved by `shift` (3,) [mm]."""
    return pyvista.PolyData.from_regular_faces(ply.x + shift, ply.triangles[pressed]).clean()


def _pulls(x, away, size):
    """Rods from about nine of the places x (n, 3) along a vector (3,) [mm]."""
    x = x[:: max(1, -(-len(x) // 9))]
    lines = pyvista.line_segments_from_points(np.stack([x, x + away], 1).reshape(-1, 3))
    return lines.tube(radius=0.004 * size).triangulate()


def draw(made: BuiltPress, result: Result, folder: Path) -> None:
    """The formed plies, strain states, paths, thickness and metal; called on rank 0."""
    with _no_loss("formed.png"):
        forming_pictures.draw_plies(folder, result.grids, made.leader().name)
    with _no_loss("wrinkles.png"):
        plies = {file.stem: pyvista.read(file) for file in sorted(folder.glob("wrinkles*.vtu"))}
        if plies:
            maps(folder / "wrinkles.png", plies, [HEIGHT], units={HEIGHT: "mm"})
    compare(made, {"": result}, folder)


def compare(made: BuiltPress, results: Mapping[str, Result], folder: Path) -> None:
    """Draw paths of runs {label: `Result`} side by side, and the middle ply."""
    layers = {label: result.grids for label, result in results.items()}
    named = [(label, *ply) for label, grids in layers.items() for ply in grids.items()]
    plies = {f"{label} {name}".strip(): grid for label, name, grid in named}
    with _no_loss("paths.png"):
        forming_pictures.draw_compared(folder, plies, made.leader())
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
