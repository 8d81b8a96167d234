"""Formed plies and tools in space: pictures, a window of PyVista, and a page that a browser shows
without a network."""

import io
import json
import os
import re
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from pathlib import Path

import numpy as np
import pyvista
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from scipy.spatial import cKDTree
from vtkmodules.vtkCommonCore import vtkLogger

from ..core.errors import InputError
from ..surfaces.facets import unit
from .ply import SAME, Grid, check_field, mark_planes, marked_planes, ply_of, whole
from .states import states, units

# field -> label, factor to the unit shown, colour map; no label has an index 1 or 2, which beside
# axes x and y looks like theirs
SHOWN = {
    "log_eps_11": ("log strain\nalong yarns a / %", 100.0, "viridis"),
    "log_eps_22": ("log strain\nalong yarns b / %", 100.0, "viridis"),
    "shear_angle": ("shear angle / deg", 180 / np.pi, "coolwarm"),
    "shortening_a": ("shortening\nof yarns a / %", 100.0, "magma_r"),
    "shortening_b": ("shortening\nof yarns b / %", 100.0, "magma_r"),
    "wrinkle_height": ("height of wrinkles / mm", 1.0, "coolwarm"),
    "thickness_under_pressure": ("thickness\nunder pressure / mm", 1.0, "viridis"),
    "error_log_eps_11": ("error of log strain\nalong yarns a / %", 100.0, "magma_r"),
    "error_log_eps_22": ("error of log strain\nalong yarns b / %", 100.0, "magma_r"),
    "error_shear_angle": ("error of\nshear angle / deg", 180 / np.pi, "magma_r"),
    "ellipticity_lost": ("ellipticity lost (1) or not", 1.0, "Greys"),
    "strain_state": ("strain state", 1.0, "Set2"),
}
COLOURS = "YlOrRd"  # light, so that the shading shows the shape
STEEL, YARNS = "#8f9aa8", "#30343b"
VIEW = 0.45, -1.0, 0.55  # from the blank to the camera


@contextmanager
def drawing() -> Iterator[pyvista.Plotter]:
    """A plotter without a window. Raises InputError where VTK finds nothing to draw on."""
    # from 9.4 on it draws without a screen, by EGL
    if not os.environ.get("DISPLAY") and pyvista.vtk_version_info < (9, 4):
        flaw = "this VTK needs a display"
        raise InputError(f"{flaw}; expected `xvfb-run -a` before the command, or --no-pictures")
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    # VTK warns of no screen before it does without
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    plotter = pyvista.Plotter(off_screen=True, window_size=(2400, 1500))
    try:
        plotter.set_background("white")
        yield plotter
    finally:
        plotter.close()
        vtkLogger.SetStderrVerbosity(verbosity)


def image(
    draw: Callable[[pyvista.Plotter], None],
    view: Sequence[float],
    bounds: Sequence[float] | None = None,
) -> np.ndarray:
    """Pixels (rows, columns, 3) of what `draw` adds to a plotter, seen from the direction `view`,
    without the white around it; bounds: to show, with bodies that are translucent."""
    with drawing() as plotter:
        if bounds is not None:
            plotter.disable_anti_aliasing()  # with it depth peeling loses what is translucent
            # not by PyVista, whose check opens a window of its own: that ended the process on
            # Debian 13
            plotter.ren_win.AlphaBitPlanesOn()
            plotter.renderer.SetUseDepthPeeling(True)
            plotter.renderer.SetMaximumNumberOfPeels(8)
        draw(plotter)
        plotter.view_vector(unit(np.array(view)), viewup=(0, 0, 1))
        if bounds is not None:
            plotter.reset_camera(bounds=bounds)
            plotter.renderer.ResetCameraClippingRange()  # what is beyond the bounds is drawn, too
        pixels = plotter.screenshot(None, return_img=True)
    drawn = (pixels < 255).any(2)
    rows, columns = np.flatnonzero(drawn.any(1)), np.flatnonzero(drawn.any(0))
    return pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def surface_of(grid: Grid, full: bool = True, formed: bool = True) -> pyvista.PolyData:
    """The ply, formed or flat, with the nodes' `place` on the flat one, the size of the
    `shear_angle` [deg] and, if known, the distance across yarns, `yarn_a` and `yarn_b` [mm]; full:
    with images in the planes of symmetry."""
    ply = ply_of(grid)
    planes = ply.planes if full else {}
    ply = whole(ply) if full else ply
    shear = abs(np.degrees(ply.fields.get("shear_angle", np.zeros(len(ply.cells)))))
    points = ply.formed if formed else ply.x
    surface = pyvista.PolyData.from_regular_faces(points, ply.cells)
    surface.point_data["place"] = ply.x
    surface.point_data["shear_angle"] = ply.at_nodes(shear)
    mark_planes(surface, planes)
    if "yarn_coordinate_a" in grid.point_data and "shear_angle" in grid.cell_data:
        place = ply.x.copy()
        for axis, at in planes.items():
            place[:, axis] = at + abs(place[:, axis] - at)
        nearest = cKDTree(grid.points).query(place)[1]
        for family in "ab":
            across = grid.point_data[f"yarn_coordinate_{family}"]
            surface.point_data[f"yarn_{family}"] = across[nearest]
    return surface


def mirrored(surface: pyvista.PolyData, planes: Mapping[int, float]) -> pyvista.PolyData:
    """The part of a surface beyond planes of symmetry {axis: place}, and its images."""
    for axis, at in planes.items():
        normal = np.eye(3)[axis]
        half = surface.clip(normal=normal, origin=at * normal, invert=False).triangulate()
        points, faces = np.array(half.points), half.faces.reshape(-1, 4)[:, 1:]
        points[abs(points[:, axis] - at) < SAME, axis] = at
        points = np.vstack([points, points * (1 - 2 * normal) + 2 * at * normal])
        faces = np.vstack([faces, faces[:, ::-1] + half.n_points])
        surface = pyvista.PolyData.from_regular_faces(points, faces).clean()
    return surface


def cut_away(surface: pyvista.PolyData, share: float, end: float = 1.0) -> pyvista.PolyData:
    """A ply, as of `surface_of`, between these shares of its length, from its lower end."""
    x = surface["place"][:, 0]
    surface["along"] = x
    for part, beyond in ((share, False), (end, True)):
        if 0 < part < 1:
            place = float(x.min() + part * np.ptp(x))
            surface = surface.clip_scalar(scalars="along", invert=beyond, value=place)
    return surface


def draw_plies(
    plotter: pyvista.Plotter, surfaces: Sequence[pyvista.PolyData], limit: float, spacing: float
) -> None:
    """Add plies, as of `surface_of`, the lowest first, each cut away further than the one below.
    Fabric is coloured by its shear angle up to `limit` [deg], with a yarn each `spacing` [mm];
    metal is grey."""
    light = {"ambient": 0.25, "diffuse": 0.8, "specular": 0.15, "smooth_shading": True}
    shear = {"scalars": "shear_angle", "cmap": COLOURS, "clim": (0, limit)}
    for k, surface in enumerate(surfaces):
        upper = cut_away(surface, k / len(surfaces))
        families = {"yarn_a", "yarn_b"} & set(surface.point_data)
        look = shear if families else {"color": STEEL}
        plotter.add_mesh(upper, show_scalar_bar=False, **light, **look)
        # below the next ply yarns poke through
        seen = cut_away(surface, k / len(surfaces), (k + 1) / len(surfaces))
        for across in (seen[name] + spacing / 2 for name in sorted(families)):  # none on a mirror
            low, high = np.ceil(across.min() / spacing), np.floor(across.max() / spacing)
            places = spacing * np.arange(low, high + 1)
            yarns = seen.contour(places, scalars=across).strip(max_length=100000)
            tubes = yarns.tube(radius=spacing / 28, n_sides=8)
            plotter.add_mesh(tubes, color=YARNS, smooth_shading=True)


def round_length(about: float) -> float:
    """The length [mm] nearest to one that is 1, 2 or 5 times a power of ten."""
    lengths = [10.0**k * n for k in range(-2, 5) for n in (1, 2, 5)]
    return min(lengths, key=lambda length: abs(np.log(length / about)))


def extent_of(surfaces: Iterable[pyvista.PolyData]) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest corner (3,) of all surfaces [mm]."""
    ends = np.array([surface.bounds for surface in surfaces]).reshape(-1, 3, 2)
    return ends[:, :, 0].min(0), ends[:, :, 1].max(0)


def draw_axes(plotter: pyvista.Plotter, surfaces: Sequence[pyvista.PolyData]) -> None:
    """Add arrows along x, y and z beside the lowest corner of plies, with their length."""
    low, high = extent_of(surfaces)
    length = round_length(0.12 * (high - low).max())
    start = low - 0.5 * length * np.array([1.0, 1.0, 0.0])
    for along in np.eye(3):
        arrow = pyvista.Arrow(start=start, direction=along, scale=length, shaft_radius=0.03)
        plotter.add_mesh(arrow, color=YARNS)
    tips, names = start + 1.15 * length * np.eye(3), ["x", "y", f"z, {length:g} mm"]
    look = {"shape": None, "show_points": False, "always_visible": True, "bold": False}
    plotter.add_point_labels(tips, names, font_size=28, text_color=YARNS, **look)


def shear_limit(surfaces: Iterable[pyvista.PolyData]) -> float:
    """End of the colours that cover the shear angles of plies, a multiple of 5 deg."""
    highest = max(surface["shear_angle"].max() for surface in surfaces)
    return max(5.0, 5 * np.ceil(highest / 5))


def formed_picture(
    path: Path | str,
    plies: Sequence[Grid],
    tool: pyvista.PolyData | None = None,
    spacing: float = 10.0,
    full: bool = True,
) -> None:
    """The formed plies, the lowest first, each cut away further than the one below, coloured by the
    magnitude of the shear angle, with a yarn each `spacing` [mm], over the tool: 1600 x 1000
    pixels. full: mirror a half or quarter."""
    fabrics = [grid["shear_angle"] for grid in plies if "shear_angle" in grid.cell_data]
    largest = max(abs(np.degrees(shear)).max() for shear in fabrics)
    surfaces = [surface_of(grid, full) for grid in plies]
    view, limit = (0.4, -1.0, 0.75), shear_limit(surfaces)

    def draw(plotter):
        draw_plies(plotter, surfaces, limit, spacing)
        draw_axes(plotter, surfaces)
        if tool is not None:
            whole = mirrored(tool, marked_planes(surfaces[0]))
            # away from the camera, so that it looks the same but does not show through the ply
            behind = whole.translate(-3 * unit(np.array(view)))
            look = {"color": "#d3d8e0", "ambient": 0.35, "diffuse": 0.75}
            plotter.add_mesh(behind, smooth_shading=True, **look)

    page = Figure(figsize=(16, 10))
    ax = page.add_axes((0.02, 0.13, 0.96, 0.85))
    ax.imshow(image(draw, view), interpolation="lanczos")
    ax.axis("off")
    extend = "max" if largest > limit else "neither"  # as nodes have means over cells
    scale = ScalarMappable(Normalize(0, limit), COLOURS)
    place = {"cax": page.add_axes((0.3, 0.09, 0.4, 0.022)), "orientation": "horizontal"}
    bar = page.colorbar(scale, extend=extend, **place)
    words = f"magnitude of the shear angle / deg (largest of a cell: {largest:.2f})"
    bar.set_label(words, fontsize=18)
    bar.ax.tick_params(labelsize=16)
    page.savefig(path, dpi=100)


def shown(name: str, unit: str = "") -> tuple[str, float, str]:
    """Label, factor to the unit shown and colour map of a field; unit: of one not in `SHOWN`."""
    plain = " / ".join(filter(None, (name.replace("_", " "), unit)))
    return SHOWN.get(name, (plain, 1.0, "viridis"))


def page(folder: Path | str, field: str | None = None) -> str:
    """HTML of the last state in the results `folder`, with all that draws it (vtk.js, out of the
    package trame-vtk) in it. field: on the plies, by default the shear angle. Raises InputError
    without that package, for a folder without states, and for a field that no ply has."""
    write_html, serialized = _exporter()
    written = states(folder)
    with drawing() as plotter:
        _draw(plotter, folder, written[-1], field)
        plotter.render()
        data = io.BytesIO()
        with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr("index.json", json.dumps(serialized(plotter)))
    text = io.StringIO()
    write_html(data.getvalue(), text)
    title = f"<title>{escape(Path(folder).resolve().name)}</title>"
    return re.sub(r"<title>.*?</title>", lambda _: title, text.getvalue(), count=1)


def show(folder: Path | str, field: str | None = None) -> None:
    """Open a window with the last state in the results `folder` and a slider over all states, until
    it is closed. field: on the plies, by default the shear angle. Raises InputError as `page`."""
    written = states(folder)
    plotter = pyvista.Plotter(window_size=[1200, 800], title=f"fabric view {folder}")
    update = _draw(plotter, folder, written[-1], field)
    if len(written) > 1:
        last, place = len(written) - 1, {"pointa": (0.3, 0.93), "pointb": (0.7, 0.93)}
        change = lambda value: update(written[round(value)])  # noqa: E731
        plotter.add_slider_widget(change, (0, last), last, title="state", fmt="%.0f", **place)
    plotter.show()


def _draw(plotter, folder, state, field):
    """Add a state to a plotter; the function that shows another one there in the same colours."""
    field = _known(field, state.plies())
    label, factor, colours = shown(field, units(folder).get(field, ""))
    surfaces, _ = _surfaces(state, field, factor)
    values = np.concatenate([s["shown"] for s in surfaces.values() if "shown" in s.array_names])
    limits = np.nanmin(values), np.nanmax(values)
    if field == "shear_angle":
        label, colours, limits = f"magnitude of the {label}", COLOURS, (0.0, limits[1])
    bar = {"title": label.replace("\n", " "), "color": "k", "vertical": False}
    bar |= {"width": 0.5, "position_x": 0.25, "position_y": 0.03}
    matt = {"ambient": 0.25, "diffuse": 0.75, "reset_camera": False}
    clear = {"color": "#6b7a8f", "opacity": 0.12, "reset_camera": False}
    clear |= {"smooth_shading": True, "split_sharp_edges": True}
    coloured = {"scalars": "shown", "cmap": colours, "clim": limits, "scalar_bar_args": bar}

    def update(other):
        surfaces, tools = _surfaces(other, field, factor)
        for name, surface in surfaces.items():
            look = coloured if "shown" in surface.array_names else {"color": STEEL}
            plotter.add_mesh(surface, name=f"ply {name}", **matt, **look)
        for name, surface in tools.items():
            plotter.add_mesh(surface, name=f"tool {name}", **clear)

    update(state)
    plotter.set_background("white")
    plotter.view_vector(VIEW, viewup=(0, 0, 1))
    plotter.camera.zoom(1.3)
    return update


def _surfaces(state, field, factor):
    """Plies {name: surface}, with the field as `shown` if they have it, and tools."""
    plies, planes = {}, dict[int, float]()
    for name, grid in state.plies().items():
        ply = ply_of(grid)
        planes = dict(ply.planes)
        ply = whole(ply)
        plies[name] = pyvista.PolyData.from_regular_faces(ply.formed, ply.cells)
        if field in ply.fields:
            values = factor * ply.fields[field]
            plies[name].cell_data["shown"] = abs(values) if field == "shear_angle" else values
    return plies, {name: mirrored(tool, planes) for name, tool in state.tools().items()}


def _known(field, plies):
    data = {name: values for grid in plies.values() for name, values in grid.cell_data.items()}
    fields = [name for name, values in data.items() if np.ndim(values) == 1]
    usual = "shear_angle", "equivalent_plastic_strain", *fields
    field = field or next(name for name in usual if name in fields)
    check_field(field, data)
    return field


def _exporter():
    """trame-vtk's `write_html`, and a function from a plotter to what that writes."""
    try:
        from trame_vtk.modules.vtk import serializers
        from trame_vtk.tools.vtksz2html import write_html
    except ImportError:
        missing = "a web page needs the package trame-vtk, which is not installed"
        allowed = "`pip install 'fabric_fenicsx[view]'` first"
        raise InputError(f"{missing}; expected {allowed}") from None

    def serialized(plotter):
        """The scene, and the arrays that it names."""
        serializers.initialize_serializers()
        window, camera = plotter.ren_win, plotter.camera
        context = serializers.SynchronizationContext()
        context.set_ignore_last_dependencies(True)  # all of it, not what has changed
        number = serializers.reference_id
        scene = serializers.serialize(None, window, number(window), context, 1)
        scene["extra"] = {
            "vtkRefId": number(window),
            "centerOfRotation": camera.GetFocalPoint(),
            "camera": number(camera),
        }
        arrays, content = serializers.extract_array_hash(scene), context.get_cached_data_array
        hashes = {a["hash"]: a | {"content": content(a["hash"], False)} for a in arrays}
        return {"hashes": hashes, "scene": scene}

    return write_html, serialized
