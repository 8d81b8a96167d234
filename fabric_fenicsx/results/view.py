"""Formed plies and tools in a window of PyVista, or as a page that a browser shows without a
network."""

import io
import json
import re
import zipfile
from html import escape
from pathlib import Path

import numpy as np
import pyvista

from ..core.errors import InputError
from .pictures import shown
from .ply import check_field, ply_of, whole
from .space import COLOURS, STEEL, VIEW, drawing, mirrored
from .states import states, units


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
    plies, planes = {}, list[int]()
    for name, grid in state.plies().items():
        ply = ply_of(grid)
        planes = ply.planes
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
        missing = "a page for a browser needs the package trame-vtk, which is not installed"
        allowed = "`pip install 'fabric_fenicsx[view]'` first"
        raise InputError(f"{missing}; allowed is {allowed}") from None

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
