"""Formed plies for a structural analysis, read back as its programs would."""

import json
import re

import builders
import formed_plies
import meshio
import numpy as np
import pytest
import pyvista
from mpi4py import MPI
from scipy.spatial import cKDTree

import fabric_fenicsx as ff
from fabric_fenicsx.cli import main
from fabric_fenicsx.io.read import read_surface_mesh
from fabric_fenicsx.results import states, structural
from fabric_fenicsx.results.fields import FieldSeries

A, B = 0.4, 1.8  # of the yarns to x [rad]
# of the formed sheet: sheared, stretched and turned out of its plane
F = builders.rotation() @ np.array([[1.1, 0.3, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.0]])


def formed(folder, element="P1", comm=MPI.COMM_SELF, plies=(), supports=()):
    """The folder of a sheet, or a stack of `plies`, that F has formed."""
    cell = "triangle" if element[0] == "P" else "quadrilateral"
    options = {"comm": comm, "cell": cell, "spatial": True, "degree": int(element[1])}
    sheets = [builders.sheet(60, 40, 3, 2, a=A, b=B, **options) for _ in plies or [""]]
    blank, terms = sheets[0], [ff.Membrane(ff.load("komeili"))]
    if plies:
        blank = ff.Stack([(sheet, 1.0, name) for sheet, name in zip(sheets, plies)])
        terms = [ff.Membrane(ff.load("komeili")).on(name) for name in plies]
    with builders.compiled_as_it_stands():  # and never run
        scene = ff.Scene(blank, terms, supports)
    blank.u.x.array[:] = (blank.coordinates() @ (F - np.eye(3)).T).ravel()
    folder.mkdir(exist_ok=True)
    FieldSeries(folder, scene).write(1.0)
    return folder


def read_abaqus(file):
    """meshio's mesh, and {name: (elements, 6)} of the distributions, by element number."""
    text = file.read_text()
    found = {}
    for name, body in re.findall(r"\*DISTRIBUTION, NAME=(\w+),.*\n((?:[^*].*\n)+)", text):
        default, *lines = body.splitlines()
        assert default.startswith(",")
        numbers, *axes = np.array([line.split(",") for line in lines], float).T
        found[name] = numbers.astype(int), np.array(axes).T
    return meshio.read(file), found


def directions():
    """Unit vectors of yarns a, b and the normal that F makes."""
    a, b = (F @ [np.cos(k), np.sin(k), 0] for k in (A, B))
    return [k / np.linalg.norm(k) for k in (a, b, np.cross(a, b))]


SHEAR = np.degrees((B - A) - np.arccos(directions()[0] @ directions()[1]))


@pytest.mark.versions
@pytest.mark.parametrize("element", ["P1", "P3", "Q2"])
def test_abaqus_reads_places_and_both_yarns(tmp_path, element):
    grid, t = with_thickness(formed(tmp_path, element))
    structural.export({"": grid}, tmp_path / "ply.inp")
    mesh, found = read_abaqus(tmp_path / "ply.inp")
    a, b, n = directions()
    ((kind, cells),) = mesh.cells_dict.items()
    assert kind == ("triangle" if element[0] == "P" else "quad")
    flat = np.linalg.solve(F, mesh.points.T)
    assert flat[:2].max(1) == pytest.approx([60, 40], abs=1e-5)
    assert abs(flat[2]).max() < 1e-5
    p, q, r = (mesh.points[cells[:, k]] for k in (0, 1, -1))
    assert (np.cross(q - p, r - p) @ n > 0).all()
    for name, yarn in (("ply_yarns_a", a), ("ply_yarns_b", b)):
        numbers, values = found[name]
        assert numbers.tolist() == list(range(1, len(cells) + 1))
        axes = np.tile([*yarn, *np.cross(n, yarn)], (len(cells), 1))
        np.testing.assert_allclose(values, axes, atol=1e-6)
    np.testing.assert_allclose(found["ply_thickness"][1][:, 0], t, rtol=1e-8)
    np.testing.assert_allclose(found["ply_shear_angle"][1], SHEAR, atol=1e-4)


@pytest.mark.versions
def test_vtk_reads_directions_shear_and_area(tmp_path):
    structural.export(states.read_grids(formed(tmp_path)), tmp_path / "ply.VTU")
    grid = pyvista.read(tmp_path / "ply.VTU")
    for name, vector in zip(("yarn_a", "yarn_b", "normal"), directions()):
        np.testing.assert_allclose(grid[name], np.tile(vector, (grid.n_cells, 1)), atol=1e-6)
    np.testing.assert_allclose(grid["shear_angle_deg"], SHEAR, atol=1e-4)
    np.testing.assert_allclose(grid["area_ratio"], 1.1 * 0.9, atol=1e-6)


def with_thickness(folder):
    """The grid of a formed ply, each cell of another thickness [mm], and these."""
    (grid,) = states.read_grids(folder).values()
    t = 0.2 + 0.01 * np.arange(grid.n_cells)
    grid.cell_data["thickness_under_pressure"] = t
    return grid, t


def read_dyna(file):
    """Points, cells, and layers (cells, n, 2) of thickness and angle, of a keyword file."""
    lines = [line for line in file.read_text().splitlines() if line[0] != "$"]
    at = lines.index("*ELEMENT_SHELL_COMPOSITE")
    assert lines[0] == "*NODE" and lines[-1] == "*END"
    points = [[float(line[8 + 16 * k : 24 + 16 * k]) for k in range(3)] for line in lines[1:at]]
    cells, layers = [], []
    for head, *cards in zip(*(lines[at + 1 + k : -1 : 3] for k in range(3))):
        cells.append([int(head[8 * k : 8 * k + 8]) - 1 for k in range(2, 6)])
        words = [[float(card[10 * k : 10 * k + 10]) for k in (1, 2, 5, 6)] for card in cards]
        layers.append(np.reshape(words, (4, 2)))
    return np.array(points), np.array(cells), np.array(layers)


def read_nastran(file):
    """As `read_dyna`, of bulk data: points and cells as the project reads them, layers of the PCOMP
    of each cell, with the element's angle, from the lower face to the upper one."""
    mesh, lines, layers = read_surface_mesh(file, "a part"), file.read_text().splitlines(), []
    for k, line in enumerate(lines):
        if line[:6] in ("CTRIA3", "CQUAD4"):
            corners = 3 if line[:6] == "CTRIA3" else 4
            turned = float(line[8 * (3 + corners) : 8 * (4 + corners)])
            assert lines[k + 1][:8] == "PCOMP*  " and line[8:24] == 2 * line[8:16]
            assert int(lines[k + 1][8:24]) == int(line[8:16]) and lines[k + 2][56:] == "SYM"
            cards = lines[k + 3 : k + 5]
            lower = [(float(each[24:40]), float(each[40:56]) + turned) for each in cards]
            layers.append([*lower, *lower[::-1]])
    (cells,) = mesh.cells.values()
    return mesh.points, cells, np.array(layers)


@pytest.mark.versions
@pytest.mark.parametrize("element", ["P2", "Q1"])
@pytest.mark.parametrize("ending, read", [(".k", read_dyna), (".bdf", read_nastran)])
def test_layers_of_elements_lie_along_both_yarns(tmp_path, element, ending, read):
    """Turned from the first side by its angle, about the normal; thicknesses add up."""
    grid, t = with_thickness(formed(tmp_path, element))
    structural.export({"": grid}, tmp_path / f"ply{ending}")
    points, cells, layers = read(tmp_path / f"ply{ending}")
    a, b, n = directions()
    p, q, r = (points[cells[:, k]] for k in (0, 1, -1))
    assert (np.cross(q - p, r - p) @ n > 0).all()
    np.testing.assert_allclose(layers[:, :, 0].sum(1), t, atol=2e-6)
    side = (q - p) / np.linalg.norm(q - p, axis=1)[:, None]
    for k, yarn in enumerate((a, b, b, a)):
        angle = np.radians(layers[:, k, 1])[:, None]
        along = np.cos(angle) * side + np.sin(angle) * np.cross(n, side)
        np.testing.assert_allclose(along, np.tile(yarn, (len(cells), 1)), atol=2e-5)


def test_a_sheet_of_metal_has_one_layer(tmp_path):
    grids = states.read_grids(formed(tmp_path, plies=("metal", "ply")))
    for name, thickness in (("metal", "metal_thickness"), ("ply", "thickness_under_pressure")):
        grids[name].cell_data[thickness] = np.full(grids[name].n_cells, 0.3)
    grids["metal"].cell_data.remove("a")
    structural.export(grids, tmp_path / "p.k")
    metal, fabric = (tmp_path / "p.k").read_text().split("*ELEMENT_SHELL_COMPOSITE\n")[1:]
    assert metal.splitlines()[1].split() == ["1", "0.300000", "0.0000", "0"]
    assert fabric.splitlines()[1].split()[:2] == ["2", "0.075000"]


def symmetric(x, y):
    """Places of a ply that is formed alike in all four quarters."""
    height = 8 * np.exp(-(x**2 + y**2) / 900)
    return np.column_stack([x * (1 - 1e-4 * y**2), y * (1 + 2e-4 * x**2), height])


@pytest.mark.parametrize("angle, image", [(45, 45), (30, 60), (10, -10)])
def test_a_quarter_is_mirrored_with_its_yarns(angle, image):
    """To what the whole ply has, if its yarns are their own mirror images; yarns at 30 and 120 deg
    are continued by those at 60 and 150 deg, at 10 and 100 deg by those at -10 and 80 deg."""
    size = {"nx": 6, "ny": 4, "angle": np.radians(angle)}
    quarter = formed_plies.formed(symmetric, length=30, width=20, **size)
    size |= {"nx": 12, "ny": 8}
    whole = formed_plies.formed(symmetric, length=60, width=40, full=True, **size)
    for grid in (quarter, whole):
        centres = abs(grid.cell_centers().points)
        grid.cell_data["thickness_under_pressure"] = 0.3 + 0.01 * centres[:, 0]
    ply, expected = structural.formed_ply(quarter), structural.formed_ply(whole)
    assert len(ply.formed) == len(expected.formed) and len(ply.cells) == len(expected.cells)
    p, q, r = (ply.formed[ply.cells[:, k]] for k in (0, 1, -1))
    assert (np.cross(q - p, r - p) * ply.fields["normal"]).sum(1).min() > 0
    a, b = ply.fields["yarn_a"], ply.fields["yarn_b"]
    assert (np.cross(a, b) * ply.fields["normal"]).sum(1).min() > 0
    shear = np.arcsin((a * b).sum(1))  # 90 deg without the angle between them
    assert (shear.min() < -0.02) == (angle == 10)  # as over a plane its sign changes
    np.testing.assert_allclose(ply.fields["shear_angle"], shear, atol=1e-9)
    tree = cKDTree(expected.formed[expected.cells].mean(1))
    apart, at = tree.query(ply.formed[ply.cells].mean(1))
    assert apart.max() < 1e-9 and len(set(at)) == len(at)
    same = angle == 45
    for name in ("yarn_a", "yarn_b", "normal", "shear_angle", "thickness", "area_ratio"):
        if same or name in ("normal", "thickness", "area_ratio"):
            np.testing.assert_allclose(ply.fields[name], expected.fields[name][at], atol=1e-9)
    low = np.degrees(np.arctan2(*ply.fields["yarn_a"][:, [1, 0]].T))[[0, len(p) // 4]]
    assert same or low == pytest.approx([angle, image], abs=3)


def test_sheets_of_a_stack_have_what_is_their_own():
    """And no field that is unknown all over them."""
    grid = formed_plies.halves(part=[1, 0], number=[7.0, 8.0], own=[np.nan, 2.0])
    grid.field_data[formed_plies.SYMMETRIC] = [1]
    sheets = states.sheets_of(grid, ["low", "high"])
    assert {k: each["number"].tolist() for k, each in sheets.items()} == {"low": [8], "high": [7]}
    assert [("own" in each.cell_data) for each in sheets.values()] == [True, False]
    assert all(list(each.field_data[formed_plies.SYMMETRIC]) == [1] for each in sheets.values())


@pytest.mark.mpi
def test_nodes_of_several_ranks_are_one(tmp_path):
    comm = MPI.COMM_WORLD
    folder = formed(comm.bcast(tmp_path), comm=comm)
    if comm.rank == 0:
        (ply,) = map(structural.formed_ply, states.read_grids(folder).values())
        assert len(ply.formed) == 4 * 3 + 3 * 2  # of the crossed rectangles and their middles
        assert len(ply.cells) == 4 * 3 * 2
    comm.barrier()


@pytest.mark.parametrize("plies", [(), ("lower", "upper")])
def test_the_command_exports_the_whole_part(tmp_path, capsys, plies):
    """Of a quarter, as its supports tell; a clamped end is no plane of symmetry. What is not
    valid is exported with a warning."""
    planes = [ff.Support(f"{x} = 0", builders.near(k, 0.0), (k,)) for k, x in enumerate("xy")]
    folder = formed(tmp_path / "quarter", plies=plies, supports=planes)
    file, whole = tmp_path / "ply.inp", ", 96 cells, mirrored in x = 0 and y = 0"
    name = plies[0] if plies else "the ply"
    for words, status, told, count in (
        ((folder, file), 0, whole, max(1, len(plies))),
        ((folder, file), 2, "ply.inp exists already; use another file, or --over", 1),
        (("--modelled", folder, file, "--overwrite"), 0, "), 24 cells\n", 1),
        ((folder, tmp_path / "ply.k"), 2, f"the thickness of {name} is not", 1),
        ((folder, "ply.stl"), 2, "the extension of ply.stl is unknown; expected .vtu", 1),
    ):
        assert main.main(["export", *map(str, words)]) == status
        assert "".join(capsys.readouterr()).count(told) >= count
    held = [ff.Support("clamp", builders.near(0, 0.0), (0, 1, 2))]
    folder = formed(tmp_path / "clamped", plies=plies, supports=held)
    (folder / "summary.json").write_text(json.dumps({"converged": False, "reason": "folds"}))
    assert main.main(["export", str(folder), str(file), "--overwrite"]) == 0
    out, err = capsys.readouterr()
    assert "mirrored" not in out and err.strip().endswith("folds")


def test_labels_are_legal_in_abaqus_and_no_two_alike():
    names = ["+45", "-45", "0/90", "skin-2", "warp +30", "top ply", "top-ply", "TOP_PLY", "", "上"]
    names += ["a" * 99, "a" * 98, "3", "p45", "45", "ply", "_"]
    labels = states.set_labels(names)
    assert list(labels) == names and len({*map(str.lower, labels.values())}) == len(names)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,63}", label) for label in labels.values())
    told = ["p45", "m45", "ply_0_90", "skin_2", "warp_p30", "top_ply", "top_ply_2"]
    assert [labels[name] for name in names[:7]] == told
