"""Measured curves laid over the simulated ones of strips."""

import json
from pathlib import Path

import numpy as np
import pytest

import fabric_fenicsx as ff

SHIPPED = Path(__file__).parents[2] / "studies" / "data"
SHEET = "thickness_mm = 1.0\ndensity_g_per_cm3 = 0.75\nbalanced = true\n"
SIZE = {"length": 200, "width": 50, "nx": 12, "ny": 3, "pattern": "crossed", "element": "P1"}
# of each test: its class, its keys, and header and factors of what its machine writes
TESTS = {
    "uniaxial_a": (ff.Tensile, "lateral: free", "length", "displacement [mm], F [kN]", (1, 1e-3)),
    "uniaxial_b": (ff.Tensile, "lateral: free", "length", "eps_b [%], sigma_b [N/m]", (0.5, 20)),
    "bias_extension": (ff.BiasExtension, "", "height", "displacement [m], F [N]", (1e-3, 1)),
}


def written(folder, test, rows, sizes=(200, 50), sheet=SHEET):
    """The rows of a history (n, 2) as the file of a test."""
    _, key, length, header, factors = TESTS[test]
    head = [f"test: {test}", f"{length}: {sizes[0]} mm", f"width: {sizes[1]} mm", key]
    lines = [*(f"# {line}" for line in head if line), header]
    lines += [f"{d:.12g}, {f:.12g}" for d, f in np.asarray(rows) * factors]
    (folder / "sheet.toml").write_text(sheet)
    (folder / f"{test}.csv").write_text("\n".join(lines))
    return str(folder / f"{test}.csv")


def history(result):
    return np.array([[row["displacement_mm"], row["reaction_N"]] for row in result.rows])


@pytest.mark.parametrize("test", TESTS)
def test_a_run_laid_over_itself(tmp_path, test):
    """Forces 3 % higher than the run's own, beyond its end too, in the units of the test."""
    kind, turned = TESTS[test][0], {"fibre_angle": 90} if test == "uniaxial_b" else {}
    fields = {**SIZE, **turned, "strain": 0.04}
    rows = history(kind(**fields).job(steps=6).run(pictures=False))[1:] * [1, 1.03]
    rows[-1] *= 1.001  # beyond the run's end
    file = written(tmp_path, test, rows)
    made = kind(**fields, measured=file).build()
    assert not made.warnings
    result = made.job(steps=6).run(tmp_path / "out")
    (found,) = json.loads((tmp_path / "out" / "summary.json").read_text())["quantities"]["measured"]
    assert (found["file"], found["test"]) == (f"{test}.csv", test)
    assert (found["points"], found["points_covered"]) == (6, 5)
    assert (found["from_mm"], found["to_mm"]) == pytest.approx((rows[0, 0], rows[4, 0]), rel=1e-6)
    assert found["largest_of_peak"] == pytest.approx(0.03 / 1.03, rel=2e-3)
    off = rows[:5, 1] * 0.03 / 1.03
    assert found["rms_N"] == pytest.approx(np.sqrt(np.mean(off**2)), rel=2e-3)
    assert found["rms_of_peak"] == pytest.approx(found["rms_N"] / rows[4, 1], rel=1e-6)
    (curve,) = made.reference_curves().values()
    assert np.array(curve).T == pytest.approx(rows, rel=1e-6)
    assert result.summary["converged"]


@pytest.mark.parametrize(
    "test, sizes, sheet, words",
    [
        ("uniaxial_a", (300, 50), SHEET, "length 300 mm and width 50 mm, the run of one of 200 x"),
        ("bias_extension", (200, 60), SHEET, "height 200 mm and width 60 mm, the run of one of"),
        ("uniaxial_a", (200, 50), SHEET.replace("1.0", "0.8"), "sheet of 0.8 mm, the material of"),
    ],
)
def test_what_still_can_be_compared_is_warned_of(tmp_path, test, sizes, sheet, words):
    rows = np.outer(range(1, 7), [1, 10])
    made = TESTS[test][0](**SIZE, measured=written(tmp_path, test, rows, sizes, sheet)).build()
    (warning,) = made.warnings
    assert words in warning
    force = made.laid[0].force
    if test == "uniaxial_a":  # force per width at the same strain
        assert made.laid[0].displacement == pytest.approx(rows[:, 0] * 200 / sizes[0])
        assert force == pytest.approx(rows[:, 1])


@pytest.mark.parametrize(
    "kind, fields, file, words",
    [
        (ff.Tensile, {}, "komeili_all/uniaxial_b.csv", "but uniaxial_b; allowed is a tension test"),
        (ff.Tensile, {"fibre_angle": 30}, "komeili_all", "allowed is `fibre_angle` 0 or 90"),
        (ff.BiasExtension, {}, "komeili_all/shear_tension_a.csv", "allowed is bias_extension"),
        (ff.BiasExtension, {"strain": 0.01}, "glass_pp_115x230", "allowed is a `strain` above 0.0"),
    ],
)
def test_what_cannot_be_compared_is_refused(kind, fields, file, words):
    with pytest.raises(ff.InputError) as error:
        kind(**SIZE, **fields, measured=str(SHIPPED / file)).build()
    assert words in str(error.value)


def test_a_sheet_toml_stands_for_its_folder():
    made = ff.BiasExtension(**SIZE, measured=str(SHIPPED / "komeili_all" / "sheet.toml")).build()
    assert [each.file for each in made.laid] == ["shear.csv"]


@pytest.mark.parametrize(
    "kind, fields, integration",
    [
        (ff.Tensile, {"pattern": "unstructured"}, "full"),  # yarns along the load
        (ff.Tensile, {"fibre_angle": 20}, "full"),  # cells along the yarns
        (ff.Tensile, {"fibre_angle": 20, "pattern": "crossed", "turned": 30}, "inner"),
        (ff.Tensile, {"fibre_angle": 20, "element": "P1"}, "full"),
        (ff.BiasExtension, {}, "full"),
        (ff.BiasExtension, {"pattern": "left"}, "inner"),
        (ff.BiasExtension, {"fibre_angle": 30}, "full"),
        (ff.BiasExtension, {"fibre_angle": 30, "pattern": "crossed"}, "inner"),
    ],
)
def test_points_are_inner_where_quadratic_cells_do_not_follow_the_yarns(kind, fields, integration):
    assert kind(nx=16, **fields).build().data.integration == integration


@pytest.mark.parametrize("angle, pattern", [(0, "crossed"), (45, "graded"), (-45, "graded")])
def test_cells_do_not_change_with_an_angle_as_little_as_rounding(angle, pattern):
    for by in (-1e-10, 0.0, 1e-10):
        assert ff.BiasExtension(fibre_angle=angle + by).build().data.pattern == pattern
    assert ff.BiasExtension(fibre_angle=angle + 2).build().data.pattern == "yarns"


# test, angle, strain, pattern, nx, and the force [N] of P3 on fine cells along the corners' yarns
OFF_AXIS = [
    (ff.BiasExtension, 30, 0.1, "left", 36, 1.990),
    (ff.Tensile, 45, 0.03, "unstructured", 34, 0.10895),
    (ff.Tensile, 30, 0.03, "left", 36, 0.14236),
]


def test_estimated_errors_off_axis_cover_the_true_one(tmp_path):
    strip = ff.BiasExtension(fibre_angle=30, pattern="unstructured", nx=32)
    result = strip.job(steps=8, error=True).run(tmp_path / "out", pictures=False)
    true = abs(result.summary["reaction_N"] - 1.990)
    assert 0.02 < true <= result.summary["error"]["reaction_N"] < 20 * true


@pytest.mark.parametrize("kind, angle, strain, pattern, nx, force", OFF_AXIS)
def test_forces_off_axis_with_3000_unknowns(kind, angle, strain, pattern, nx, force):
    strip = kind(fibre_angle=angle, strain=strain, pattern=pattern, nx=nx, ny=round(nx / 4))
    result = strip.job(steps=4, limits=ff.Limits()).run(pictures=False)
    assert result.summary["dofs"] <= 3000
    assert result.rows[-1]["reaction_N"] == pytest.approx(force, rel=0.06)


def test_yarns_at_10_deg_to_the_load():
    """A small strain: at 3 % a few cells stretch by more than 10 % and turn over on any mesh."""
    strip = ff.Tensile(fibre_angle=10, strain=0.005, pattern="crossed", nx=26, ny=6)
    result = strip.job(steps=4).run(pictures=False)
    assert result.rows[-1]["reaction_N"] == pytest.approx(95.96, rel=0.06)
