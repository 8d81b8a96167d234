"""Measured curves laid over the simulated ones of strips."""

from pathlib import Path
from types import SimpleNamespace

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


@pytest.mark.parametrize("test", TESTS)
def test_a_measured_curve_in_the_units_of_its_test(tmp_path, test):
    turned = {"fibre_angle": 90} if test == "uniaxial_b" else {}
    rows = np.column_stack([np.arange(1.0, 7), np.arange(1.0, 7) ** 2])
    file = written(tmp_path, test, rows)
    made = TESTS[test][0](**SIZE, **turned, strain=0.0275, measured=file).build()
    assert not made.warnings
    (curve,) = made.reference_curves().values()
    assert np.array(curve).T == pytest.approx(rows, rel=1e-6)
    run = [{"displacement_mm": d, "reaction_N": f} for d, f in [(0, 0), (5.5, 5.5 * 4)]]
    (found,) = made.against_curves(SimpleNamespace(rows=run))["measured"]
    assert (found["file"], found["test"]) == (f"{test}.csv", test)
    assert found["largest_N"] == pytest.approx(5, rel=1e-6)  # 20 for 25


def test_a_measured_shear_stress_is_a_force_by_the_work_it_does(tmp_path):
    degrees = np.arange(1, 31)
    g, tau = np.radians(degrees), 0.05 * np.radians(degrees)
    text = "".join(f"{a}, {b:.9g}\n" for a, b in zip(degrees, tau))
    (tmp_path / "sheet.toml").write_text(SHEET.replace("1.0", "0.8"))
    (tmp_path / "t.csv").write_text(f"# test: shear\ngamma [deg], tau [MPa]\n{text}")
    made = ff.BiasExtension(**SIZE, strain=0.2, measured=str(tmp_path / "t.csv")).build()
    (curve,) = made.laid
    assert curve.displacement == pytest.approx(150 * (np.cos(g / 2) + np.sin(g / 2) - 1))
    zones = 0.8 * (tau * 50 * (400 - 150) / 2 + tau / 2 * 50**2 / 2)
    force = zones / (150 / 2 * (np.cos(g / 2) - np.sin(g / 2)))
    assert curve.force == pytest.approx(force, rel=2e-3)


@pytest.mark.parametrize(
    "sizes, thickness, words",
    [
        ((300, 40), "1.0", "length 300 mm and width 40 mm, the run of one of 200 x"),
        ((202.1, 50), "1.0", "length 202.1 mm and width 50 mm, the run of"),
        ((200, 50), "0.989", "of 0.989 mm, the material"),
        ((201.9, 50), "0.991", ""),
    ],
)
def test_what_still_can_be_compared_is_warned_of(tmp_path, sizes, thickness, words):
    """From 1 % of a size on; as force per width at the same strain."""
    rows, sheet = np.outer(range(1, 7), [1, 10]), SHEET.replace("1.0", thickness)
    file = written(tmp_path, "uniaxial_a", rows, sizes, sheet)
    made = ff.Tensile(**SIZE, measured=file).build()
    assert len(made.warnings) == bool(words) and words in "".join(made.warnings)
    assert made.laid[0].displacement == pytest.approx(rows[:, 0] * 200 / sizes[0])
    assert made.laid[0].force == pytest.approx(rows[:, 1] * 50 / sizes[1])


def test_what_cannot_be_compared_is_refused():
    for kind, fields, file, words in (
        (ff.Tensile, {}, "komeili_all/uniaxial_b.csv", "but uniaxial_b; allowed is a tension test"),
        (ff.Tensile, {"fibre_angle": 30}, "komeili_all", "allowed is `fibre_angle` 0 or 90"),
        (ff.BiasExtension, {"strain": 0.01}, "glass_pp_115x230", "allowed is a `strain` above 0.0"),
    ):
        with pytest.raises(ff.InputError, match=words):
            kind(**SIZE, **fields, measured=str(SHIPPED / file)).build()


def test_a_run_that_ends_before_the_first_measured_force_is_refused(tmp_path):
    rows = [(1, 0), (3, 0), (5, 0), (7, 1), (9, 2), (11, 3)]
    file = written(tmp_path, "uniaxial_a", rows)
    ff.Tensile(**SIZE, strain=0.036, measured=file).build()
    with pytest.raises(ff.InputError, match="begins at 7 mm, and the run ends at 6.8 mm"):
        ff.Tensile(**SIZE, strain=0.034, measured=file).build()


def test_a_sheet_toml_stands_for_its_folder():
    made = ff.BiasExtension(**SIZE, measured=str(SHIPPED / "komeili_all" / "sheet.toml")).build()
    assert [each.file for each in made.laid] == ["shear.csv"]


@pytest.mark.parametrize(
    "kind, fields, integration",
    [
        (ff.Tensile, {"pattern": "unstructured"}, "full"),  # yarns along the load
        (ff.Tensile, {"fibre_angle": 20, "pattern": "crossed", "turned": 30}, "inner"),
        (ff.Tensile, {"fibre_angle": 20, "element": "P1"}, "full"),
        (ff.BiasExtension, {}, "full"),
        (ff.BiasExtension, {"pattern": "left"}, "inner"),
        (ff.BiasExtension, {"fibre_angle": 30, "pattern": "crossed"}, "inner"),
    ],
)
def test_points_are_inner_where_quadratic_cells_do_not_follow_the_yarns(kind, fields, integration):
    assert kind(nx=16, **fields).build().data.integration == integration


@pytest.mark.parametrize(
    "fields, pattern",
    [
        *(({"fibre_angle": 45 + by}, "graded") for by in (-90.0, -1e-10, 1e-10)),
        ({"fibre_angle": 0.9}, "crossed"),
        ({"fibre_angle": 1.1}, "yarns"),
        ({"fibre_angle": 47}, "yarns"),
        ({"strain": 0.199}, "graded"),
        ({"strain": 0.201}, "crossed"),
    ],
)
def test_cells_by_angle_and_strain(fields, pattern):
    assert ff.BiasExtension(nx=24, **fields).build().data.pattern == pattern


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
