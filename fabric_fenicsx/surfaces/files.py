"""Triangles in files."""

from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np

from ..core.cache_folders import kept_arrays
from ..core.errors import InputError
from ..core.files import check_file, ending
from ..core.formatting import coordinates
from ..core.processes import in_child
from ..core.status import task
from ..io.read import READ, check_end, read_surface_mesh

# endings of models, and what gmsh calls their formats
CAD = {".step": "step", ".stp": "step", ".iges": "iges", ".igs": "iges", ".brep": "brep"}
MAX_TURN = 0.35  # rad, by which the faces of CAD models turn along an edge


def read_triangles(
    path: Path, chord: float, body: Sequence[int] = ()
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Points (n, 3) [mm] and triangles (m, 3) in a file, and of CAD models, of their solids with
    the numbers `body`, the normals at the triangles' corners (m, 3, 3)."""
    allowed = f"STEP, IGES, BREP, or {READ}, as STL, MSH, VTP"
    if ending(path) not in CAD:
        if body:
            raise InputError(f"`body` is allowed only for STEP, IGES and BREP, not for {path}")
        mesh = read_surface_mesh(path, "surface file", allowed)
        return mesh.points, _triangles(mesh), None
    check_file(path, "surface file", allowed)
    check_end(path, "surface file")
    import gmsh

    how = ending(path), chord, body, gmsh.__version__, Path(__file__).read_text()
    try:
        with task(f"meshing {path.name}"):
            made = partial(in_child, _mesh_of_model, path.absolute(), chord, body)
            return kept_arrays(path, how, made)
    except RuntimeError as error:
        raise InputError(
            f"surface file {path} cannot be read as {path.suffix} ({error}); expected a model in "
            f"one piece without gaps: {allowed}"
        ) from None


def _triangles(mesh):
    triangles = []
    for kind, cells in mesh.cells.items():
        corners = cells[:, : {"t": 3, "q": 4}.get(kind[0])]  # of triangles, quads, polygons
        if corners.shape[1] > 3:
            import pyvista  # takes long to import

            faces = np.insert(corners, 0, corners.shape[1], axis=1).ravel()
            faces = pyvista.PolyData(mesh.points, faces).triangulate().faces
            corners = np.asarray(faces, dtype=np.int64).reshape(-1, 4)[:, 1:]
        triangles.append(corners)
    return np.concatenate(triangles)


def _mesh_of_model(path, chord, body):
    """Triangles on the faces of a CAD model, whose edges lie up to `chord` off the faces, and the
    faces' normals at their corners. A first mesh finds the curvature, from which the sizes of the
    second follow."""
    import gmsh

    gmsh.initialize(readConfigFiles=False)
    if ending(path) in (".step", ".stp"):  # IGES files are read in mm anyhow
        gmsh.option.setString("Geometry.OCCTargetUnit", "MM")
    shapes = gmsh.model.occ.importShapes(str(path), format=CAD[ending(path)])
    solids = [(dim, tag) for dim, tag in shapes if dim == 3]
    if ending(path) in (".iges", ".igs") and not solids:
        gmsh.model.occ.removeAllDuplicates()  # faces alone do not share their edges there
    if max(body, default=0) > len(solids) or len(solids) > 1 > len(body):
        boxes = np.reshape([gmsh.model.occ.getBoundingBox(*s) for s in solids], (-1, 2, 3))
        ends = (" to ".join(map(coordinates, box)) for box in boxes.round(3))
        words = ", ".join(f"{k} from {each}" for k, each in enumerate(ends, 1))
        found = f"{len(solids)} bodies: {words} mm"
        raise ValueError(f"it holds {found}; `body` names one or more of them, as body = 1")
    if body:
        others = [each for k, each in enumerate(solids, 1) if k not in body]
        gmsh.model.occ.remove(others, recursive=True)
    gmsh.model.occ.synchronize()
    faces = [tag for _, tag in gmsh.model.getEntities(2)]
    if not faces:
        raise ValueError("no face in it")
    low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
    most = np.linalg.norm(high - low) / 20
    options = {"MeshSizeFromPoints": 0.0, "MeshSizeExtendFromBoundary": 0.0, "Algorithm": 6.0}
    options |= {"MeshSizeFromCurvature": 2 * np.pi / MAX_TURN, "MeshSizeMax": float(most)}
    for name, value in options.items():
        gmsh.option.setNumber(f"Mesh.{name}", value)
    gmsh.model.mesh.generate(2)
    size_at = _sizes_by_curvature(gmsh, faces, chord, most)
    gmsh.model.mesh.clear()
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 0)
    gmsh.model.mesh.setSizeCallback(size_at)
    gmsh.model.mesh.generate(2)
    text = path.read_bytes() if ending(path) in (".step", ".stp") else b""
    if (solids or b"CLOSED_SHELL" in text) and b"OPEN_SHELL" not in text:  # solids alone
        nodes = gmsh.model.mesh.getElementsByType(2)[1].reshape(-1, 3)
        sides = np.sort(np.stack([nodes, np.roll(nodes, -1, 1)], 2).reshape(-1, 2), 1)
        ends, count = np.unique(sides, axis=0, return_counts=True)
        for node, _ in ends[count == 1][:1]:
            place = coordinates(gmsh.model.mesh.getNode(node)[0])
            raise ValueError(f"its solid is open at {place}, where a face is missing")
    corners, normals = zip(*(_triangles_of_face(gmsh, face) for face in faces))
    points = np.vstack(corners).reshape(-1, 3)
    return points, np.arange(len(points)).reshape(-1, 3), np.vstack(normals)


def _sizes_by_curvature(gmsh, faces, chord, most):
    """Size callback for gmsh [mm], by the curvature at the nodes of a mesh."""
    from scipy.spatial import cKDTree

    places, sizes = [], []
    for face in faces:
        _, place, parameters = gmsh.model.mesh.getNodes(2, face, True, True)
        bend = np.maximum(np.abs(gmsh.model.getCurvature(2, face, parameters)), 1e-9)
        places.append(place.reshape(-1, 3))
        sizes.append(np.minimum(np.sqrt(8 * chord / bend), MAX_TURN / bend))
    tree, sizes = cKDTree(np.vstack(places)), np.minimum(np.concatenate(sizes), most)
    grid = float(np.quantile(sizes, 0.05)) / 2

    @cache  # gmsh asks many times at almost the same place
    def size_in(*cell):
        distance, number = tree.query([grid * (each + 0.5) for each in cell], min(8, len(sizes)))
        return float(np.min(sizes[number] + 0.3 * distance))

    return lambda dim, tag, x, y, *z: size_in(x // grid, y // grid, z[0] // grid)


def _triangles_of_face(gmsh, face):
    tags, place, parameters = gmsh.model.mesh.getNodes(2, face, True, True)
    _, cells = gmsh.model.mesh.getElementsByType(2, face)
    order = np.argsort(tags)
    at = order[np.searchsorted(tags[order], cells)].reshape(-1, 3)
    corner = place.reshape(-1, 3)[at]
    normal = np.array(gmsh.model.getNormal(face, parameters)).reshape(-1, 3)[at]
    facet = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    against = np.einsum("mci,mi->", normal, facet) < 0
    return corner, -normal if against else normal
