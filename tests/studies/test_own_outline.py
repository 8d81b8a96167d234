"""Own outlines in the studies: what goes with them, what they are told of, and where they lie."""

import numpy as np
import pytest
from builders import dome

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import Study, parser
from fabric_fenicsx.coupons.tensile import Tensile

FABRIC = ff.load("komeili")


@pytest.fixture
def table(tmp_path):
    """Function of length and width to a file of a rectangle with its low x at `start`."""

    def write(length, width, start=0, name="ply.csv"):
        rows = [(start, 0), (start + length, 0), (start + length, width), (start, width)]
        (tmp_path / name).write_text("\n".join(["x,y", *(f"{x},{y}" for x, y in rows)]))
        return str(tmp_path / name)

    return write


def test_a_strip_has_cells_of_the_size(table, tmp_path):
    out = "--out", str(tmp_path / "out")
    words = ["--outline", table(120, 30), "--size", "5", *out]
    study = Study("tensile", parser(Tensile, ""), words)
    strip = study.build(study.describe(Tensile))
    data = strip.data
    assert (data.length, data.width, data.nx, data.pattern) == (120, 30, None, "unstructured")
    assert strip.blank.mesh.topology.index_map(2).size_global == pytest.approx(332, rel=0.1)
    assert not strip.warnings and strip.coarser().size == 10


def test_errors_are_estimated_from_coarser_cells(table):
    result = Tensile(FABRIC, outline=table(120, 30), size=5).job(steps=2, error=True).run()
    assert 0 < result.summary["error"]["reaction_N"] < 0.2 * result.summary["reaction_N"]


@pytest.mark.parametrize(
    "fields, words",
    [
        ({"mesh": "a.msh"}, "`outline` is given beside `mesh`; allowed is one of them"),
        ({"nx": 9, "size": 8}, "`nx` is given beside `size`; allowed is one of them"),
        ({"length": 100}, "`length` 100 does not fit `outline` .*, of 120 mm"),
    ],
)
def test_what_does_not_go_with_an_outline(table, fields, words):
    with pytest.raises(ff.InputError, match=words):
        Tensile(FABRIC, **{"outline": table(120, 30)} | fields).build()


def test_planes_of_symmetry_cut_a_whole_outline(table):
    made = {"outline": table(500, 300), "size": 40, "fibre_angle": 30, "centred": True}
    ply = dome(FABRIC, **made, full=True)
    assert np.ravel(ply.scene.blank.extent()) == pytest.approx([-250, -150, 0, 250, 150, 0])
    ply = dome(FABRIC, **made, full=False)
    assert np.ravel(ply.scene.blank.extent()) == pytest.approx([0, 0, 0, 250, 150, 0])
    with pytest.raises(ff.InputError, match="not its own mirror image in x = 0"):
        dome(FABRIC, **made | {"centred": False, "outline": table(500, 300, -100)}, full=False)
