"""Abaqus' input files as preprocessors and hands write them."""

import numpy as np
import pytest

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.io.read import read_surface_mesh

NODES = "*Node\n1, 0., 0., 0.\n2, 10., 0.\n3, 10., 10., 0.\n4, 0., 10., 0.\n"
MIDDLES = "*NODE, NSET=MIDDLES\n5, 5., 0.\n6, 10., 5.\n7, 5., 10.\n8, 0., 5.\n9, 5., 5.\n"


def read(tmp_path, text, name="square.inp"):
    (tmp_path / name).write_text(text)
    return read_surface_mesh(tmp_path / name, "mesh file")


@pytest.mark.parametrize(
    "name, kind, nodes",
    [
        ("STRI65", "triangle6", "1, 2, 3, 5, 6, 9"),
        ("s4r", "quad", "1, 2, 3, 4"),
        ("S8R", "quad8", "1, 2, 3, 4, 5, 6, 7, 8"),
        ("M3D9", "quad9", "1, 2, 3, 4, 5, 6,\n7, 8, 9"),
    ],
)
def test_elements_of_surfaces(tmp_path, name, kind, nodes):
    mesh = read(tmp_path, f"{NODES}{MIDDLES}*Element, type={name}, elset=ply\n7, {nodes}\n")
    numbers = [int(n) - 1 for n in nodes.replace("\n", " ").split(",")]
    assert mesh.cells[kind].tolist() == [numbers]


def test_a_deck_with_comments_and_blocks_in_any_order(tmp_path):
    mesh = read(
        tmp_path,
        "*Heading\r\n woven ply\r\n** a comment\r\n\r\n"
        "*ELEMENT, TYPE=M3D4R,\r\n ELSET=ply\r\n** another\r\n 1, 10, 20, 30, 40\r\n"
        "*NODE\r\n40, 0., 1D1, 0.\r\n30, 10., 10., 0.\r\n"
        "*NODE, NSET=low\r\n10, , , 0.\r\n20, 10., 0., 0.\r\n"
        "*Element, type=MASS, elset=punch\r\n9, 999\r\n*Node\r\n999, 0., 0., 50.\r\n"
        "*Static\r\n0.1, 1.\r\n",
    )
    square = mesh.points[mesh.cells["quad"][0], :2]
    assert square.tolist() == [[0, 0], [10, 0], [10, 10], [0, 10]]
    assert mesh.others == {"MASS": 1}


def test_instances_are_where_the_assembly_has_them(tmp_path):
    mesh = read(
        tmp_path,
        f"*Part, name=Ply\n{NODES}*Element, type=S4R\n1, 1, 2, 3, 4\n*End Part\n"
        "*Assembly, name=Assembly\n*Instance, name=a, part=Ply\n*End Instance\n"
        "*Instance, name=c, part=Ply\n, , 5.\n*End Instance\n"
        "*Instance, name=b, part=PLY\n0., 0., 5.\n10., 0., 5., 10., 2., 5., 30.\n*End Instance\n"
        "*Node\n1, 50., 50., 50.\n*End Assembly\n",
    )
    first, shifted, second = mesh.points[mesh.cells["quad"]]
    assert shifted[0].tolist() == [0, 0, 5]  # numbers may be left out
    assert first[2].tolist() == [10, 10, 0]
    # turned by 30 deg about a line along y through (10, 0, 5)
    turned = 10 - 5 * np.sqrt(3), 0, 5 + 5
    np.testing.assert_allclose(second[[0, 2]], [turned, (10, 10, 5)], atol=1e-12)


def test_files_that_are_named_are_read_too(tmp_path):
    (tmp_path / "nodes.inp").write_text(NODES)
    (tmp_path / "elements.txt").write_text("1, 1, 2, 3, 4\n")
    text = "*Include, input=nodes.inp\n*Element, type=S4, input=elements.txt\n"
    assert read(tmp_path, text).cells["quad"].tolist() == [[0, 1, 2, 3]]


def test_what_cannot_be_read_is_named(tmp_path):
    for text, words in (
        (f"{NODES}*NGEN\n1, 2, 1\n", r"uses \*NGEN, not nodes and elements as lists"),
        (f"{NODES}*Element, type=S3\n1, 1, 2, 8\n", "lacks node 8 of an element"),
        ("*Node, system=C\n1, 0., 0.\n", "SYSTEM=C, not rectangular"),
        (f"*Part, name=Ply\n{NODES}", r"has a part or instance without \*END"),
    ):
        with pytest.raises(InputError, match=words):
            read(tmp_path, text)
