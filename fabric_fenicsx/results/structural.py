"""Formed plies with thickness and yarn directions, for a structural analysis: VTU, Abaqus, LS-DYNA
and Nastran."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.files import ending, replace_file
from ..surfaces.facets import unit
from ..surfaces.tool import Frame
from .ply import SAME, Grid, Ply, areas, grid_of, in_frame, planes_of, whole
from .states import combined, save, set_labels


def formed_ply(grid: Grid, modelled: bool = False) -> Ply:
    """The formed ply of a grid as `Result.grids` has it, with its images in the planes of symmetry,
    unless `modelled`; cells of any degree by their corners, anticlockwise about the normal. Fields:
    `area_ratio`, `thickness` [mm] if known, and with yarns unit vectors `yarn_a`, `yarn_b`,
    `normal` (from which b is anticlockwise of a), and `shear_angle` [rad]."""
    # of VTK's cells, which begin with them
    corners = {5: 3, 69: 3, 9: 4, 70: 4}[int(grid.celltypes[0])]
    cells = grid.cell_connectivity.reshape(grid.n_cells, -1)[:, :corners]
    x, u = (np.asarray(each, dtype=float) for each in (grid.points, grid.point_data["u"]))
    merged = grid_of(x, cells, u).clean(tolerance=SAME)
    ((_, cells),) = merged.cells_dict.items()
    x, u = np.asarray(merged.points), np.asarray(merged.point_data["u"])
    cells, points, fields = cells.astype(np.int64), x + u, {}
    # not VTK's compute_cell_sizes, which crashed on Debian 13
    ratio = areas(points[cells]) / areas(x[cells])
    if "a" in grid.cell_data:
        a, b = (unit(np.asarray(grid.cell_data[name], dtype=float)) for name in "ab")
        fields = {"yarn_a": a, "yarn_b": b, "normal": unit(np.cross(a, b))}
        fields["shear_angle"] = np.asarray(grid.cell_data["shear_angle"])
        p, q, r = points[cells[:, 0]], points[cells[:, 1]], points[cells[:, -1]]
        behind = (np.cross(q - p, r - p) * fields["normal"]).sum(1) < 0
        cells[behind] = cells[behind, ::-1]
    for name in ("thickness_under_pressure", "metal_thickness"):
        if name in grid.cell_data:
            fields["thickness"] = np.asarray(grid.cell_data[name])
    ply = Ply(x, u, cells, fields | {"area_ratio": ratio}, {})
    for axis, at in () if modelled else planes_of(grid).items():
        half, ply = ply, whole(ply._replace(planes={axis: at}))
        for name, values in _yarns_of_image(half, axis).items() if "yarn_a" in fields else ():
            ply.fields[name] = np.concatenate([half.fields[name], values])
    return ply


def _yarns_of_image(ply, axis):
    """Yarns and shear angle of the image of a ply in the plane perpendicular to `axis`. The image
    of yarns at 45 deg runs along the others; a yarn keeps its name and sense over the plane."""
    mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
    a, b = ply.fields["yarn_a"] * mirror, ply.fields["yarn_b"] * mirror
    p, q, r = (ply.cells[:, k] for k in (0, 1, -1))
    sides, before = (np.stack([x[q] - x[p], x[r] - x[p]], 1) for x in (ply.formed, ply.x))
    square = sides @ sides.swapaxes(1, 2)
    flat = []  # directions of yarns on the flat ply
    for yarn in (ply.fields["yarn_a"], ply.fields["yarn_b"]):
        shares = np.linalg.solve(square, (sides @ yarn[:, :, None]))
        flat.append(unit((shares * before).sum(1)))
    along, across = (abs((flat[0] * mirror * each).sum(1)).mean() for each in flat)
    swapped, images = across > along, [(a, flat[0] * mirror), (b, flat[1] * mirror)]
    a, b = (
        yarn * np.sign((image * old).sum(1))[:, None]
        for (yarn, image), old in zip(images[::-1] if swapped else images, flat)
    )
    shear = ply.fields["shear_angle"] * (1 if swapped else -1)
    return {"yarn_a": a, "yarn_b": b, "shear_angle": shear}


def export(
    grids: Mapping[str, Grid], path: Path | str, modelled: bool = False, frame: Frame | None = None
) -> dict[str, Ply]:
    """Write the formed plies {name: grid} with their yarn directions, mirrored in the planes of
    symmetry unless `modelled`, to `path`, in the format that its ending says, in coordinates
    `frame`; returns them. Raises InputError for another ending, and for plies of unknown thickness,
    but in .vtu and .inp."""
    path, writers = Path(path), {".inp": _abaqus, ".k": _dyna, ".key": _dyna}
    writers |= {".bdf": _nastran, ".nas": _nastran}
    if ending(path) not in (".vtu", *writers):
        allowed = f".vtu, {', '.join(writers)} (VTK, Abaqus, LS-DYNA, Nastran)"
        raise InputError(f"the extension of {path} is unknown; expected {allowed}")
    plies = {name: in_frame(formed_ply(g, modelled), frame) for name, g in grids.items()}
    if ending(path) == ".vtu":
        units = dict.fromkeys(("yarn_a", "yarn_b", "normal", "area_ratio", "part"), "-")
        units |= {"shear_angle": "rad", "thickness": "mm"}
        parts = [grid_of(ply.formed, ply.cells, 0 * ply.formed) for ply in plies.values()]
        for number, (part, ply) in enumerate(zip(parts, plies.values())):
            part.clear_point_data()
            part.cell_data.update(ply.fields)
            part.cell_data["part"] = np.full(len(ply.cells), number, dtype=np.int32)
        save(path, combined(parts), units, portable=True)
        return plies
    unknown = [name or "the ply" for name, ply in plies.items() if "thickness" not in ply.fields]
    if unknown and ending(path) != ".inp":
        flaw = f"the thickness of {unknown[0]} is not known, which {path} needs"
        raise InputError(f"{flaw}; expected results of a run with tools, or .inp and .vtu")
    replace_file(path, "".join(writers[ending(path)](plies)))
    return plies


def _numbered(plies):
    """Label and ply, with the numbers of its nodes and cells, and its cells by these numbers."""
    node = element = 1
    for name, label in set_labels(plies).items():
        ply = plies[name]
        numbers = element + np.arange(len(ply.cells))
        yield label, ply, node + np.arange(len(ply.formed)), numbers, ply.cells + node
        node, element = node + len(ply.formed), element + len(ply.cells)


def _abaqus(plies):
    yield "** formed plies with their yarn directions, by fabric_fenicsx; mm, deg\n"
    tables = {"yarn_axes": "COORD3D, COORD3D", "length": "LENGTH", "angle": "ANGLE"}
    for name, what in tables.items():
        yield f"*DISTRIBUTION TABLE, NAME={name}\n{what}\n"
    for name, (label, ply, nodes, elements, cells) in zip(plies, _numbered(plies)):
        fields = ply.fields
        yield f"** ply {name!a}: ELSET {label}\n" if name else ""
        yield "*NODE\n"
        yield from _rows(nodes, ply.formed)
        yield f"*ELEMENT, TYPE=S{cells.shape[1]}, ELSET={label}\n"
        yield from _rows(elements, cells)
        if "thickness" in fields:
            own, t = f"{label}_thickness", fields["thickness"]
            yield from _distribution(own, "length", f"{t.mean():.9g}", elements, t)
        if "yarn_a" in fields:
            shear = np.degrees(fields["shear_angle"])
            yield from _distribution(f"{label}_shear_angle", "angle", "0.0", elements, shear)
            for yarn in "ab":
                own, along = f"{label}_yarns_{yarn}", fields[f"yarn_{yarn}"]
                # the second axis so that the third is the normal
                axes = np.hstack([along, np.cross(fields["normal"], along)])
                usual = "1.0, 0.0, 0.0, 0.0, 1.0, 0.0"
                yield from _distribution(own, "yarn_axes", usual, elements, axes)
                yield f"*ORIENTATION, NAME={own}, SYSTEM=RECTANGULAR\n{own}\n3, 0.0\n"


def _distribution(name, table, usual, elements, values):
    yield f"*DISTRIBUTION, NAME={name}, LOCATION=ELEMENT, TABLE={table}\n, {usual}\n"
    yield from _rows(elements, values.reshape(len(elements), -1))


def _rows(numbers, rows):
    for number, row in zip(numbers, rows.tolist()):
        yield f"{number}, {', '.join(f'{value:.9g}' for value in row)}\n"


def _layers(ply):
    """Thickness [mm] and angle to the first side [deg] of a cell's layers, (m,) each, for LS-DYNA
    and Nastran: a, b, b, a of a quarter of the thickness each, or one of metal."""
    thick = ply.fields["thickness"]
    if "yarn_a" not in ply.fields:
        return [(thick, 0 * thick)]
    side = ply.formed[ply.cells[:, 1]] - ply.formed[ply.cells[:, 0]]
    yarns = np.array([ply.fields["yarn_a"], ply.fields["yarn_b"]])
    beside = np.cross(ply.fields["normal"], side)
    a, b = np.degrees(np.arctan2((yarns * beside).sum(2), (yarns * side).sum(2)))
    return [(thick / 4, angle) for angle in (a, b, b, a)]


def _dyna(plies):
    yield "$ formed plies with their yarn directions, by fabric_fenicsx; mm, deg\n*NODE\n"
    for _, ply, nodes, _, _ in _numbered(plies):
        for node, x in zip(nodes, ply.formed.tolist()):
            yield f"{node:8d}" + "".join(f"{each:16.9g}" for each in x) + "\n"
    for part, (label, ply, _, elements, cells) in enumerate(_numbered(plies), 1):
        yield f"$ ply {label}: part {part}, of layers of material {part}\n"
        yield "*ELEMENT_SHELL_COMPOSITE\n"
        layers = np.array(_layers(ply)).transpose(2, 0, 1)
        for element, corners, own in zip(elements, cells.tolist(), layers.tolist()):
            corners = (*corners, corners[-1])[:4]  # a triangle has its last one twice
            yield "".join(f"{each:8d}" for each in (element, part, *corners)) + "\n"
            cards = [f"{part:10d}{t:10.6f}{angle:10.4f}{0:10d}" for t, angle in own]
            yield from ("".join(cards[k : k + 2]) + "\n" for k in range(0, len(cards), 2))
    yield "*END\n"


def _nastran(plies):
    """An element's layers are the PCOMP of its own number, of which the upper half is the lower one
    mirrored."""
    yield "$ formed plies with their yarn directions, by fabric_fenicsx; mm, deg\n"
    for part, (label, ply, nodes, elements, cells) in enumerate(_numbered(plies), 1):
        yield f"$ ply {label}: of layers of material {part}\n"
        for node, (x, y, z) in zip(nodes, ply.formed.tolist()):
            yield f"GRID*   {node:16d}{'':16}{x:16.9e}{y:16.9e}\n*       {z:16.9e}\n"
        layers = _layers(ply)
        lower = layers[: max(1, len(layers) // 2)]
        kind = "CTRIA3" if cells.shape[1] == 3 else "CQUAD4"
        along = lower[0][1]  # the axis of the element's material, to which layers are turned
        for k, (element, corners) in enumerate(zip(elements, cells.tolist())):
            card = "".join(f"{each:8d}" for each in (element, element, *corners))
            yield f"{kind:8}{card}{along[k]:8.3f}\n"
            symmetric = "SYM" if layers[1:] else ""
            yield f"PCOMP*  {element:16d}\n*       {'':48}{symmetric}\n"
            for t, angle in lower:
                turned = angle[k] - along[k]
                yield f"*       {part:16d}{t[k]:16.9e}{turned:16.9e}\n"
