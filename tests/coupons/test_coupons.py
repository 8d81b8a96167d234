"""Coupons as data, their cells, simulated ones, and the net of stiff yarns."""

import math

import meshio
import numpy as np
import pytest
from synthetic_curves import bias_test

import fabric_fenicsx as ff
from fabric_fenicsx.coupons.pin_jointed import PinJointedStrip
from fabric_fenicsx.coupons.simulated import simulated_bias
from fabric_fenicsx.sheet.meshing import modelled_share
from fabric_fenicsx.sheet.specimen import specimen


def test_a_strip_of_less_than_two_widths_is_refused():
    with pytest.raises(ff.InputError, match="expected a length of 2 widths or more"):
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


@pytest.mark.parametrize(
    "element, pattern, angle, other",
    [
        ("P1", "crossed", 30, (8, "yarns", "P2", True)),
        ("P1", "yarns", 30, (8, "yarns", "P2", True)),
        ("P1", "crossed", 90, (16, "yarns", "P2", True)),
        ("P2", "crossed", 30, (16, "yarns", "P2", True)),
        ("P2", "yarns", 30, (11, "yarns", "P3", False)),
        ("P2", "graded", 45, (16, "graded", "P2", False)),
    ],
)
def test_cells_of_an_estimate(element, pattern, angle, other):
    strip = ff.BiasExtension(fibre_angle=angle, pattern=pattern, nx=32, ny=8, element=element)
    built = strip.build()
    coarse = built.coarser().build()
    found = coarse.nx, coarse.pattern, coarse.element, built.coarser_is_other_kind
    assert found == other and coarse.integration == "full"


# test, force [N] of studies/reference or of P3 on fine cells along the corners' yarns, and the most
# that the estimate is over the true error
ESTIMATED = [
    (ff.BiasExtension(fibre_angle=30, pattern="unstructured", nx=32), 1.990, 1.2),
    (ff.BiasExtension(fibre_angle=30, nx=32, element="P1"), 1.990, 5),
    (ff.Tensile(nx=24, element="P1"), 2033.276, 1.5),
]


@pytest.mark.parametrize("strip, force, most", ESTIMATED)
def test_estimated_errors_of_strips_cover_the_true_one(strip, force, most):
    result = strip.job(steps=8, error=True).run()
    true = abs(result.summary["reaction_N"] - force)
    assert 0.001 * force < true <= result.summary["error"]["reaction_N"] < most * true


# test, force [N] of P2, 60, or P3 on fine cells along the corners' yarns, and a share of it; the
# length of the first is no multiple of its width, others have at most 3000 unknowns
FORCES = [
    (ff.BiasExtension(length=147, width=39, strain=0.096), 0.37206, 1e-3),
    (ff.BiasExtension(fibre_angle=30, strain=0.1, pattern="left", nx=36, ny=9), 1.990, 0.06),
    (ff.Tensile(fibre_angle=45, pattern="unstructured", nx=34, ny=8), 0.10895, 0.06),
    (ff.Tensile(fibre_angle=10, strain=0.005, pattern="crossed", nx=26, ny=6), 95.96, 0.06),
]


@pytest.mark.parametrize("strip, force, rel", FORCES)
def test_forces_of_strips(strip, force, rel):
    result = strip.job(steps=4).run()
    assert result.summary["dofs"] <= 3000 or rel == 1e-3
    assert result.rows[-1]["reaction_N"] == pytest.approx(force, rel=rel)


FABRIC = ff.load("komeili").replace(s1=0.05, s2=-0.11, s3=0.13, thickness=1.2)
GAMMA = np.radians(np.arange(10.0, 46, 5))


def test_derivatives_of_the_force():
    curve = bias_test(0 * GAMMA, GAMMA, 230.0, 115.0, 0.02)
    _, slopes = simulated_bias(FABRIC, curve)
    for k, (name, step) in enumerate({"s1": 1e-3, "s2": 2e-3, "s3": 4e-3}.items()):
        changed = ({name: getattr(FABRIC, name) + h} for h in (step, -step))
        more, less = (simulated_bias(FABRIC.replace(**to), curve)[0] for to in changed)
        assert (more - less) / (2 * step) == pytest.approx(slopes[:, k], rel=2e-3)


# and the force [N] at 45 deg of `nx` 48, `crossed`
@pytest.mark.parametrize("height, width, finer", [(230.0, 115.0, 10.7045), (250.0, 100.0, 11.0546)])
def test_few_cells_are_enough(height, width, finer):
    force, _ = simulated_bias(FABRIC, bias_test(0 * GAMMA, GAMMA, height, width, 0.02))
    assert force[-1] == pytest.approx(finer, rel=0.01)


RIGHT = math.pi / 2


def at_angle(degrees, length=200.0, width=50.0):
    return PinJointedStrip(length, width, math.radians(degrees), math.radians(degrees) + RIGHT)


def deformed(strip, displacement, x, y):
    """Places of the net p(alpha) + q(beta), from the turns of the yarns alone, by the lengths of
    yarn between clamps."""
    a, b = strip.a, strip.b
    to_yarns = np.linalg.inv([[np.cos(a), np.cos(b)], [np.sin(a), np.sin(b)]])
    places = to_yarns @ [x, y]
    moved = np.array([x, y], float)
    for own, angle, turn in zip(range(2), (a, b), strip.turns(displacement)):
        corners = [np.repeat([0, strip.length], 2), np.tile([0, strip.width], 2)]
        ends = np.sort(to_yarns[own] @ corners)[1:3]  # the stretch between the clamps
        share = np.clip(places[own], *ends) - ends[0 if to_yarns[own, 0] > 0 else 1]
        change = np.exp(1j * (angle + turn)) - np.exp(1j * angle)
        moved += np.outer([change.real, change.imag], share)
    return moved


@pytest.mark.parametrize("a, b", [(45, 135), (60, 150), (-40, 50), (50, -40), (25, 95), (20, -50)])
def test_clamps_move_rigidly_and_yarns_keep_their_lengths(a, b):
    strip = PinJointedStrip(200.0, 50.0, math.radians(a), math.radians(b))
    d = 3.0
    y = np.linspace(0, 50, 11)
    np.testing.assert_allclose(deformed(strip, d, 0 * y, y), [0 * y, y], atol=1e-10)
    np.testing.assert_allclose(deformed(strip, d, 0 * y + 200, y), [0 * y + 200 + d, y], atol=1e-10)
    rng = np.random.default_rng(1)
    x, y = rng.uniform((0, 0), (200, 50), (200, 2)).T
    ways = (1e-5, 0), (0, 1e-5)
    ahead, back = ([deformed(strip, d, x + s * h, y + s * k) for h, k in ways] for s in (1, -1))
    gradient = np.subtract(ahead, back).swapaxes(0, 1) / 2e-5  # of places, (2, 2, n)
    fa, fb = (np.einsum("ijn,j->in", gradient, [np.cos(k), np.sin(k)]) for k in (strip.a, strip.b))
    (_, _), distance = strip.held(x, y)
    off = distance > 1e-3
    for f in (fa, fb):
        np.testing.assert_allclose(np.linalg.norm(f[:, off], axis=0), 1, atol=1e-8)
    initial = math.acos(math.cos(strip.b - strip.a))
    gamma = initial - np.arccos((fa * fb).sum(0))
    np.testing.assert_allclose(strip.shear_angles(x, y, d)[off], gamma[off], atol=1e-7)
    assert strip.shear_angle(d) == pytest.approx(strip.shear_angles([100], [25], d)[0], abs=1e-12)
    rested = strip.shear_angle(d) + 1.2 - initial
    assert strip.shear_angle(d, rest=1.2) == pytest.approx(rested, abs=1e-12)


def test_formulas_of_the_literature():
    for d in (1.0, 10.0, 30.0):
        exact = RIGHT - 2 * math.acos((150 + d) / (math.sqrt(2) * 150))
        assert abs(at_angle(45).shear_angle(d)) == pytest.approx(exact, rel=1e-12)
    t, d = math.radians(30), 10.0
    gaps = (200 * math.cos(t) - 50 * math.sin(t)) * (200 * math.sin(t) - 50 * math.cos(t))
    sine = d * (2 * (200 - 50 * math.sin(2 * t)) + d) / (2 * gaps)
    assert abs(at_angle(30).shear_angle(d)) == pytest.approx(math.asin(sine), rel=1e-12)
    assert abs(at_angle(60).shear_angle(d)) == pytest.approx(math.asin(sine), rel=1e-12)
    assert math.isnan(at_angle(45).shear_angle(63))  # taut at 62.1 mm


def test_yarns_from_clamp_to_clamp_lock():
    """tan of 14.04 deg is 50 / 200."""
    names = {0: "yarns a", 14: "yarns a", 14.1: "", 75.9: "", 76: "yarns b", 90: "yarns b"}
    for degrees, yarns in names.items():
        strip = at_angle(degrees)
        assert strip.locked.startswith(yarns) and bool(strip.locked) == bool(yarns)
        assert math.isnan(strip.shear_angle(1e-3)) == bool(yarns)


def test_distance_to_where_yarns_begin_to_end_in_a_clamp():
    """Of yarns at 30 and 150 deg, and at right angles: from lines along them from the corners."""
    for degrees, x, y in ((30, 20, 25), (45, 25, 5), (45, 100, 25)):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        strip = PinJointedStrip(200.0, 50.0, math.radians(degrees), math.radians(180 - degrees))
        end = min(x, 200 - x)
        expected = min(abs(y * c - end * s), abs((50 - y) * c - end * s))
        assert strip.held([x], [y])[1] == pytest.approx(expected)
