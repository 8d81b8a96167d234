"""Pictures of a press: its tools around the flat blank, the stroke as a filmstrip. Quarters are
mirrored."""

import csv
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyvista
from matplotlib.collections import LineCollection
from matplotlib.patches import Patch
from numpy.typing import ArrayLike

from ..postprocess.ply import SYMMETRIC, Grid, grid_of
from ..postprocess.shape import File
from ..postprocess.states import states, triangulated
from ..runtime.formatting import rounded
from ..sheets.blank import Blank
from ..sheets.stack import Stack
from ..tools.facets import unit
from ..tools.tool import Tool
from . import space
from .pictures import figure, plt

TOOLS = ("#3b6fb6", "#d9822b", "#5aa469", "#8e5ea2", "#b83a3a", "#6b7a8f")
BLANK, CUT = "#e6d8a8", "#4a5360"
VIEW = 0.45, -1.0, 0.55  # from the blank to the camera
PANEL = 1200, 750  # pixels drawn of a state
SHOWN = 0.0, 0.2, 0.4, 0.6, 0.8, 1.0  # in a filmstrip, of the load
SOLID = {"smooth_shading": True, "split_sharp_edges": True, "ambient": 0.3, "diffuse": 0.75}
OPEN_EDGES = {"manifold_edges": False, "non_manifold_edges": False}


class _Scene(NamedTuple):
    """Whole plies and tools {name: surface}, which tools are above the blank, and the least and
    largest corners of all."""

    plies: dict[str, pyvista.PolyData]
    tools: dict[str, pyvista.PolyData]
    above: dict[str, bool]
    bounds: tuple[float, ...]


def flat_grids(blank: Blank | Stack, symmetric: Sequence[int] = ()) -> dict[str, Grid]:
    """The plies of a blank as they lie before a run {name: grid}, on all ranks, which call it
    together; symmetric: axes to which planes of symmetry are perpendicular."""
    grids = {}
    corners, comm = blank.corners(), blank.mesh.comm
    for part in list(blank.parts.values()) or [blank.whole]:
        x = np.concatenate(comm.allgather(corners[part.cells]))
        cells = np.arange(x[:, :, 0].size).reshape(x.shape[:2])
        points = np.pad(x.reshape(-1, x.shape[2]), ((0, 0), (0, 3 - x.shape[2])))
        grids[part.name] = grid = grid_of(points, cells, np.zeros_like(points))
        grid.field_data[SYMMETRIC] = list(symmetric)
    return grids


def setup_picture(
    path: File,
    plies: Mapping[str, Grid],
    tools: Mapping[str, Tool | pyvista.PolyData],
    motions: Mapping[str, Any] | None = None,
) -> None:
    """The flat plies {name: grid} and the tools {name: tool or surface} where they are now, in
    space and in sections through the centre: 1600 x 1200 pixels; motions: {name of a tool: (3,)},
    where it goes [mm]."""
    motions = {name: np.asarray(v, float) for name, v in (motions or {}).items() if np.any(v)}
    flat = {name: space.surface_of(grid, formed=False) for name, grid in plies.items()}
    scene = _scene(flat, tools)
    pixels = space.image(partial(_draw_setup, scene=scene, motions=motions), VIEW, scene.bounds)
    page = plt.figure(figsize=(16, 12))
    ax = page.add_axes((0.02, 0.4, 0.96, 0.54))
    ax.imshow(space.cropped([pixels])[0], interpolation="lanczos")
    ax.axis("off")
    above = {"loc": "upper center", "ncol": 4, "fontsize": 17, "frameon": False}
    page.legend(handles=_legend(scene, motions), **above)
    _draw_section(page.add_axes((0.06, 0.06, 0.42, 0.27)), scene, 1, motions)
    _draw_section(page.add_axes((0.55, 0.06, 0.42, 0.27)), scene, 0, motions)
    page.savefig(path, dpi=100)
    plt.close(page)


def filmstrip(path: File, folder: Path | str, loads: ArrayLike = SHOWN) -> None:
    """The stroke of the run in `folder` as states side by side, coloured by the magnitude of the
    shear angle on one scale: plies, each cut away further than the one below, tools below them, and
    the rear half of those above. loads: shares of the last load, near which states are shown."""
    written = states(folder)
    at = np.array([state.load for state in written])
    places = at[-1] * np.asarray(loads, dtype=float)
    chosen = [written[k] for k in np.unique(abs(at[:, None] - places).argmin(0))]
    scenes = [_of_state(state) for state in chosen]
    plies = [surface for scene in scenes for surface in scene.plies.values()]
    above, bounds, limit = _of_state(written[0]).above, _bounds(plies), space.shear_limit(plies)
    size = max(np.ptp(s["place"], axis=0).max() for s in scenes[0].plies.values())
    spacing = space.round_length(size / 24)  # along a blank, about, in a filmstrip
    images = []
    for scene in scenes:
        scene = scene._replace(above=above)
        draw = partial(_draw_state, scene=scene, limit=limit, spacing=spacing)
        images.append(space.image(draw, VIEW, bounds, PANEL))
    captions = _captions(Path(folder) / "history.csv")
    texts = [captions.get(state.load, f"load {state.load:.3g}") for state in chosen]
    _strip(path, space.cropped(images), texts, limit)


def _of_state(state):
    return _scene({name: space.surface_of(g) for name, g in state.plies().items()}, state.tools())


def _scene(plies, tools):
    """Plies {name: surface}, whole, and tools, mirrored as the plies were."""
    low, high = space.extent_of(plies.values())
    # of a tool's surface around the blank, over the blank's size
    room = 0.25 * (high - low).max()
    planes = next(iter(plies.values())).field_data["planes"]
    low, high = low - room, high + room
    surfaces = {}
    for name, tool in tools.items():
        if isinstance(tool, Tool):
            start = np.where(np.isin(np.arange(3), planes), -room / 2, low)
            tool = triangulated(tool, start, high).translate(tool.displacement)
        surfaces[name] = space.mirrored(tool, planes)
    middle = np.mean([surface.points[:, 2].mean() for surface in plies.values()])
    above = {name: surface.center[2] > middle for name, surface in surfaces.items()}
    return _Scene(plies, surfaces, above, _bounds([*plies.values(), *surfaces.values()]))


def _bounds(surfaces):
    return tuple(np.column_stack(space.extent_of(surfaces)).ravel())


# -- in space


def _draw_setup(plotter, scene, motions):
    """The blank with its edges, tools below it as they are, those above it translucent."""
    for surface in scene.plies.values():
        opacity = 1 - 0.6 ** (1 / len(scene.plies))  # of all plies together 0.4
        plotter.add_mesh(surface, color=BLANK, opacity=opacity, ambient=0.4, diffuse=0.6)
        edges = surface.extract_feature_edges(feature_edges=False, **OPEN_EDGES)
        plotter.add_mesh(edges, color="k", line_width=3)
    low, high = np.reshape(scene.bounds, (3, 2)).T
    size = (high - low).max()
    for k, (name, surface) in enumerate(scene.tools.items()):
        colour = TOOLS[k % len(TOOLS)]
        if not scene.above[name]:  # a little away, or what touches the blank would show through it
            surface = surface.translate(-0.003 * size * np.array(VIEW))
        plotter.add_mesh(surface, color=colour, opacity=0.22 if scene.above[name] else 1.0, **SOLID)
        edges = surface.extract_feature_edges(feature_angle=40, **OPEN_EDGES)
        if edges.n_points:
            plotter.add_mesh(edges, color=colour, line_width=2)
        if name in motions:
            start = np.array([high[0] + (0.05 + 0.07 * k) * size, low[1], surface.center[2]])
            length = float(np.linalg.norm(motions[name]))
            wide = min(0.008 * size / length, 0.1)
            tip = {"tip_radius": 2.5 * wide, "tip_length": min(0.4, 7 * wide)}
            place = {"start": start, "direction": motions[name], "scale": length}
            plotter.add_mesh(pyvista.Arrow(shaft_radius=wide, **place, **tip), color=colour)


def _draw_state(plotter, scene, limit, spacing):
    """Plies and tools of a state."""
    space.draw_plies(plotter, list(scene.plies.values()), limit, spacing)
    space.draw_axes(plotter, list(scene.plies.values()))
    for name, surface in scene.tools.items():
        if not scene.above[name]:
            behind = surface.translate(-3 * unit(np.array(VIEW)))
            plotter.add_mesh(behind, color=space.TOOL, **SOLID)
            continue
        middle = _middle(scene)
        rear = surface.clip(normal=(0, 1, 0), origin=middle, invert=False)
        if rear.n_cells:
            plotter.add_mesh(rear, color=space.STEEL, opacity=0.25, **SOLID)
            cut = surface.slice(normal=(0, 1, 0), origin=middle + (0, 1e-3, 0))
            if cut.n_points:
                plotter.add_mesh(cut, color=CUT, line_width=2)


def _middle(scene):
    """Middle (3,) of the whole plies in x and y [mm]."""
    low, high = space.extent_of(scene.plies.values())
    return np.append((low + high)[:2].round(6) / 2, 0.0)


# -- around these images


def _legend(scene, motions):
    """A patch for the blank and each tool."""
    handles = [Patch(facecolor=BLANK, edgecolor="k", label="blank")]
    for k, name in enumerate(scene.tools):
        way = float(np.linalg.norm(motions.get(name, 0.0)))
        moves = f", moves {rounded(way)} mm" if way else ""
        alpha = 0.45 if scene.above[name] else 1.0
        handles.append(Patch(color=TOOLS[k % len(TOOLS)], alpha=alpha, label=f"{name}{moves}"))
    return handles


def _draw_section(ax, scene, axis, motions):
    """Lines of tools and plies in the plane through their middle across `axis`, with motions."""
    along, normal, middle = 1 - axis, np.eye(3)[axis], _middle(scene)
    bodies = [("", surface, "k", 1.5) for surface in scene.plies.values()]
    for k, (name, surface) in enumerate(scene.tools.items()):
        bodies.append((name, surface, TOOLS[k % len(TOOLS)], 2.5))
    for k, (name, surface, colour, width) in enumerate(bodies):
        cut = surface.slice(normal=normal, origin=middle + 1e-3 * normal)
        if not cut.n_cells:
            continue
        ends = np.asarray(cut.points)[cut.lines.reshape(-1, 3)[:, 1:]][:, :, [along, 2]]
        ax.add_collection(LineCollection(ends, colors=colour, linewidths=width, capstyle="round"))
        if name in motions:
            start = np.array([cut.center[along], cut.center[2]])
            start[0] += 0.08 * np.ptp(ends[:, :, 0]) * (k - len(bodies) / 2)
            look = {"arrowstyle": "-|>", "color": colour, "lw": 2.5, "mutation_scale": 22}
            ax.annotate("", start + motions[name][[along, 2]], start, arrowprops=look)
    ax.autoscale_view()
    ax.margins(0.05)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(f"section {'xy'[axis]} = {rounded(middle[axis])}", fontsize=14)
    ax.set_xlabel(f"{'xy'[along]} / mm", fontsize=13)
    ax.set_ylabel("z / mm", fontsize=13)
    ax.grid(alpha=0.25)


def _captions(history):
    """{load: stroke and force} of a run's table."""
    if not history.is_file():
        return {}
    with open(history, newline="") as file:
        rows = list(csv.DictReader(file))
    force = "reaction_of_whole_N" if rows and "reaction_of_whole_N" in rows[0] else "reaction_N"
    large = max((abs(float(row[force])) for row in rows), default=0.0) or 1.0
    digits = 2 - int(np.floor(np.log10(large)))  # of three that count in the largest
    texts = {}
    for row in rows:
        newtons = rounded(round(float(row[force]), digits), 9)
        stroke = rounded(float(row["displacement_mm"]))
        texts[float(row["load"])] = f"stroke {stroke} mm, {newtons} N"
    return texts


def _strip(path, images, texts, limit):
    """Images in rows of three with a text under each, and their scale."""
    columns = min(3, len(images))
    rows = -(-len(images) // columns)
    height = 16 / columns * images[0].shape[0] / images[0].shape[1] + 0.5
    with figure(path, (16, rows * height + 1.2), rows, columns, dpi=100) as (page, axes):
        for ax in axes.flat:
            ax.axis("off")
        for k, (ax, pixels, text) in enumerate(zip(axes.flat, images, texts), 1):
            ax.imshow(pixels, interpolation="lanczos")
            ax.set_title(f"{k}: {text}", y=-0.02, va="top", fontsize=16)
        place = {"location": "bottom", "shrink": 0.4, "aspect": 40, "pad": 0.06}
        space.shear_bar(page, limit, space.SHEAR, (15, 13), ax=list(axes.flat), **place)
