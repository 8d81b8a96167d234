"""Pictures of a press: its tools around the flat blank, the stroke as a filmstrip, maps of the
formed plies. Quarters are mirrored, but in maps."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyvista
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.patches import Patch

from ..results.fields import triangulated
from ..results.forming import File
from ..results.ply import SAME, Grid
from ..results.result import OUTLIERS, of_fabric
from ..results.structural import states
from ..runtime.formatting import rounded
from ..sheets.blank import Blank
from ..sheets.stack import Stack
from ..tools.tool import Tool
from . import forming_pictures, pictures
from .forming_pictures import COLOURS, SCREEN, cut_away, draw_ply, draw_yarns, drawing, surface_of
from .pictures import plt

TOOLS = ("#3b6fb6", "#d9822b", "#5aa469", "#8e5ea2", "#b83a3a", "#6b7a8f")
BLANK = "#e6d8a8"
VIEW = 0.45, -1.0, 0.55  # from the blank to the camera
MARGIN = 0.25  # of a tool's surface around the blank, over the blank's size
PANEL = 1200, 750  # pixels drawn of a state
SHOWN = 0.0, 0.2, 0.4, 0.6, 0.8, 1.0  # in a filmstrip, of the load
LINES = 24  # along a blank, about, in a filmstrip
THICKNESS = "thickness_under_pressure"


class _Scene(NamedTuple):
    """Whole plies and tools {name: surface}, which tools are above the blank, and the least and
    largest corners of all."""

    plies: dict[str, pyvista.PolyData]
    tools: dict[str, pyvista.PolyData]
    above: dict[str, bool]
    bounds: tuple[float, ...]


def flat_grids(blank: Blank | Stack) -> dict[str, Grid]:
    """The plies of a blank as they lie before a run {name: grid}, one is {"": grid}: what
    `setup_picture` draws. On all ranks, which call it together."""
    grids = {}
    corners, comm = blank.corners(), blank.mesh.comm
    for part in list(blank.parts.values()) or [blank.whole]:
        x = np.concatenate(comm.allgather(corners[part.cells]))
        cells, count = np.arange(x[:, :, 0].size).reshape(len(x), -1), x.shape[1]
        kind = pyvista.CellType.TRIANGLE if count == 3 else pyvista.CellType.QUAD
        points = np.pad(x.reshape(-1, x.shape[2]), ((0, 0), (0, 3 - x.shape[2])))
        grid = pyvista.UnstructuredGrid({kind: cells}, points)
        grid.point_data["u"] = np.zeros_like(points)
        grids[part.name] = grid
    return grids


def setup_picture(
    path: File,
    plies: Mapping[str, Grid],
    tools: Mapping[str, Tool | pyvista.PolyData] | Sequence[Tool],
    motions: Mapping[str, Any] | None = None,
) -> None:
    """The flat plies and the tools where they are now, in space and in sections through the centre:
    1600 x 1200 pixels.

    plies: {name: grid}, as of `flat_grids` (before a run) or of a run's states; they are drawn as
    they were cut. tools: by name, or with their own names; a tool's surface is drawn around the
    blank. motions: {name of a tool: (3,)}, where it goes from there [mm]. Raises InputError where
    VTK finds nothing to draw on.
    """
    if not isinstance(tools, Mapping):
        tools = {tool.name: tool for tool in tools}
    motions = {name: np.asarray(v, float) for name, v in (motions or {}).items() if np.any(v)}
    scene = _scene({name: surface_of(grid, formed=False) for name, grid in plies.items()}, tools)
    image = _cropped([_image(lambda plotter: _draw_setup(plotter, scene, motions), scene)])[0]
    figure = plt.figure(figsize=(16, 12))
    ax = figure.add_axes((0.02, 0.4, 0.96, 0.54))
    ax.imshow(image, interpolation="lanczos")
    ax.axis("off")
    figure.legend(
        handles=_legend(scene, motions), loc="upper center", ncol=4, fontsize=17, frameon=False
    )
    for axis, place in ((1, (0.06, 0.06, 0.42, 0.27)), (0, (0.55, 0.06, 0.42, 0.27))):
        _draw_section(figure.add_axes(place), scene, axis, motions)
    figure.savefig(path, dpi=100)
    plt.close(figure)


def filmstrip(
    path: File,
    folder: Path | str,
    loads: Sequence[float] = SHOWN,
    captions: Mapping[float, str] | None = None,
    view: Sequence[float] = VIEW,
) -> None:
    """The stroke of the run in `folder` as states side by side, coloured by the magnitude of the
    shear angle on one scale: the plies, of several each cut away further than the one below, the
    tools below them, and the rear half of those above, translucent.

    loads: shares of the load that was reached, near which states are shown; captions: {load: words}
    under a state, by default stroke and force of history.csv; view: direction from the plies to the
    camera. Raises InputError for a folder without states, and where VTK finds nothing to draw on.
    """
    found = [state for state in states(folder)]
    at = np.array([state.load for state in found])
    wanted = at[-1] * np.asarray(loads, dtype=float)
    shown = [found[k] for k in np.unique(abs(at[:, None] - wanted).argmin(0))]
    first = found[0]
    words = captions or _captions(Path(folder) / "history.csv")
    scenes = []
    for state in shown:
        plies = {name: surface_of(grid) for name, grid in state.plies().items()}
        scenes.append(_scene(plies, state.tools()))
    before = _scene({n: surface_of(g) for n, g in first.plies().items()}, first.tools()).above
    bounds = _bounds([surface for scene in scenes for surface in scene.plies.values()])
    scenes = [scene._replace(above=before, bounds=bounds) for scene in scenes]
    highest = max(s["shear_angle"].max() for scene in scenes for s in scene.plies.values())
    limit = max(5.0, 5 * np.ceil(highest / 5))
    # a number that people like
    size = max(np.ptp(s["place"], axis=0).max() for s in scenes[0].plies.values())
    spacing = min(
        (10.0**k * n for k in range(-2, 5) for n in (1, 2, 5)),
        key=lambda s: abs(np.log(LINES * s / size)),
    )
    towards = np.array(view, float) / np.linalg.norm(view)
    images = _cropped(
        [
            _image(lambda p, s=s: _draw_state(p, s, limit, spacing, towards), s, view, PANEL)
            for s in scenes
        ]
    )
    _strip(
        path, images, [words.get(state.load, f"load {state.load:.3g}") for state in shown], limit
    )


def draw_formed(folder: Path, plies: Mapping[str, Grid]) -> None:
    """Maps of the formed plies {name: grid} into `folder`: thickness.png under the pressure on
    them, shortening.png where compression shortens yarns, outline.png of the flat and the formed
    edges; what no ply has is left out."""
    fabrics = {name or "ply": grid for name, grid in of_fabric(plies).items()}
    if known := {n: g for n, g in fabrics.items() if THICKNESS in g.cell_data}:
        pictures.maps(folder / "thickness.png", known, [THICKNESS], OUTLIERS)
    if fabrics:
        names = "shortening_a", "shortening_b"
        pictures.maps(folder / "shortening.png", fabrics, names, outliers=OUTLIERS)
    forming_pictures.outline_picture(folder / "outline.png", plies)


# -- what there is


def _scene(plies, tools):
    """Plies {name: surface}, whole, and tools, mirrored as the plies were."""
    low, high = np.array(_bounds(list(plies.values()))).reshape(3, 2).T
    room = MARGIN * (high - low).max()
    planes = next(iter(plies.values())).field_data["planes"]
    low, high = low - room, high + room
    surfaces = {}
    for name, tool in tools.items():
        if isinstance(tool, Tool):
            start = np.where(np.isin(np.arange(3), planes), -room / 2, low)
            tool = triangulated(tool, start, high).translate(tool.displacement)
        surfaces[name] = mirrored(tool, planes)
    middle = np.mean([surface.points[:, 2].mean() for surface in plies.values()])
    above = {name: surface.center[2] > middle for name, surface in surfaces.items()}
    return _Scene(plies, surfaces, above, _bounds([*plies.values(), *surfaces.values()]))


def _bounds(surfaces):
    ends = np.array([surface.bounds for surface in surfaces]).reshape(-1, 3, 2)
    return tuple(np.column_stack([ends[:, :, 0].min(0), ends[:, :, 1].max(0)]).ravel())


def mirrored(surface: pyvista.PolyData, planes: Iterable[int]) -> pyvista.PolyData:
    """What of a surface is in x >= 0 or y >= 0, where these are `planes` of symmetry, and its
    images."""
    for axis in planes:
        normal = np.eye(3)[int(axis)]
        half = surface.clip(normal=normal, origin=(0, 0, 0), invert=False).triangulate()
        points, faces = np.array(half.points), half.faces.reshape(-1, 4)[:, 1:]
        points[abs(points[:, axis]) < SAME, axis] = 0.0
        points = np.vstack([points, points * (1 - 2 * normal)])
        faces = np.vstack([faces, faces[:, ::-1] + half.n_points])
        surface = pyvista.PolyData.from_regular_faces(points, faces)
        surface = surface.clean()
    return surface


# -- in space


def _image(draw, scene, view=VIEW, size=SCREEN):
    """What `draw` adds to a plotter, as an image."""
    towards = np.array(view, float) / np.linalg.norm(view)
    with drawing(size) as plotter:
        plotter.disable_anti_aliasing()  # with it depth peeling loses what is translucent
        # not by PyVista, whose check opens a window of its own: that ended the process on Debian 13
        plotter.ren_win.AlphaBitPlanesOn()
        plotter.renderer.SetUseDepthPeeling(True)
        plotter.renderer.SetMaximumNumberOfPeels(8)
        draw(plotter)
        plotter.view_vector(towards, viewup=(0, 0, 1))
        plotter.reset_camera(bounds=scene.bounds)
        plotter.renderer.ResetCameraClippingRange()  # what is beyond the bounds is drawn, too
        return plotter.screenshot(None, return_img=True)


def _cropped(images):
    """Images of one size without the white around what any of them shows."""
    drawn = np.any([(image < 255).any(2) for image in images], axis=0)
    rows, columns = np.flatnonzero(drawn.any(1)), np.flatnonzero(drawn.any(0))
    return [i[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] for i in images]


SOLID = {"smooth_shading": True, "split_sharp_edges": True, "ambient": 0.3, "diffuse": 0.75}


def _draw_setup(plotter, scene, motions):
    """The blank with its edges, tools below it as they are, those above it translucent."""
    for surface in scene.plies.values():
        opacity = 1 - 0.6 ** (1 / len(scene.plies))  # of all plies together 0.4
        plotter.add_mesh(surface, color=BLANK, opacity=opacity, ambient=0.4, diffuse=0.6)
        edges = surface.extract_feature_edges(
            feature_edges=False, manifold_edges=False, non_manifold_edges=False
        )
        plotter.add_mesh(edges, color="k", line_width=3)
    low, high = np.reshape(scene.bounds, (3, 2)).T
    size = (high - low).max()
    for k, (name, surface) in enumerate(scene.tools.items()):
        colour = TOOLS[k % len(TOOLS)]
        if not scene.above[name]:  # a little away, or what touches the blank would show through it
            surface = surface.translate(-0.003 * size * np.array(VIEW))
        plotter.add_mesh(surface, color=colour, opacity=0.22 if scene.above[name] else 1.0, **SOLID)
        edges = surface.extract_feature_edges(
            feature_angle=40, manifold_edges=False, non_manifold_edges=False
        )
        if edges.n_points:
            plotter.add_mesh(edges, color=colour, line_width=2)
        if name in motions:
            start = np.array([high[0] + (0.05 + 0.07 * k) * size, low[1], surface.center[2]])
            plotter.add_mesh(_arrow(start, motions[name], size), color=colour)


def _arrow(start, motion, size):
    length = float(np.linalg.norm(motion))
    wide = min(0.008 * size / length, 0.1)
    return pyvista.Arrow(
        start=start,
        direction=motion,
        scale=length,
        shaft_radius=wide,
        tip_radius=2.5 * wide,
        tip_length=min(0.4, 7 * wide),
    )


def _draw_state(plotter, scene, limit, spacing, towards):
    """Plies and tools of a state."""
    count = len(scene.plies)
    for k, surface in enumerate(scene.plies.values()):
        shown = cut_away(surface, k / count)
        families = [name for name in ("yarn_a", "yarn_b") if name in shown.point_data]
        draw_ply(plotter, shown, limit, () if families else None)
        seen = cut_away(
            surface, k / count, (k + 1) / count
        )  # below the next ply yarns poke through
        for name in families:
            draw_yarns(plotter, seen, seen[name] + spacing / 2, spacing)
    for name, surface in scene.tools.items():
        if not scene.above[name]:
            surface = surface.translate(-3 * towards)
            plotter.add_mesh(surface, color="#d3d8e0", **SOLID)
            continue
        rear = surface.clip(normal=(0, 1, 0), origin=(0, 0, 0), invert=False)
        if rear.n_cells:
            plotter.add_mesh(rear, color="#8f9aa8", opacity=0.25, **SOLID)
            cut = surface.slice(normal=(0, 1, 0), origin=(0, 1e-3, 0))
            if cut.n_points:
                plotter.add_mesh(cut, color="#4a5360", line_width=2)


# -- around these images


def _legend(scene, motions):
    """A patch for the blank and each tool."""
    handles = [Patch(facecolor=BLANK, edgecolor="k", label="blank")]
    for k, name in enumerate(scene.tools):
        way = float(np.linalg.norm(motions.get(name, 0.0)))
        goes = f", moves {rounded(way)} mm" if way else ""
        alpha = 0.45 if scene.above[name] else 1.0
        handles.append(Patch(color=TOOLS[k % len(TOOLS)], alpha=alpha, label=f"{name}{goes}"))
    return handles


def _draw_section(ax, scene, axis, motions):
    """Lines of the tools and the plies in the plane x = 0 or y = 0 that is perpendicular to `axis`,
    with the motions."""
    along = 1 - axis
    normal = np.eye(3)[axis]
    bodies = [*((n, s, "k", 1.5) for n, s in scene.plies.items())]
    bodies += [
        (name, surface, TOOLS[k % len(TOOLS)], 2.5)
        for k, (name, surface) in enumerate(scene.tools.items())
    ]
    for k, (name, surface, colour, width) in enumerate(bodies):
        cut = surface.slice(normal=normal, origin=1e-3 * normal)
        if not cut.n_cells:
            continue
        ends = np.asarray(cut.points)[cut.lines.reshape(-1, 3)[:, 1:]][:, :, [along, 2]]
        ax.add_collection(LineCollection(ends, colors=colour, linewidths=width, capstyle="round"))
        if name in motions and k >= len(scene.plies):
            start = np.array([cut.center[along], cut.center[2]])
            start[0] += 0.08 * np.ptp(ends[:, :, 0]) * (k - len(bodies) / 2)
            ax.annotate(
                "",
                start + motions[name][[along, 2]],
                start,
                arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.5, "mutation_scale": 22},
            )
    ax.autoscale_view()
    ax.margins(0.05)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_title(f"section {'xy'[axis]} = 0", fontsize=14)
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
    return {
        float(row["load"]): f"stroke {rounded(float(row['displacement_mm']))} mm, "
        f"{rounded(round(float(row[force]), digits), 9)} N"
        for row in rows
    }


def _strip(path, images, words, limit):
    """Images in rows of three with words under each, and their scale."""
    columns = min(3, len(images))
    rows = -(-len(images) // columns)
    height = 16 / columns * images[0].shape[0] / images[0].shape[1] + 0.5
    figure = plt.figure(figsize=(16, rows * height + 1.2), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax in axes:
        ax.axis("off")
    for k, (ax, image, text) in enumerate(zip(axes, images, words), 1):
        ax.imshow(image, interpolation="lanczos")
        ax.set_title(f"{k}: {text}", y=-0.02, va="top", fontsize=16)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, limit), COLOURS),
        ax=list(axes),
        location="bottom",
        shrink=0.4,
        aspect=40,
        pad=0.06,
    )
    bar.set_label("magnitude of the shear angle / deg", fontsize=15)
    bar.ax.tick_params(labelsize=13)
    figure.savefig(path, dpi=100)
    plt.close(figure)
