"""Formed plies for a structural analysis, read back as its programs would."""

import json
import re

import builders
import meshio
import numpy as np
import pytest
import pyvista
from mpi4py import MPI

from fabric_fenicsx.command_line import main
from fabric_fenicsx.material.presets import load
from fabric_fenicsx.mechanics.shell.membrane import Membrane
from fabric_fenicsx.postprocess import states, structural
from fabric_fenicsx.results.fields import FieldSeries
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.sheets.stack import Stack

A, B = 0.4, 1.8  # of the yarns to x [rad]
# of the formed sheet: sheared, stretched and turned out of its plane
F = builders.rotation() @ np.array([[1.1, 0.3, 0.0], [0.0, 0.9, 0.0], [0.0, 0.0, 1.0]])


def formed(folder, element="P1", comm=MPI.COMM_SELF, plies=()):
    """The folder of a sheet, or a stack of `plies`, that F has formed."""
    cell = "triangle" if element[0] == "P" else "quadrilateral"
    sheets = [
        builders.sheet(
            60, 40, 3, 2, comm=comm, cell=cell, spatial=True, a=A, b=B, degree=int(element[1])
        )
        for _ in plies or [""]
    ]
    blank, terms = sheets[0], [Membrane(load("komeili"))]
    if plies:
        blank = Stack([(sheet, 1.0, name) for sheet, name in zip(sheets, plies)])
        terms = [Membrane(load("komeili")).on(name) for name in plies]
    with builders.compiled_as_it_stands():  # and never run
        scene = Scene(blank, terms)
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


@pytest.mark.versions
@pytest.mark.parametrize("element", ["P1", "P2", "P3", "Q1", "Q2"])
def test_abaqus_reads_places_and_both_yarns(tmp_path, element):
    structural.export(states.read_grids(formed(tmp_path, element)), tmp_path / "ply.inp")
    mesh, found = read_abaqus(tmp_path / "ply.inp")
    a, b, n = directions()
    ((kind, cells),) = mesh.cells_dict.items()
    assert kind == ("triangle" if element[0] == "P" else "quad")
    flat = np.linalg.solve(F, mesh.points.T)
    assert flat[:2].max(1) == pytest.approx([60, 40], abs=1e-5)
    assert abs(flat[2]).max() < 1e-5
    edges = (
        mesh.points[cells[:, 1]] - mesh.points[cells[:, 0]],
        (mesh.points[cells[:, -1]] - mesh.points[cells[:, 0]]),
    )
    assert (np.cross(*edges) @ n > 0).all()
    for name, axes in (("ply_yarns_a", [*a, *b]), ("ply_yarns_b", [*b, *-a])):
        numbers, values = found[name]
        assert numbers.tolist() == list(range(1, len(cells) + 1))
        np.testing.assert_allclose(values, np.tile(axes, (len(cells), 1)), atol=1e-6)


@pytest.mark.versions
def test_vtk_reads_directions_shear_and_area(tmp_path):
    structural.export(states.read_grids(formed(tmp_path)), tmp_path / "ply.vtu")
    grid = pyvista.read(tmp_path / "ply.vtu")
    for name, vector in zip(("yarn_a", "yarn_b", "normal"), directions()):
        np.testing.assert_allclose(grid[name], np.tile(vector, (grid.n_cells, 1)), atol=1e-6)
    a, b, _ = directions()
    np.testing.assert_allclose(grid["shear_angle"], (B - A) - np.arccos(a @ b), atol=1e-6)
    np.testing.assert_allclose(grid["area_ratio"], 1.1 * 0.9, atol=1e-6)


def test_plies_of_a_stack_have_sets_and_numbers_of_their_own(tmp_path):
    grids = states.read_grids(formed(tmp_path, plies=("lower", "ply 2")))
    structural.export(grids, tmp_path / "plies.inp")
    mesh, found = read_abaqus(tmp_path / "plies.inp")
    assert set(mesh.cell_sets) == {"lower", "ply_2"}
    assert list(found) == ["lower_yarns_a", "lower_yarns_b", "ply_2_yarns_a", "ply_2_yarns_b"]
    half = sum(map(len, mesh.cells_dict.values())) // 2
    assert found["ply_2_yarns_a"][0].tolist() == list(range(half + 1, 2 * half + 1))
    structural.export(grids, tmp_path / "plies.vtu")
    assert np.bincount(pyvista.read(tmp_path / "plies.vtu")["part"]).tolist() == [half, half]


def test_labels_are_legal_in_abaqus_and_no_two_alike():
    names = ["+45", "-45", "0/90", "", "top ply", "top-ply", "TOP_PLY", "Äußere", "上", "下", "_"]
    names += ["a" * 99, "a" * 98, "skin-2", "3", "p45", "warp +30", "45", "ply"]
    labels = states.set_labels(names)
    assert list(labels) == names
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,63}", label) for label in labels.values())
    assert len({label.lower() for label in labels.values()}) == len(names)
    told = [labels[name] for name in ("+45", "-45", "0/90", "skin-2", "warp +30", "top-ply")]
    assert told == ["p45", "m45", "ply_0_90", "skin_2", "warp_p30", "top_ply_2"]


def test_plies_at_plus_and_minus_45_have_sets_and_orientations_of_their_own(tmp_path):
    structural.export(states.read_grids(formed(tmp_path, plies=("+45", "-45"))), tmp_path / "o.inp")
    mesh, found = read_abaqus(tmp_path / "o.inp")
    assert {name: len(sum(map(list, cells), [])) for name, cells in mesh.cell_sets.items()} == {
        "p45": 24,
        "m45": 24,
    }
    assert list(found) == ["p45_yarns_a", "p45_yarns_b", "m45_yarns_a", "m45_yarns_b"]
    assert "** ply '-45': ELSET m45\n" in (tmp_path / "o.inp").read_text()


@pytest.mark.mpi
def test_nodes_of_several_ranks_are_one(tmp_path):
    comm = MPI.COMM_WORLD
    folder = formed(comm.bcast(tmp_path), comm=comm)
    if comm.rank == 0:
        (ply,) = map(structural.formed_ply, states.read_grids(folder).values())
        assert len(ply.points) == 4 * 3 + 3 * 2  # of the crossed rectangles and their middles
        assert len(ply.cells) == 4 * 3 * 2
    comm.barrier()


def test_the_command(tmp_path, capsys):
    folder = formed(tmp_path / "run")
    assert main.main(["export", str(folder), str(tmp_path / "ply.inp")]) == 0
    assert "*ORIENTATION" in (tmp_path / "ply.inp").read_text()
    assert capsys.readouterr().out == f"{tmp_path / 'ply.inp'}: ply (ELSET ply), 24 cells\n"
    for words, told in (
        ((str(folder), "ply.stl"), "the ending of ply.stl is unknown; allowed are .vtu"),
        ((str(tmp_path), "ply.inp"), "has no fields.pvd; allowed is the folder of a run's results"),
        ((str(folder),), "allowed is a folder and a file"),
        ((str(folder), str(tmp_path / "no/ply.inp")), "can't be written"),
    ):
        assert main.main(["export", *words]) == 2
        assert told in capsys.readouterr().err


def test_results_that_are_not_believed_are_exported_with_a_warning(tmp_path, capsys):
    folder = formed(tmp_path / "run")
    for summary, told in (
        ({"converged": True}, ""),
        ({"converged": False, "reason": "folds"}, "folds"),
    ):
        (folder / "summary.json").write_text(json.dumps(summary))
        assert main.main(["export", str(folder), str(tmp_path / "ply.vtu")]) == 0
        assert capsys.readouterr().err.strip().endswith(told)


def test_a_sheet_without_yarns_alone_is_not_written(tmp_path):
    grids = states.read_grids(formed(tmp_path))
    grids[""].cell_data.remove("a")
    with pytest.raises(InputError, match="no sheet has yarns"):
        structural.export(grids, tmp_path / "ply.inp")
