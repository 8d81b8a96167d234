"""What one wants to see and measure of a formed ply: paths, outline and draw-in, wrinkles, pictures.

Every function takes the grid of a state, as `fields.read_last` gives it: undeformed places, `u` at the points, fields on
the cells. Nodes that several ranks wrote are merged. Other cells than triangles with nodes at their corners are cut into
these. The ply lies flat at first, and its centre is the origin; one in x >= 0 or y >= 0 alone is taken for the half
or quarter of a symmetric ply, whose edges on x = 0 and y = 0 are not free.
"""

import csv
import os
import pathlib
import subprocess
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pyvista
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.patches import Patch
from matplotlib.tri import LinearTriInterpolator, Triangulation
from vtkmodules.vtkCommonCore import vtkLogger

from ..errors import InputError
from ..tools import Tool
from ..tools.patches import vertex_normals
from .pictures import SHOWN, cells_range, colour_scale, plt

File: TypeAlias = pathlib.Path | str
Grid: TypeAlias = pyvista.UnstructuredGrid
SAME = 1e-6  # mm within which places are the same
STATES = {  # strain_state -> what it is, colour
    1: ("both in tension", "#3b6fb6"),
    2: ("a in tension, b in compression", "#f2b134"),
    3: ("a in compression, b in tension", "#5aa469"),
    4: ("both in compression", "#b83a3a"),
}
SCREEN = (2400, 1500)  # pixels drawn
COLOURS = "YlOrRd"  # light, so that the shading shows the shape


class _Ply(NamedTuple):
    """x, u (n, 3) [mm]: undeformed places of nodes and displacements; triangles (m, 3), anticlockwise on the flat ply;
    fields {name: (m,) or (m, 3)} on these; planes: axes to which a plane of symmetry is perpendicular."""

    x: np.ndarray
    u: np.ndarray
    triangles: np.ndarray
    fields: dict
    planes: list

    @property
    def formed(self) -> np.ndarray:
        return self.x + self.u

    def at_nodes(self, values: np.ndarray) -> np.ndarray:
        """Means (n,) of `values` (m,) over the cells that touch each node, by their areas on the flat ply."""
        touched, n = self.triangles.ravel(), len(self.x)
        area = _plan_area(self.x, self.triangles)
        return np.bincount(touched, np.repeat(area * values, 3), n) / np.bincount(touched, np.repeat(area, 3), n)


def _plan_area(x, triangles):
    """Areas (m,) in plan of `triangles`, negative where clockwise."""
    p, q, r = x[triangles, :2].swapaxes(0, 1)
    return np.linalg.det(np.stack([q - p, r - p], 1)) / 2


def _ply(grid):
    grid = grid.triangulate().clean(tolerance=SAME)
    triangles = grid.cells_dict[pyvista.CellType.TRIANGLE].astype(np.int64)
    x = np.array(grid.points, dtype=float)
    x[abs(x) < SAME] = 0  # a path on a plane of symmetry must not miss the ply by rounding
    clockwise = _plan_area(x, triangles) < 0
    triangles[clockwise] = triangles[clockwise, ::-1]
    fields = {name: np.asarray(values) for name, values in grid.cell_data.items()}
    planes = [axis for axis in (0, 1) if x[:, axis].min() == 0]
    return _Ply(x, np.asarray(grid.point_data["u"], dtype=float), triangles, fields, planes)


class Path(NamedTuple):
    """Values at the k points of a path, (k,) each: `distance` along it on the flat and `formed` on the formed ply [mm],
    logarithmic fibre strains [-] and shear angle [deg]."""

    distance: np.ndarray
    formed: np.ndarray
    log_eps_11: np.ndarray
    log_eps_22: np.ndarray
    shear_angle: np.ndarray


def along_paths(grid: Grid, angles_deg: Sequence[float] = (0, 45, 90), spacing: float = 5.0) -> dict[float, Path]:
    """{angle: `Path`} from the origin to the ply's edge, straight on the flat ply, at `angles_deg` to x; a point each `spacing` [mm]
    and one at the edge.

    A value is linear between the nodes of a cell, and at a node the mean over the cells around it by their areas (a mean over
    these cells is what Fig. 16 of the paper shows). On a plane of symmetry these are the cells on one side: a shear
    angle that the mirror reverses (yarns along x and y) is not 0 there, as the mean of both sides is, but what the cells
    beside the plane have. Raises InputError if the origin is not on the ply.
    """
    ply, fine = _ply(grid), 20  # points of the line on the formed ply for each point of the path
    plan = Triangulation(*ply.x[:, :2].T, ply.triangles)
    cell_at = plan.get_trifinder()
    formed = [LinearTriInterpolator(plan, x, cell_at) for x in ply.formed.T]
    factors = {"log_eps_11": 1.0, "log_eps_22": 1.0, "shear_angle": 180 / np.pi}
    values = [
        LinearTriInterpolator(plan, factor * ply.at_nodes(ply.fields[name]), cell_at)
        for name, factor in factors.items()
    ]
    paths = {}
    for angle in angles_deg:
        direction = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        s = np.arange(0, np.linalg.norm(ply.x[:, :2], axis=1).max() + spacing, spacing / fine)

        def outside(s, direction=direction * (1 - 1e-9)):  # the edge is not, by rounding
            return cell_at(*np.multiply.outer(direction, s)) < 0

        beyond = outside(s)
        if beyond[0]:
            raise InputError(
                "the ply does not cover the origin, where paths start; allowed is one about it, or a quarter from it"
            )
        low, high = s[beyond.argmax() - 1 : beyond.argmax() + 1]
        while high - low > SAME / 10:
            middle = (low + high) / 2
            low, high = (low, middle) if outside(np.array([middle]))[0] else (middle, high)
        s = np.append(s[: beyond.argmax()], low)
        places = s[:, None] * direction * (1 - 1e-9)
        line = np.column_stack([x(*places.T) for x in formed])
        length = np.append(0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
        k = np.arange(0, len(s) - 1, fine)
        k = np.append(k[s[-1] - s[k] > SAME * spacing], len(s) - 1)  # no point just before the one at the edge
        paths[angle] = Path(s[k], length[k], *(np.asarray(v(*places[k].T)) for v in values))
    return paths


def _edges(triangles):
    """Pairs of nodes (k, 2) of the sides that one of the `triangles` (m, 3) has alone, in its order."""
    sides = np.stack([triangles, np.roll(triangles, -1, 1)], 2).reshape(-1, 2)
    _, first, count = np.unique(np.sort(sides, 1), axis=0, return_index=True, return_counts=True)
    return sides[first[count == 1]]


def write_paths(path: File, paths: Mapping[float, Path]) -> None:
    """Write `along_paths` to a CSV file, a row a point."""
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(
            ["path_deg", "distance_mm", "formed_distance_mm", "log_eps_11", "log_eps_22", "shear_angle_deg"]
        )
        for angle, values in paths.items():
            writer.writerows([f"{angle:g}", *(f"{v:.8g}" for v in row)] for row in zip(*values))


def paths_picture(path: File, runs: Mapping[str, Mapping[float, Path]], marks: Mapping[str, Any] | None = None) -> None:  # fmt: skip
    """Strains and shear angle over the distance on the flat ply, a row a path, of runs {label: `along_paths`}.

    marks: {label: distances on the paths [mm], or one for all}, drawn as vertical lines where that is on the path; NaN
    for none.
    """
    angles = list(dict.fromkeys(angle for paths in runs.values() for angle in paths))
    figure, axes = plt.subplots(
        len(angles), 3, figsize=(11, 2.6 * len(angles) + 0.6), squeeze=False, sharex="row", sharey="col",
        layout="constrained",
    )  # fmt: skip
    for row, (mine, angle) in enumerate(zip(axes, angles)):
        end = max(paths[angle].distance[-1] for paths in runs.values() if angle in paths)
        for ax, (name, factor) in zip(mine, {"log_eps_11": 100, "log_eps_22": 100, "shear_angle": 1}.items()):
            for label, paths in runs.items():
                if angle in paths:
                    ax.plot(paths[angle].distance, factor * getattr(paths[angle], name), lw=1.4, label=label)
            for k, (label, at) in enumerate((marks or {}).items()):
                style = {"color": "0.45", "lw": 0.9, "ls": ("--", ":", "-.")[k % 3]}
                if (place := np.broadcast_to(at, len(angles))[row]) <= end:
                    ax.axvline(place, label=label, **style)
            ax.axhline(0, color="k", lw=0.5)
            ax.set_ylabel(SHOWN[name][0])
            ax.grid(alpha=0.25)
            ax.set_xlim(0, end)
        mine[1].set_title(
            f"path along {'y' if angle else 'x'}" if angle in (0, 90) else f"path at {angle:g}°", fontsize="medium"
        )
    for ax in axes[-1]:
        ax.set_xlabel("distance on the flat ply / mm")
    legend = {label: line for ax in axes[:, 0] for line, label in zip(*ax.get_legend_handles_labels())}
    labels, handles = list(legend), list(legend.values())
    if len(labels) > 1:
        figure.get_layout_engine().set(rect=(0, 0, 1, 1 - 0.35 / figure.get_figheight()))
        figure.legend(handles, labels, loc="upper center", ncol=len(labels), frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


class Outline(NamedTuple):
    """A free edge of the ply, anticlockwise: undeformed and formed places (n, 3) [mm] and the way `inwards` (n,) [mm] that
    it went in plan, along the undeformed edge's normal (at corners the mean of both). A closed one ends where it starts."""

    undeformed: np.ndarray
    formed: np.ndarray
    inwards: np.ndarray


def outline(grid: Grid) -> list[Outline]:
    """The free edges of the ply [list of `Outline`], without those on planes of symmetry."""
    ply = _ply(grid)
    sides = _edges(ply.triangles)
    for axis in ply.planes:
        sides = sides[ply.x[sides, axis].any(1)]
    after = dict(sides.tolist())
    starts = sorted(after.keys() - after.values())
    edges = []
    while after:
        edge = [starts.pop() if starts else next(iter(after))]
        while edge[-1] in after:
            edge.append(after.pop(edge[-1]))
        x, u = ply.x[edge], ply.u[edge]
        along = np.diff(x[:, :2], axis=0)
        outwards = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
        ends = (outwards[-1], outwards[0]) if edge[0] == edge[-1] else (outwards[0], outwards[-1])
        normal = np.vstack([ends[0], outwards]) + np.vstack([outwards, ends[1]])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        edges.append(Outline(x, x + u, -(u[:, :2] * normal).sum(1)))
    return edges


def draw_in(grid: Grid) -> dict[str, Any]:
    """How far the edge went inwards in plan [mm], as in `Outline`: {name: value} at the middle of the long and of the short
    side, at the corner, each the mean of those that the grid has, and the largest of all points of the edge."""
    edges = outline(grid)
    place, inwards = (np.concatenate([getattr(edge, name) for edge in edges]) for name in ("undeformed", "inwards"))
    place = abs(place[:, :2])
    half = place.max(0)
    long, short = half * np.eye(2)[[1, 0]] if half[0] >= half[1] else half * np.eye(2)
    found = {}
    for name, at in {"middle_of_long_side": long, "middle_of_short_side": short, "corner": half}.items():
        distance = np.linalg.norm(place - at, axis=1)
        found[f"{name}_mm"] = float(inwards[distance < distance.min() + SAME].mean())
    return found | {"largest_mm": float(inwards.max())}


def outline_picture(path: File, runs: Mapping[str, Grid]) -> None:
    """The edges of the ply in plan, flat and formed, of runs {label: grid}."""
    figure, ax = plt.subplots(figsize=(8, 5), layout="constrained")
    for k, (label, grid) in enumerate(runs.items()):
        for n, edge in enumerate(outline(grid)):
            if k == 0:
                ax.plot(*edge.undeformed[:, :2].T, "--", color="0.5", lw=1.2, label=None if n else "flat")
            ax.plot(*edge.formed[:, :2].T, color=f"C{k}", lw=1.6, label=None if n else label)
    ax.set_aspect("equal")
    ax.set_xlabel("x / mm")
    ax.set_ylabel("y / mm")
    ax.grid(alpha=0.25)
    ax.legend(loc="center", frameon=False)
    figure.savefig(path, dpi=130)
    plt.close(figure)


def contrast(grid: Grid, name: str) -> float:
    """Root mean square of how far the cells' field `name` is from the mean about them: what bands one or two cells wide
    have and smooth fields do not, in the field's unit."""
    ply = _ply(grid)
    values = ply.fields[name]
    return float(np.sqrt(np.mean((values - ply.at_nodes(values)[ply.triangles].mean(1)) ** 2)))


def wrinkles(
    grid: Grid, tool: Tool, thickness: float = 0.0, region: Callable[[np.ndarray], np.ndarray] | None = None
) -> dict[str, Any]:
    """How far the formed ply is from lying on `tool` (whose `evaluate` is that of `tools.Surface`): {name: value}.

    height [mm]: distance of the ply's mid-surface from the tool's surface, less half the `thickness`; 0 where it lies on
    the tool, the amplitude of a wave about it. slope [deg]: angle between the normals of the ply and of the tool at
    its nearest point; 0 where the ply is parallel to the tool, however far, and arctan(2 pi amplitude / length) at most in a
    wave. Of each the largest at a node and the r.m.s. over the formed area. Both converge as the mesh is refined (unlike
    the angle between neighbouring cells) and vanish on the tool's own curvature. Height is what F. Yu et al.,
    Composites A 143 (2021) 106308, measure; as theirs it counts a ply that bridges a hollow without a wrinkle, so leave
    such places out: region, a function of formed places (n, 3) [mm] to bool (n,), says which nodes count. So do only
    those for which the tool finds a nearest point. Raises InputError if no node is left.
    """
    ply = _ply(grid)
    x = ply.formed
    near = tool.evaluate(x)
    normal = vertex_normals(x, ply.triangles)
    for axis in ply.planes:  # as the mirrored cells would make it
        normal[ply.x[:, axis] == 0, axis] = 0
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    p, q, r = x[ply.triangles].swapaxes(0, 1)
    cell_area = np.linalg.norm(np.cross(q - p, r - p), axis=1) / 2
    area = np.bincount(ply.triangles.ravel(), np.repeat(cell_area / 3, 3), len(x))
    counts = np.isfinite(near.gap) if region is None else np.isfinite(near.gap) & region(x)
    if not counts.any():
        raise InputError("no node of the ply is in the region of wrinkles; allowed is a region with one at least")
    area, height = area[counts], near.gap[counts] - thickness / 2
    cosine = (normal * near.normal).sum(1)[counts]
    cosine *= np.sign(area @ cosine)  # the ply may lie on either side of the tool
    slope = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    found = {}
    for name, values in (("height_{}_mm", abs(height)), ("slope_{}_deg", slope)):
        found[name.format("largest")] = float(values.max())
        found[name.format("rms")] = float(np.sqrt(np.average(values**2, weights=area)))
    return found


def state_map(path: File, grid: Grid, formed: bool = False) -> None:
    """Plan maps of the strain states of eq. (13) and of the shear angle, on the flat or the formed ply.

    The legend gives each state's share of the flat ply's area.
    """
    ply = _ply(grid)
    corners = (ply.formed if formed else ply.x)[ply.triangles, :2]
    area, state = _plan_area(ply.x, ply.triangles), ply.fields["strain_state"]
    label, factor, colours = SHOWN["shear_angle"]
    shear = factor * ply.fields["shear_angle"]
    colours, *limits = colour_scale(colours, shear.min(), shear.max())
    figure, axes = plt.subplots(1, 2, figsize=(13, 5), sharex=True, sharey=True, layout="constrained")
    kinds = ListedColormap([colour for _, colour in STATES.values()])
    for ax, values, cmap, clim in ((axes[0], state, kinds, (0.5, 4.5)), (axes[1], shear, colours, limits)):
        cells = PolyCollection(corners, array=values, cmap=cmap, antialiased=False)
        cells.set_clim(*clim)
        ax.add_collection(cells)
        ax.autoscale_view()
        ax.margins(0.02)
        ax.set_aspect("equal")
        ax.set_xlabel("x / mm")
    axes[0].set_ylabel("y / mm")
    shares = {k: area[state == k].sum() / area.sum() for k in STATES}
    axes[0].legend(
        handles=[Patch(color=colour, label=f"{name}: {shares[k]:.0%}") for k, (name, colour) in STATES.items()],
        loc="upper center", bbox_to_anchor=(0.5, -0.15), ncol=2, frameon=False,
    )  # fmt: skip
    axes[1].set_title(cells_range(shear), fontsize="small")
    figure.colorbar(cells, ax=axes[1], label=label, location="bottom", shrink=0.8, aspect=30)
    figure.savefig(path, dpi=130)
    plt.close(figure)


@contextmanager
def _screen():
    """Where VTK can draw: a screen of its own if it needs one that is not there."""
    if os.environ.get("DISPLAY") or pyvista.vtk_version_info >= (9, 4):  # that and later draw without one, by EGL
        yield
        return
    missing = InputError("this VTK draws on a screen only; allowed is DISPLAY set, or Xvfb (apt install xvfb)")
    try:
        server = subprocess.Popen(
            ["Xvfb", "-displayfd", "1", "-screen", "0", "{}x{}x24".format(*SCREEN), "-nolisten", "tcp"],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
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


def _surface(ply, full):
    """The formed ply [pyvista.PolyData] with the nodes' `place` on the flat one and `shear_angle` [deg], its magnitude;
    full: with the images in the planes of symmetry."""
    x, formed, triangles = ply.x, ply.formed, ply.triangles
    shear = ply.at_nodes(abs(np.degrees(ply.fields["shear_angle"])))
    for axis in ply.planes if full else ():
        off = np.flatnonzero(x[:, axis])
        image = np.arange(len(x))
        image[off] = len(x) + np.arange(len(off))
        mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
        x, formed = (np.vstack([p, p[off] * mirror]) for p in (x, formed))
        shear = np.append(shear, shear[off])
        triangles = np.vstack([triangles, image[triangles][:, ::-1]])
    surface = pyvista.PolyData.from_regular_faces(formed, triangles)
    surface.point_data["place"], surface.point_data["shear_angle"] = x, shear
    return surface


def formed_picture(
    path: File,
    grid: Grid,
    tool: pyvista.PolyData | None = None,
    fibre_angles_deg: Sequence[float] = (0, 90),
    spacing: float = 10.0,
    full: bool = True,
    limit: float | None = None,
    view: Sequence[float] = (0.4, -1.0, 0.75),
) -> None:
    """The formed ply coloured by the magnitude of the shear angle, with yarns, over the tool: 1600 x 1000 pixels.

    tool: its surface [pyvista.PolyData] where it is now. fibre_angles_deg: of the families of yarns to x on the flat ply; a
    line each `spacing` [mm]. full: mirror a quarter. limit: of the colours [deg], by default the
    multiple of 5 deg that covers all (means over the cells around each node).
    view: direction from the ply to the camera. Raises InputError where VTK finds nothing to draw on.
    """
    ply = _ply(grid)
    largest = abs(np.degrees(ply.fields["shear_angle"])).max()
    ply = _surface(ply, full)
    limit = limit or max(5.0, 5 * np.ceil(ply["shear_angle"].max() / 5))
    towards = np.array(view) / np.linalg.norm(view)
    with _screen():
        verbosity = vtkLogger.GetCurrentVerbosityCutoff()
        vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # VTK warns of no screen before it does without
        plotter = pyvista.Plotter(off_screen=True, window_size=SCREEN)
        plotter.set_background("white")
        plotter.add_mesh(
            ply, scalars="shear_angle", cmap=COLOURS, clim=(0, limit), show_scalar_bar=False,
            smooth_shading=True, ambient=0.25, diffuse=0.8, specular=0.15,
        )  # fmt: skip
        for angle in np.radians(fibre_angles_deg):
            across = ply["place"] @ [-np.sin(angle), np.cos(angle), 0]
            low, high = np.ceil(across.min() / spacing), np.floor(across.max() / spacing)
            yarns = ply.contour(spacing * np.arange(low, high + 1), scalars=across).strip(max_length=100000)
            plotter.add_mesh(yarns.tube(radius=spacing / 28, n_sides=8), color="#30343b", smooth_shading=True)
        if tool is not None:
            # away from the camera, so that it looks the same but does not show through the ply
            plotter.add_mesh(
                tool.translate(-3 * towards), color="#d3d8e0", smooth_shading=True, ambient=0.35, diffuse=0.75
            )
        plotter.view_vector(towards, viewup=(0, 0, 1))
        image = plotter.screenshot(None, return_img=True)
        plotter.close()
        vtkLogger.SetStderrVerbosity(verbosity)
    rows, columns = (np.flatnonzero((image < 255).any((axis, 2))) for axis in (1, 0))
    figure = plt.figure(figsize=(16, 10))
    ax = figure.add_axes((0.02, 0.13, 0.96, 0.85))
    ax.imshow(image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1], interpolation="lanczos")
    ax.axis("off")
    scale = ScalarMappable(Normalize(0, limit), COLOURS)
    bar = figure.colorbar(scale, cax=figure.add_axes((0.3, 0.09, 0.4, 0.022)), orientation="horizontal")
    bar.set_label(f"magnitude of the shear angle / deg (largest of a cell: {largest:.2f})", fontsize=18)
    bar.ax.tick_params(labelsize=16)
    figure.savefig(path, dpi=100)
    plt.close(figure)
