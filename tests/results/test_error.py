"""Estimated errors of numbers, curves and fields, from two runs that are known."""

from types import SimpleNamespace

import numpy as np
import pytest
from made_results import made, strip

from fabric_fenicsx.results.error import Rule, curve_errors, estimate, lag_of, mesh_decides, rule


def rows(loads, forces):
    return [{"load": x, "reaction_N": f} for x, f in zip(loads, forces)]


def both(first, second, loads=(0, 0.5, 1), **options):
    """The rules for cells of another kind and of the same."""
    runs = rows(loads, first), rows(loads, second)
    return [rule(*runs, of_other_kind=kind, **options) for kind in (True, False)]


@pytest.mark.parametrize("order", [1.0, 3.0])
def test_the_errors_of_a_curve_are_covered(order):
    """A parabola that a mesh of size h puts off by h^order, and the lines that join its points."""
    loads = [np.linspace(0, 1, n) for n in (11, 6)]
    run, other = (rows(load, 5 * load**2 + load * h**order) for load, h in zip(loads, (0.1, 0.2)))
    of_mesh, of_lines = curve_errors(run, other, Rule(1.0, 1.0, 0.0))
    errors = of_mesh + of_lines
    fine = np.linspace(0, 1, 201)
    joined = np.interp(fine, loads[0], [row["reaction_N"] for row in run])
    off = np.abs(joined - 5 * fine**2)
    assert (np.interp(fine, loads[0], errors) >= off - 1e-12).all()
    assert errors.max() < 3 * off.max()
    assert of_lines == pytest.approx(np.full(11, 5 * 0.1**2 / 4))


def test_lines_of_unequal_steps_err_by_the_longer_one():
    """h^2 / 8 of the second derivative of 5 x^2, of steps of 0.2 and 0.8; of two points nothing."""
    run = rows((0, 0.2, 1), (0, 0.2, 5))
    by = Rule(2.0, 1.0, 0.1)
    of_mesh, of_lines = curve_errors(run, rows((0, 1), (0, 4.8)), by)
    assert of_lines == pytest.approx([0.8**2 / 8 * 10] * 3)
    assert of_mesh == pytest.approx([0, 2 * 0.04, 0.5])  # 0.2 N are off at 1, 0.04 before
    assert curve_errors(run[::2], run[::2], by)[1].tolist() == [0, 0]


def test_a_chance_agreement_tells_nothing():
    """Curves that cross at full load are 20 and 30 % apart before, from half of the load on."""
    other_kind, same_kind = both((0, 3, 5, 7, 10), (9, 1, 6, 4.9, 10), (0, 0.25, 0.5, 0.75, 1))
    assert other_kind == pytest.approx((1.75, 1.75, 0.3))
    # root mean square with the end's 0
    assert same_kind == pytest.approx((1.0, 0.5, np.sqrt((0.2**2 + 0.3**2) / 3)))


def test_the_error_of_a_number_is_by_its_difference_or_its_share():
    by = Rule(1.75, 0.5, 0.1)
    assert by.error(-10.0, -2.0) == 3.5 and by.error(-10.0, -2.0, is_energy=True) == 1.0
    assert by.error(10.0, 0.5) == 1.0
    assert by.errors([-10.0, 10.0], [-2.0, 0.5]).tolist() == [3.5, 1.0]
    assert by.error(10.0, 2.85) == pytest.approx(4.9875) and by.error(10.0, 2.86) is None


@pytest.mark.parametrize(
    "apart, lag, share", [(2e-3, 0, 2e-3), (2e-4, 0, 1e-3), (2e-4, 0.004, 0.008), (5e-7, 0.1, 5e-7)]
)
def test_two_runs_know_no_error_below_a_thousandth_and_twice_the_lag(apart, lag, share):
    """Unless they agree to rounding."""
    force = np.array([0, 5, 10.0])
    assert both(force, force * (1 + apart), lag=lag)[0].share == pytest.approx(share)


def test_a_tool_that_has_gone_back_tells_no_share():
    """Forces are compared with at least 5 % of the largest."""
    share = np.hypot(0.1, 0.01 / 0.5) / np.sqrt(2)
    assert both((0, 10.0, 0.0), (0, 9.0, 0.01))[1].share == pytest.approx(share)


def test_lag_is_the_largest_of_the_terms_and_their_friction():
    lags = (0.01, 0.002), (None, 0.03), (np.inf, None)
    terms = [SimpleNamespace(lag=a, coulomb=SimpleNamespace(lag=b)) for a, b in lags]
    assert lag_of(SimpleNamespace(terms=[SimpleNamespace(), *terms])) == 0.03
    assert lag_of(SimpleNamespace(terms=[])) == 0.0


@pytest.mark.parametrize("crumples, bands, spatial", [(1, 0, 0), (0, 1, 1), (0, 1, 0), (0, 0, 1)])
def test_the_mesh_decides_where_cells_crumple_or_the_law_allows_bands(
    monkeypatch, crumples, bands, spatial
):
    monkeypatch.setattr("fabric_fenicsx.scene.output.has_bands", lambda scene: bands)
    result = made(strip((1, 3), spatial=bool(spatial)))
    result.summary["quantities"] = {"shortening_at_shear_angle_max": 0.06 * crumples}
    expected = "cells crumple" if crumples else "the law allows bands" if bands and spatial else ""
    assert mesh_decides(result) == expected


def test_errors_of_all_that_is_told():
    """Cells of 1 and 3 mm; what is between centres, at 0.5 and 2.5 mm, is linear in the other run,
    and beside them the nearest. Curves are 10 % apart in the end, and on the way 0.2 N of 2."""
    fields = {"log_eps_11": (0.1, 0.3), "shear_angle": (-0.4, 0.2)}
    run = made(strip((1, 3)), **fields)
    others = {"log_eps_11": (0.12, 0.12, 0.28, 0.28), "shear_angle": (-0.4, -0.4, 4 / 15, 4 / 15)}
    other = made(strip((2, 2), (5, 5)), **others)
    run.fields.units["shear_angle"] = "rad"
    run.rows, other.rows = rows((0, 0.5, 1), (0, 2.0, 10)), rows((0, 0.5, 1), (0, 1.8, 9.0))
    for result, force, strain, own in ((run, 10.0, 4.0, 1.0), (other, 9.0, 3.0, 0.9)):
        result.summary |= {"reaction_N": force, "energy": {"strain": strain}}
        result.summary["quantities"] = {"own": {"force_N": own}, "text": "a"}
    names = "own.force_N", "text"
    errors = estimate(run, other, names, of_other_kind=False, forces_only=False)
    eps = abs(np.array([0.1, 0.3]) - [0.12, 0.12 + 0.75 * 0.16])
    by_area = [1 / 4, 3 / 4]
    assert errors == {
        "reaction_N": pytest.approx(1.0),
        "strain_energy_Nmm": pytest.approx(0.5),
        "own.force_N": pytest.approx(0.1),
        "curve_N": pytest.approx(1.75),
        "curve_steps_N": pytest.approx(0.75),  # slopes of 4 and 16 N, h^2 / 8 of their 24
        "log_eps_11_rms": pytest.approx(
            max(np.sqrt(by_area @ eps**2), 0.1 * np.sqrt(by_area @ np.square(fields["log_eps_11"])))
        ),
        "shear_angle_rms_deg": pytest.approx(np.degrees(np.sqrt(0.75 * 0.1**2))),
    }
    assert [row["error_N"] for row in run.rows] == pytest.approx([0.75, 0.95, 1.75])
    assert run.fields["error_log_eps_11"].sum() / eps.sum() == pytest.approx(
        errors["log_eps_11_rms"] / np.sqrt(by_area @ eps**2)
    )
    forces = estimate(run, other, names, of_other_kind=True, forces_only=True)
    kept = "reaction_N", "strain_energy_Nmm", "own.force_N", "curve_N", "curve_steps_N"
    assert [name for name, error in forces.items() if error is not None] == [*kept]
    assert forces["strain_energy_Nmm"] == pytest.approx(1.75)
