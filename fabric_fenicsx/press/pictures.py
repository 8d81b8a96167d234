"""The pictures of a press: its tools around the flat blank, and the formed plies. Quarters are
mirrored."""

from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyvista
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from ..contact.holder_pressure import BlankHolderPressure
from ..contact.tool_contact import Contact
from ..core.formatting import rounded
from ..core.status import MARKED, log, task
from ..energy.load import EdgeTension
from ..energy.springs import Springs
from ..energy.term import Term
from ..job.job import Result
from ..results import pictures, space
from ..results.measures import planes_of_symmetry
from ..results.ply import Grid, Surface, grid_of, mark_planes, marked_planes, ply_of
from ..results.quantities import middle_of
from ..results.states import triangulated
from ..results.wrinkles import HEIGHT
from ..scene.scene import Scene
from ..sheet.blank import Blank
from ..sheet.sheet import Sheet
from ..sheet.stack import Stack
from ..surfaces.tool import Tool

TOOLS = ("#3b6fb6", "#d9822b", "#5aa469", "#8e5ea2", "#b83a3a", "#6b7a8f")


class _Scene(NamedTuple):
    """Whole plies, tools {name: (surface, colour, whether it is above the blank, its motion (3,)
    or None)}, and the least and largest corners of all."""

    plies: list[pyvista.PolyData]
    tools: dict[str, tuple]
    bounds: tuple[float, ...]


def draw_setup(
    path: Path,
    scene: Scene,
    tools: Mapping[str, Tool],
    holders: Mapping[str, Sequence[Term]],
    motions: Mapping[str, ArrayLike],
) -> None:
    """A picture of a press before the first step: as `setup_picture`; called on all ranks."""
    plies = flat_grids(scene.blank, planes_of_symmetry(scene))
    size = float(scene.blank.sides().max())  # of all ranks
    if scene.comm.rank:
        return
    with _no_loss(path.name):
        bodies = {**tools, **_holders(scene, holders, plies, size)}
        setup_picture(path, plies, bodies, motions)


def _holders(scene, holders, plies, size):
    """{name: surface} of what holders press, a little away from the blank, and of what pulls."""
    surfaces = dict[str, Surface]()
    owners = {term: name for name, terms in holders.items() for term in terms}
    for term in scene.terms:
        ply = ply_of(plies[term.part_name] if term.part_name else next(iter(plies.values())))
        x, centres = ply.x, ply.x[ply.cells].mean(1).T
        name = (term.tool or term).name
        if isinstance(term, BlankHolderPressure):
            surfaces[name] = _patch(ply, term.shares(centres) > 0.5, -0.02 * size * term.direction)
        elif isinstance(term, Contact) and term.where and term in owners:
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
    return pyvista.PolyData.from_regular_faces(ply.x + shift, ply.cells[pressed]).clean()


def _pulls(x, away, size):
    """Rods from about nine of the places x (n, 3) along a vector (3,) [mm]."""
    x = x[:: max(1, -(-len(x) // 9))]
    lines = pyvista.line_segments_from_points(np.stack([x, x + away], 1).reshape(-1, 3))
    return lines.tube(radius=0.004 * size).triangulate()


def flat_grids(blank: Blank | Stack, planes: Mapping[int, float]) -> dict[str, Grid]:
    """The plies of a blank as they lie before a run {name: grid}, on all ranks, which call it
    together; planes: of symmetry, {axis: place}."""
    grids = {}
    corners, comm = blank.corners(), blank.mesh.comm
    for part in blank.parts.values() or [blank.whole]:
        x = np.concatenate(comm.allgather(corners[part.cells]))
        cells = np.arange(x[:, :, 0].size).reshape(x.shape[:2])
        points = np.pad(x.reshape(-1, x.shape[2]), ((0, 0), (0, 3 - x.shape[2])))
        grids[part.name] = grid = grid_of(points, cells, np.zeros_like(points))
        mark_planes(grid, planes)
    return grids


def setup_picture(
    path: Path,
    plies: Mapping[str, Grid],
    tools: Mapping[str, Tool | pyvista.PolyData],
    motions: Mapping[str, ArrayLike],
) -> None:
    """The flat plies {name: grid} and the tools {name: tool or surface} where they are now, in
    space and in sections through the centre: 1600 x 1200 pixels; motions: {name of a tool: (3,)},
    where it goes [mm]."""
    surfaces = [space.surface_of(grid, formed=False) for grid in plies.values()]
    scene = _scene(surfaces, tools, motions)
    page = Figure(figsize=(16, 12))
    ax = page.add_axes((0.02, 0.4, 0.96, 0.54))
    drawn = space.image(partial(_draw_setup, scene=scene), space.VIEW, scene.bounds)
    ax.imshow(drawn, interpolation="lanczos")
    ax.axis("off")
    handles = [Patch(facecolor="#e6d8a8", edgecolor="k", label="blank")]
    for name, (_, colour, above, motion) in scene.tools.items():
        far = "" if motion is None else f", moves {rounded(float(np.linalg.norm(motion)))} mm"
        handles.append(Patch(color=colour, alpha=0.45 if above else 1.0, label=f"{name}{far}"))
    place = {"loc": "upper center", "ncol": 4, "fontsize": 17, "frameon": False}
    page.legend(handles=handles, **place)
    _draw_section(page.add_axes((0.06, 0.06, 0.42, 0.27)), scene, 1)
    _draw_section(page.add_axes((0.55, 0.06, 0.42, 0.27)), scene, 0)
    page.savefig(path, dpi=100)


def _scene(plies, tools, motions):
    """The `_Scene` of whole plies, and of tools, mirrored as the plies were."""
    low, high = space.extent_of(plies)
    # of a tool's surface around the blank, over the blank's size
    room, planes = 0.25 * (high - low).max(), marked_planes(plies[0])
    start = low - room
    start[[*planes]] = np.array([*planes.values()]) - room / 2
    middle, bodies = np.mean([surface.points[:, 2].mean() for surface in plies]), {}
    for (name, tool), colour in zip(tools.items(), cycle(TOOLS)):
        if isinstance(tool, Tool):
            tool = triangulated(tool, start, high + room).translate(tool.displacement)
        surface, motion = space.mirrored(tool, planes), np.asarray(motions.get(name, 0.0), float)
        above = surface.center[2] > middle
        bodies[name] = surface, colour, above, motion if motion.any() else None
    bounds = space.extent_of([*plies, *(surface for surface, *_ in bodies.values())])
    return _Scene(plies, bodies, tuple(np.column_stack(bounds).ravel()))


def _draw_setup(plotter, scene):
    """The blank with its edges, tools below it as they are, those above it translucent."""
    solid = {"smooth_shading": True, "split_sharp_edges": True, "ambient": 0.3, "diffuse": 0.75}
    open_edges = {"manifold_edges": False, "non_manifold_edges": False}
    for surface in scene.plies:
        opacity = 1 - 0.6 ** (1 / len(scene.plies))  # of all plies together 0.4
        plotter.add_mesh(surface, color="#e6d8a8", opacity=opacity, ambient=0.4, diffuse=0.6)
        edges = surface.extract_feature_edges(feature_edges=False, **open_edges)
        plotter.add_mesh(edges, color="k", line_width=3)
    size = np.ptp(np.reshape(scene.bounds, (3, 2)), axis=1).max()
    for surface, colour, above, _ in scene.tools.values():
        if not above:  # a little away, or what touches the blank would show through it
            surface = surface.translate(-0.003 * size * np.array(space.VIEW))
        plotter.add_mesh(surface, color=colour, opacity=0.22 if above else 1.0, **solid)
        edges = surface.extract_feature_edges(feature_angle=40, **open_edges)
        if edges.n_points:
            plotter.add_mesh(edges, color=colour, line_width=2)


def _draw_section(ax, scene, axis):
    """Lines of tools and plies in the plane through their middle across `axis`, with motions."""
    along, normal = 1 - axis, np.eye(3)[axis]
    middle = np.append(np.add(*space.extent_of(scene.plies))[:2].round(6) / 2, 0.0)
    bodies = [(surface, "k", False, None) for surface in scene.plies] + [*scene.tools.values()]
    for k, (surface, colour, _, motion) in enumerate(bodies):
        cut = surface.slice(normal=normal, origin=middle + 1e-3 * normal)
        if not cut.n_cells:
            continue
        ends = np.asarray(cut.points)[cut.lines.reshape(-1, 3)[:, 1:]][:, :, [along, 2]]
        width = 1.5 if k < len(scene.plies) else 2.5
        ax.add_collection(LineCollection(ends, colors=colour, linewidths=width, capstyle="round"))
        if motion is not None:
            start = np.array([cut.center[along], cut.center[2]])
            start[0] += 0.08 * np.ptp(ends[:, :, 0]) * (k - len(bodies) / 2)
            look = {"arrowstyle": "-|>", "color": colour, "lw": 2.5, "mutation_scale": 22}
            ax.annotate("", start + motion[[along, 2]], start, arrowprops=look)
    ax.autoscale_view()
    ax.margins(0.05)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(f"section {'xy'[axis]} = {rounded(middle[axis])}", fontsize=18)
    ax.set_xlabel(f"{'xy'[along]} / mm", fontsize=17)
    ax.set_ylabel("z / mm", fontsize=17)
    ax.tick_params(labelsize=15)
    ax.grid(alpha=0.25)


def draw(result: Result, folder: Path, leader: Tool, sheets: Sequence[Sheet]) -> None:
    """The formed plies, strain states, paths, thickness and metal; called on rank 0."""
    with _no_loss("formed.png"):
        pictures.draw_plies(folder, result.grids, leader.name)
    with _no_loss("wrinkles.png"):
        plies = {file.stem: pyvista.read(file) for file in sorted(folder.glob("wrinkles*.vtu"))}
        if plies:
            pictures.maps(folder / "wrinkles.png", plies, [HEIGHT], units={HEIGHT: "mm"})
    compare({"": result}, folder, leader, sheets)


def compare(
    results: Mapping[str, Result], folder: Path, leader: Tool, sheets: Sequence[Sheet]
) -> None:
    """Draw paths of runs {label: `Result`} side by side, and the middle ply."""
    layers = {label: result.grids for label, result in results.items()}
    named = [(label, *ply) for label, grids in layers.items() for ply in grids.items()]
    plies = {f"{label} {name}".strip(): grid for label, name, grid in named}
    with _no_loss("paths.png"):
        pictures.draw_compared(folder, plies)
    metals = [sheet.name for sheet in sheets if sheet.metal]
    middle = middle_of(sheets)
    if middle and all({middle, metals[-1]} <= set(each) for each in layers.values()):
        pictures.draw_laminate(folder, layers, middle, metals[-1], leader)


@contextmanager
def _no_loss(picture):
    """Log it if a picture can't be drawn: that is no reason to lose a run."""
    try:
        with task(f"drawing {picture}"):
            yield
    except Exception as error:  # whatever VTK finds
        log.warning("%s was not drawn: %s", picture, error, extra=MARKED)
