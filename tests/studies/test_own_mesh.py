"""Own meshes in the studies: their sizes are told, what contradicts them is refused, what they do
not need is doubted."""

import meshio
import numpy as np
import pytest
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import Study, parser
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.coupons.tensile import Tensile
from fabric_fenicsx.sheet.specimen import specimen

COMM = MPI.COMM_WORLD


@pytest.fixture
def study(shared_path):
    """Function of a coupon, the points and cells of its mesh, and words, to the `Study`."""

    def make(coupon, mesh, *words):
        if COMM.rank == 0:
            points, cells, kind = mesh
            meshio.write_points_cells(shared_path / "s.vtk", points, [(kind, cells)])
        COMM.barrier()
        files = "--mesh", str(shared_path / "s.vtk"), "--out", str(shared_path / "out")
        return Study("coupon", parser(coupon, ""), [*files, *words])

    return make


@pytest.mark.mpi
@pytest.mark.parametrize("turned", [0.0, 0.5])
def test_length_and_width_are_the_meshs_own(study, turned):
    points, cells, kind = specimen(120, 30, 12, 3)
    c, s = np.cos(turned), np.sin(turned)
    points[:, :2] = points[:, :2] @ [[c, s], [-s, c]] + 7
    mine = study(Tensile, (points, cells, kind), "--turned", str(np.degrees(turned)))
    mine.build(mine.describe(Tensile))
    assert (mine.args.length, mine.args.width) == (120, 30)
    assert (mine.args.nx, mine.args.ny, mine.args.pattern) == (None, None, None)
    mine.build(mine.describe(Tensile))  # as for a second part
    assert (mine.args.length, mine.args.width, mine.output.warnings) == (120, 30, [])


@pytest.mark.parametrize("name, value", [("length", 120.5), ("width", 50)])
def test_a_length_that_is_not_the_meshs_is_refused(study, name, value):
    mine = study(Tensile, specimen(120, 30, 12, 3), f"--{name}", str(value))
    own = {"length": 120, "width": 30}[name]
    with pytest.raises(InputError, match=f"`{name}` {value} does not fit `mesh` .*, of {own} mm"):
        mine.build(mine.describe(Tensile))


def quarter(tmp_path, shift=(0, 0, 0)):
    """The built press of the double dome on a mesh."""
    points, cells, kind = specimen(200, 120, 10, 6, "left")
    meshio.write_points_cells(tmp_path / "s.vtk", points + shift, [(kind, cells)])
    return ff.Press.read("double_dome", [f"blank.mesh={tmp_path / 's.vtk'}"]).build()


def test_a_quarter_is_half_as_long_as_its_ply(tmp_path):
    found = quarter(tmp_path).resolved
    assert (found["length"], found["width"], found["nx"]) == (400, 240, None)
