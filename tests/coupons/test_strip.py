"""Defaults of strips by their yarns, and forces off axis."""

import pytest

import fabric_fenicsx as ff


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
