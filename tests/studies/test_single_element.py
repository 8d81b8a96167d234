"""One element, kernel and closed form are one curve."""

import csv

import pytest


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
