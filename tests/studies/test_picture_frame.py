"""Small studies as a user runs them."""

import csv

import pytest


@pytest.mark.versions
@pytest.mark.parametrize(
    "options",
    [
        pytest.param((), marks=pytest.mark.mpi),
        ("--pre-tension", 0.01),
        ("--element", "Q2", "--angle", 60),
    ],
)
def test_normalised_shear_force(launch, options):
    drawn = not options  # one picture will do
    pictures = () if drawn else ("--no-pictures",)
    done = launch("picture_frame", "--quick", "--steps", 10, *options, *pictures)
    assert done.status == 0, done.err
    s, q = done.summary, done.summary["quantities"]
    force, angle = q["normalised_shear_force_N_per_mm"], q["shear_angle_deg"] / 57.29577951308232
    assert force == pytest.approx(q["closed_form_N_per_mm"], rel=1e-8)
    assert q["shear_angle"] == pytest.approx([angle] * 2, abs=1e-7)
    pre = options[1] if "--pre-tension" in options else 0
    assert q["eps_a"] + q["eps_b"] == pytest.approx([pre] * 4, abs=1e-7)
    assert s["kernel_mismatch"] <= 1e-10
    assert not drawn or (done.folder / "shear_force.png").stat().st_size > 10_000


@pytest.mark.versions
@pytest.mark.parametrize("element", ["Q1", pytest.param("P1", marks=pytest.mark.mpi)])
def test_elements_and_kernel_hit_the_closed_form(launch, element):
    done = launch("single_element", "--element", element)
    assert done.status == 0, done.err
    q = done.summary["quantities"]
    assert len(q["differences"]) == 28 and max(q["largest_difference"].values()) <= 1e-9
    assert done.summary["kernel_mismatch"] <= 1e-10
    with open(done.folder / "curves.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 28 * 47
    kinks = [r for r in rows if r["path"] == "equibiaxial" and abs(float(r["eps_a"])) < 1e-12]
    assert len(kinks) == 2 and all(abs(float(r["sigma_a_elements_MPa"])) < 1e-9 for r in kinks)
    coupled = [r for r in rows if r["path"] == "constrained uniaxial a"]
    last = [r for r in coupled if float(r["eps_a"]) > 0.0299]
    stress = {r["model"]: float(r["sigma_b_elements_MPa"]) for r in last}
    wanted = 0.25 * 23.67 * (4130 * 0.03**3 + 667.5 * 0.03**2)
    assert abs(stress["FABRIC"]) < 1e-15
    assert stress["hyperelastic"] == pytest.approx(wanted, rel=1e-9)
    assert (done.folder / "fig7.png").stat().st_size > 10_000


@pytest.mark.versions
def test_maps(launch):
    done = launch("stability_map", "--points", 21)
    assert done.status == 0, done.err
    q = done.summary["quantities"]
    assert done.summary["converged"]
    assert done.summary["kernel_mismatch"] < 1e-12
    for name in ("p_min", "c", "d", "s_C"):
        assert (done.folder / f"{name}.png").stat().st_size > 10_000
    names = [f"0 deg, p_min {p}" for p in (0, 0.25, 0.75)]
    low, middle, high = (q["share_of_map_lost"][name]["convexity"] for name in names)
    assert low > middle > high
