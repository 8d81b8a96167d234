"""Pictures of formed plies: paths, outlines, strain states, the ply on its punch.

Grids are those of `forming`.
"""

import os
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyvista
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.patches import Patch
from scipy.spatial import cKDTree
from vtkmodules.vtkCommonCore import vtkLogger

from ..results.forming import File, Outline, Path, outline
from ..results.ply import Grid, plan_area, ply_of, whole
from ..runtime.errors import InputError
from .pictures import SHOWN, cells_range, colour_scale, plt

STATES = {  # strain_state -> what it is, colour
    1: ("both in tension", "#3b6fb6"),
    2: ("a in tension, b in compression", "#f2b134"),
    3: ("a in compression, b in tension", "#5aa469"),
    4: ("both in compression", "#b83a3a"),
}
SCREEN = (2400, 1500)  # pixels drawn
COLOURS = "YlOrRd"  # light, so that the shading shows the shape
STEEL = "#8f9aa8"
YARN = "yarn_coordinate"  # how fields at points begin that tell the distance across yarns


def paths_picture(
    path: File, runs: Mapping[str, Mapping[float, Path]], marks: Mapping[str, Any] | None = None
) -> None:
    """Strains and shear angle over the distance on the flat ply, a row a path, of runs {label:
    `along_paths`}.

    marks: {label: distances on the paths [mm], or one for all}, drawn as vertical lines where that
    is on the path; NaN for none.
    """
    angles = list(dict.fromkeys(angle for paths in runs.values() for angle in paths))
    figure, axes = plt.subplots(
        len(angles),
        3,
        figsize=(11, 2.6 * len(angles) + 0.6),
        squeeze=False,
        sharex="row",
        sharey="col",
        layout="constrained",
    )
    for row, (mine, angle) in enumerate(zip(axes, angles)):
        end = max(paths[angle].distance[-1] for paths in runs.values() if angle in paths)
        for ax, (name, factor) in zip(
            mine, {"log_eps_11": 100, "log_eps_22": 100, "shear_angle": 1}.items()
        ):
            for label, paths in runs.items():
                if angle in paths:
                    ax.plot(
                        paths[angle].distance,
                        factor * getattr(paths[angle], name),
                        lw=1.4,
                        label=label,
                    )
            for k, (label, at) in enumerate((marks or {}).items()):
                style = {"color": "0.45", "lw": 0.9, "ls": ("--", ":", "-.")[k % 3]}
                if (place := np.broadcast_to(at, len(angles))[row]) <= end:
                    ax.axvline(place, label=label, **style)
            ax.axhline(0, color="k", lw=0.5)
            ax.set_ylabel(SHOWN[name][0])
            ax.grid(alpha=0.25)
            ax.set_xlim(0, end)
        mine[1].set_title(
            f"path along {'y' if angle else 'x'}" if angle in (0, 90) else f"path at {angle:g}°",
            fontsize="medium",
        )
    for ax in axes[-1]:
        ax.set_xlabel("distance on the flat ply / mm")
    legend = {
        label: line for ax in axes[:, 0] for line, label in zip(*ax.get_legend_handles_labels())
    }
    labels, handles = list(legend), list(legend.values())
    if len(labels) > 1 or (labels and marks):
        _legend_above(figure, handles, labels)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def _legend_above(figure, handles, labels):
    figure.get_layout_engine().set(rect=(0, 0, 1, 1 - 0.35 / figure.get_figheight()))
    figure.legend(handles, labels, loc="upper center", ncol=len(labels), frameon=False)


def outline_picture(path: File, runs: Mapping[str, Grid]) -> None:
    """The edges of the ply in plan, flat and formed, of runs {label: grid}."""
    figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
    for k, (label, grid) in enumerate(runs.items()):
        for n, edge in enumerate(outline(grid)):
            if k == 0:
                ax.plot(
                    *edge.undeformed[:, :2].T,
                    "--",
                    color="0.5",
                    lw=1.2,
                    label=None if n else "flat",
                )
            ax.plot(
                *edge.formed[:, :2].T, color=f"C{k}", lw=1.6, label=None if n else label or "formed"
            )
    ax.set_aspect("equal")
    ax.set_xlabel("x / mm")
    ax.set_ylabel("y / mm")
    ax.grid(alpha=0.25)
    _legend_above(figure, *ax.get_legend_handles_labels())
    figure.savefig(path, dpi=130)
    plt.close(figure)


def state_map(path: File, grid: Grid, formed: bool = False, edges: Sequence[Outline] = ()) -> None:
    """Plan maps of the strain states of eq. (13) and of the shear angle, on the flat or the formed
    ply.

    The legend gives each state's share of the flat ply's area. edges: of other sheets, drawn as
    they are formed.
    """
    ply = ply_of(grid)
    corners = (ply.formed if formed else ply.x)[ply.triangles, :2]
    area, state = plan_area(ply.x, ply.triangles), ply.fields["strain_state"]
    label, factor, colours = SHOWN["shear_angle"]
    shear = factor * ply.fields["shear_angle"]
    colours, *limits = colour_scale(colours, shear.min(), shear.max())
    figure, axes = plt.subplots(
        1, 2, figsize=(13, 5), sharex=True, sharey=True, layout="constrained"
    )
    kinds = ListedColormap([colour for _, colour in STATES.values()])
    for ax, values, cmap, clim in (
        (axes[0], state, kinds, (0.5, 4.5)),
        (axes[1], shear, colours, limits),
    ):
        cells = PolyCollection(corners, array=values, cmap=cmap, antialiased=False)
        cells.set_clim(*clim)
        ax.add_collection(cells)
        ax.autoscale_view()
        ax.margins(0.02)
        for edge in edges:
            ax.plot(*edge.formed[:, :2].T, color="k", lw=1.2)
        ax.set_aspect("equal")
        ax.set_xlabel("x / mm")
    axes[0].set_ylabel("y / mm")
    shares = {k: area[state == k].sum() / area.sum() for k in STATES}
    axes[0].legend(
        handles=[
            Patch(color=colour, label=f"{name}: {shares[k]:.0%}")
            for k, (name, colour) in STATES.items()
        ],
        loc="upper center",
        bbox_to_anchor=(0.5, -0.15),
        ncol=2,
        frameon=False,
    )
    axes[1].set_title(cells_range(shear), fontsize="small")
    figure.colorbar(cells, ax=axes[1], label=label, location="bottom", shrink=0.8, aspect=30)
    figure.savefig(path, dpi=130)
    plt.close(figure)


@contextmanager
def screen() -> Iterator[None]:
    """Where VTK can draw: a screen of its own if it needs one that is not there."""
    if os.environ.get("DISPLAY") or pyvista.vtk_version_info >= (
        9,
        4,
    ):  # that and later draw without one, by EGL
        yield
        return
    missing = InputError(
        "this VTK draws on a screen only; allowed is DISPLAY set, or Xvfb (apt install xvfb)"
    )
    size = "{}x{}x24".format(*SCREEN)
    try:
        server = subprocess.Popen(
            ["Xvfb", "-displayfd", "1", "-screen", "0", size, "-nolisten", "tcp"],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
    except FileNotFoundError:
        raise missing from None
    assert server.stdout
    try:
        number = server.stdout.readline().strip()
        if not number:
            raise missing
        os.environ["DISPLAY"] = f":{number}"
        yield
    finally:
        os.environ.pop("DISPLAY", None)
        server.terminate()
        server.wait()


@contextmanager
def drawing(size: tuple[int, int] = SCREEN) -> Iterator["pyvista.Plotter"]:
    """A plotter of `size` [pixels] without a window, on white. Raises InputError where VTK finds
    nothing to draw on."""
    with screen():
        verbosity = vtkLogger.GetCurrentVerbosityCutoff()
        # VTK warns of no screen before it does without
        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
        plotter = pyvista.Plotter(off_screen=True, window_size=size)
        try:
            plotter.set_background("white")
            yield plotter
        finally:
            plotter.close()
            vtkLogger.SetStderrVerbosity(verbosity)


def surface_of(grid: Grid, full: bool = True, formed: bool = True) -> pyvista.PolyData:
    """The ply, formed or flat, with the nodes' `place` on the flat one and `shear_angle` [deg], its
    magnitude, 0 of metal; `yarn_a` and `yarn_b`, the distance across the yarns [mm], if the grid
    has them; full: with the images in the planes of symmetry, whose axes are in the field data
    `planes`."""
    ply = ply_of(grid)
    planes = ply.planes if full else []
    ply = whole(ply) if full else ply
    shear = abs(np.degrees(ply.fields.get("shear_angle", np.zeros(len(ply.triangles)))))
    points = ply.formed if formed else ply.x
    surface = pyvista.PolyData.from_regular_faces(points, ply.triangles)
    surface.point_data["place"] = ply.x
    surface.point_data["shear_angle"] = ply.at_nodes(shear)
    surface.field_data["planes"] = np.array(planes, dtype=int)
    if f"{YARN}_a" in grid.point_data and "shear_angle" in grid.cell_data:
        place = np.where(np.isin(np.arange(3), planes), abs(ply.x), ply.x)
        nearest = cKDTree(grid.points).query(place)[1]
        for family in "ab":
            surface.point_data[f"yarn_{family}"] = grid.point_data[f"{YARN}_{family}"][nearest]
    return surface


def cut_away(surface: pyvista.PolyData, share: float, end: float = 1.0) -> pyvista.PolyData:
    """A ply, as of `surface_of`, without that share of its length, seen from its lower end, and
    without what is beyond the share `end`."""
    x = surface["place"][:, 0]
    surface["along"] = x
    for part, beyond in ((share, False), (end, True)):
        if 0 < part < 1:
            place = float(x.min() + part * np.ptp(x))
            surface = surface.clip_scalar(scalars="along", invert=beyond, value=place)
    return surface


def draw_ply(
    plotter: "pyvista.Plotter",
    surface: pyvista.PolyData,
    limit: float,
    angles: Sequence[float] | None = (),
    spacing: float = 10.0,
) -> None:
    """Add a ply, as of `surface_of`, coloured by its shear angle up to `limit` [deg], with yarns at
    these angles to x on the flat ply [deg]; angles: None of metal, which is grey."""
    coloured = {
        "scalars": "shear_angle",
        "cmap": COLOURS,
        "clim": (0, limit),
        "show_scalar_bar": False,
    }
    plotter.add_mesh(
        surface,
        **(coloured if angles is not None else {"color": STEEL}),
        smooth_shading=True,
        ambient=0.25,
        diffuse=0.8,
        specular=0.15,
    )
    for angle in np.radians([] if angles is None else angles):
        across = surface["place"] @ [-np.sin(angle), np.cos(angle), 0]
        draw_yarns(plotter, surface, across, spacing)


def draw_yarns(
    plotter: "pyvista.Plotter", surface: pyvista.PolyData, across: np.ndarray, spacing: float
) -> None:
    """Add a line each `spacing` [mm] of `across`, the distance (n,) of the nodes of a ply across
    its yarns on the flat ply [mm]."""
    low, high = np.ceil(across.min() / spacing), np.floor(across.max() / spacing)
    places = spacing * np.arange(low, high + 1)
    yarns = surface.contour(places, scalars=across).strip(max_length=100000)
    plotter.add_mesh(
        yarns.tube(radius=spacing / 28, n_sides=8), color="#30343b", smooth_shading=True
    )


def formed_picture(
    path: File,
    plies: Sequence[tuple[Grid, Sequence[float]]],
    tool: pyvista.PolyData | None = None,
    spacing: float = 10.0,
    full: bool = True,
    limit: float | None = None,
    view: Sequence[float] = (0.4, -1.0, 0.75),
) -> None:
    """The formed plies coloured by the magnitude of the shear angle, with yarns, over the tool:
    1600 x 1000 pixels.

    plies: grid, and angles of the families of yarns to x on the flat ply [deg], none of metal, the
    lowest first;
    of several each is cut away further than the one below. tool: its surface [pyvista.PolyData]
    where it is now. A line each `spacing` [mm] is a yarn. full: mirror a quarter. limit: of the
    colours [deg], by default the multiple of 5 deg that covers all (means over the cells around
    each node). view: direction from the ply to the camera. Raises InputError where VTK finds
    nothing to draw on.
    """
    fabrics = [grid["shear_angle"] for grid, _ in plies if "shear_angle" in grid.cell_data]
    largest = max(abs(np.degrees(shear)).max() for shear in fabrics)
    surfaces = [surface_of(grid, full) for grid, _ in plies]
    highest = max(surface["shear_angle"].max() for surface in surfaces)
    limit = limit or max(5.0, 5 * np.ceil(highest / 5))
    towards = np.array(view) / np.linalg.norm(view)
    with drawing() as plotter:
        for k, (surface, (_, angles)) in enumerate(zip(surfaces, plies)):
            shown = cut_away(surface, k / len(plies))
            draw_ply(plotter, shown, limit, angles if len(angles) else None, spacing)
        if tool is not None:
            # away from the camera, so that it looks the same but does not show through the ply
            plotter.add_mesh(
                tool.translate(-3 * towards),
                color="#d3d8e0",
                smooth_shading=True,
                ambient=0.35,
                diffuse=0.75,
            )
        plotter.view_vector(towards, viewup=(0, 0, 1))
        image = plotter.screenshot(None, return_img=True)
    rows, columns = (np.flatnonzero((image < 255).any((axis, 2))) for axis in (1, 0))
    figure = plt.figure(figsize=(16, 10))
    ax = figure.add_axes((0.02, 0.13, 0.96, 0.85))
    ax.imshow(image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], interpolation="lanczos")
    ax.axis("off")
    scale = ScalarMappable(Normalize(0, limit), COLOURS)
    bar = figure.colorbar(
        scale,
        cax=figure.add_axes((0.3, 0.09, 0.4, 0.022)),
        orientation="horizontal",
        extend="max" if largest > limit else "neither",
    )
    bar.set_label(
        f"magnitude of the shear angle / deg (largest of a cell: {largest:.2f})", fontsize=18
    )
    bar.ax.tick_params(labelsize=16)
    figure.savefig(path, dpi=100)
    plt.close(figure)
