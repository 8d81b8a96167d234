"""Coupons as data, their cells, and simulated ones."""

import meshio
import numpy as np
import pytest
from synthetic_curves import bias_test

import fabric_fenicsx as ff
from fabric_fenicsx.coupons.simulated import simulated_bias
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


def test_points_are_inner_where_quadratic_cells_do_not_follow_the_yarns():
    pull, bias, off = ff.Tensile, ff.BiasExtension, {"pattern": "crossed"}
    along_the_load = pull(nx=16, pattern="unstructured")
    for test in (along_the_load, pull(nx=16, fibre_angle=20, element="P1"), bias(nx=16)):
        assert test.build().data.integration == "full"
    turned = pull(nx=16, fibre_angle=20, turned=30, **off)
    for test in (turned, bias(nx=16, pattern="left"), bias(nx=16, fibre_angle=30, **off)):
        assert test.build().data.integration == "inner"


def test_cells_by_angle_and_strain():
    at_45 = -45.0, 45 - 1e-10, 45 + 1e-10
    for pattern, angles in (("graded", at_45), ("crossed", (0.9,)), ("yarns", (1.1, 47))):
        for angle in angles:
            assert ff.BiasExtension(nx=24, fibre_angle=angle).build().data.pattern == pattern
    for strain, pattern in ((0.199, "graded"), (0.201, "crossed")):
        assert ff.BiasExtension(nx=24, strain=strain).build().data.pattern == pattern


@pytest.mark.parametrize("element, nx", [("P1", 8), ("P2", 16)])
def test_cells_of_an_estimate_off_axis(element, nx):
    """Quadratic ones along the yarns, 4 and 2 times as large as linear and quadratic ones."""
    fields = {"fibre_angle": 30, "pattern": "crossed", "integration": None}
    built = ff.BiasExtension(nx=32, ny=8, element=element, **fields).build()
    coarse = built.coarser()
    assert built.coarser_is_other_kind
    assert (coarse.nx, coarse.pattern, coarse.element) == (nx, "yarns", "P2")
    assert coarse.integration is None


# test, angle, strain, pattern, nx, and the force [N] of P3 on fine cells along the corners' yarns
OFF_AXIS = [
    (ff.BiasExtension, 30, 0.1, "left", 36, 1.990),
    (ff.Tensile, 45, 0.03, "unstructured", 34, 0.10895),
    (ff.Tensile, 10, 0.005, "crossed", 26, 95.96),
]


def test_estimated_errors_off_axis_cover_the_true_one(tmp_path):
    strip = ff.BiasExtension(fibre_angle=30, pattern="unstructured", nx=32)
    result = strip.job(steps=8, error=True).run(tmp_path / "out", pictures=False)
    true = abs(result.summary["reaction_N"] - 1.990)
    assert 0.02 < true <= result.summary["error"]["reaction_N"] < 1.2 * true


@pytest.mark.parametrize("kind, angle, strain, pattern, nx, force", OFF_AXIS)
def test_forces_off_axis_with_3000_unknowns(kind, angle, strain, pattern, nx, force):
    strip = kind(fibre_angle=angle, strain=strain, pattern=pattern, nx=nx, ny=round(nx / 4))
    result = strip.job(steps=4, limits=ff.Limits()).run(pictures=False)
    assert result.summary["dofs"] <= 3000
    assert result.rows[-1]["reaction_N"] == pytest.approx(force, rel=0.06)


FABRIC = ff.load("komeili").replace(s1=0.05, s2=-0.11, s3=0.13, thickness=1.2)
GAMMA = np.radians(np.arange(10.0, 46, 5))


def test_derivatives_of_the_force():
    curve = bias_test(0 * GAMMA, GAMMA, 230.0, 115.0, 0.02)
    _, slopes = simulated_bias(FABRIC, curve)
    for k, (name, step) in enumerate({"s1": 1e-3, "s2": 2e-3, "s3": 4e-3}.items()):
        more, less = (
            simulated_bias(FABRIC.replace(**{name: getattr(FABRIC, name) + h}), curve)[0]
            for h in (step, -step)
        )
        assert (more - less) / (2 * step) == pytest.approx(slopes[:, k], rel=2e-3)


# and the force [N] at 45 deg of `nx` 48, `crossed`
@pytest.mark.parametrize("height, width, finer", [(230.0, 115.0, 10.7045), (250.0, 100.0, 11.0546)])
def test_few_cells_are_enough(height, width, finer):
    force, _ = simulated_bias(FABRIC, bias_test(0 * GAMMA, GAMMA, height, width, 0.02))
    assert force[-1] == pytest.approx(finer, rel=0.01)
