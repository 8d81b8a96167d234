"""Tests as dataclasses: their fields are checked."""

import meshio
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.sheet.meshing import modelled_share
from fabric_fenicsx.sheet.specimen import specimen


def test_a_strip_of_less_than_two_widths_is_refused():
    with pytest.raises(ff.InputError, match="allowed is a length of 2 widths or more"):
        ff.BiasExtension(length=99).build()


@pytest.mark.parametrize("kind", [ff.Tensile, ff.BiasExtension, ff.PictureFrame])
def test_a_coupon_is_data(kind):
    """It stays as it was given when it is built, and what is built of it builds the same."""
    test = kind(nx=4)
    built = test.build()
    assert test == kind(nx=4) and test.integration is None
    assert (built.data.nx, built.data.integration) == (4, "full")
    assert built.data.build().data == built.data


def test_sizes_of_an_own_mesh(tmp_path):
    """Known to a thousandth; a plane of symmetry leaves half of a side to model."""
    points, cells, kind = specimen(100.0, 50.0, 4, 2)
    meshio.write_points_cells(tmp_path / "m.msh", points, [(kind, cells)])
    for length, fits in ((99.91, True), (100.09, True), (99.89, False), (100.11, False)):
        strip = ff.BiasExtension(mesh=str(tmp_path / "m.msh"), length=length)
        if fits:
            assert strip.build().data.length == 100
        else:
            with pytest.raises(ff.InputError, match="does not fit .* of 100 mm"):
                strip.build()
    shares = [modelled_share(planes).tolist() for planes in ([], [0], [1])]
    assert shares == [[1, 1], [0.5, 1], [1, 0.5]]
