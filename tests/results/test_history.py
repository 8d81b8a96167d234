"""The history's work and energies, measures over a sheet, and estimated errors."""

import csv
import json
from types import SimpleNamespace

import numpy as np
import pytest
from builders import COMM
from made_results import made, strip
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.results import measures
from fabric_fenicsx.results.error import Rule, curve_errors, estimate, lag_of, mesh_decides, rule
from fabric_fenicsx.results.history import History, energy_balance, viscous_warning
from fabric_fenicsx.sheet.specimen import specimen
from fabric_fenicsx.solve.progress import Accepted, Report


def test_a_row_has_each_number_under_its_name(tmp_path):
    """The imbalance is of energies of 8 N mm; the residual is the last one. What NumPy gave is kept
    as plain numbers."""
    report = Report(True, "", np.int32(7), 2, 3, 1, 4, np.float32(50), [9.0, 1e-3, 1e-7])
    kinds = {"strain": 4.0, "metal": 1.0, "viscous": 0.25, "bending": 2.75}
    state = Accepted(0.5, kinds, 10.0, report, 5, 1.23456, None)
    history = History(tmp_path / "history.csv", MPI.COMM_SELF)
    own = {"own": 6.0, "min_stability": 0.1}
    history.add(state, np.float32(1.5), np.int64(20), lambda taken: own)
    expected = {
        **{"step": 0, "load": 0.5, "displacement_mm": 1.5, "reaction_N": 20.0},
        **{f"{kind}_energy_Nmm": value for kind, value in kinds.items()},
        **{"contact_energy_Nmm": 0.0, "friction_energy_Nmm": 0.0, "external_work_Nmm": 10.0},
        **{"energy_imbalance": 0.25, "iterations": 7, "saddles": 4, "shifts": 2},
        **{"line_search_cuts": 3, "cuts": 5, "negative_pivots": 1, "residual_N": 1e-7},
        **{"force_scale_N": 50.0, "min_stability": 0.1, "wall_s": 1.2346, "own": 6.0},
    }
    assert json.loads(json.dumps(history.rows)) == [expected]
    with pytest.raises(InputError, match="load 0.5 the terms no longer return the column own"):
        history.add(state, 1.5, 20.0, lambda taken: {})
    (row,) = csv.DictReader((tmp_path / "history.csv").open())
    assert {name: float(value) for name, value in row.items()} == expected


def row(load, work, strain):
    return {
        **{"load": load, "external_work_Nmm": work, "strain_energy_Nmm": strain - 0.5},
        **{"metal_energy_Nmm": 0.5, "saddles": int(load == 0.1)},
        "energy_imbalance": abs(work - strain) / (strain or 1.0) if load else 0.0,
    }


def test_the_largest_imbalance_is_over_the_largest_energies():
    """6 of 50 N mm are more than 1 of 1, and than 20 of 120 over the work."""
    rows = [row(0.0, 3.0, 1.0), row(0.1, 2.0, 1.0), row(0.5, 56.0, 50.0), row(1.0, 98.0, 100.0)]
    energy = {"strain": 99.5, "metal": 0.5, "external_work": 98.0}
    assert energy_balance(rows, energy) == {
        "energy_imbalance": 0.02,
        "energy_imbalance_largest": {"value": pytest.approx(0.06), "load": 0.5},
        "branches": [0.1],
    }
    still = energy_balance([row(0.0, 0.0, 0.0)], dict.fromkeys(energy, 0.0))
    assert still["energy_imbalance_largest"] == {"value": 0.0, "load": 0.0}


def test_drag_is_compared_with_all_that_stretching_stores():
    """Metal alone stores no "strain", bending is not of stretching, and a sheet that nothing has
    stretched yet stores nothing; told is the first step with more than 1 %."""
    rest = {f"{kind}_energy_Nmm": 9.0 for kind in ("bending", "contact", "friction")}
    rows = [rest | {"strain_energy_Nmm": 0.0, "viscous_energy_Nmm": 0.0}]
    rows.append(rows[0] | {"viscous_energy_Nmm": 0.3})
    assert "took more than 1000 % of the strain" in viscous_warning(rows, 0.5)
    rows[1]["metal_energy_Nmm"] = 10.0
    assert "(step 1) the regularisation took 3 % of the strain" in viscous_warning(rows, 0.5)
    assert not viscous_warning([rows[1]] * 2, 0.5)
    for drag, told in ((0.101, True), (0.099, False)):
        assert bool(viscous_warning([rows[0], rows[1] | {"viscous_energy_Nmm": drag}], 1)) == told


@pytest.mark.mpi
@pytest.mark.parametrize(
    "pattern, cell", [("graded", "triangle"), ("unstructured", "quadrilateral")]
)
def test_a_hole_is_seen(pattern, cell):
    """Of a sheet of 200 x 50 mm without the cells nearer than 9 mm to its middle."""

    def sheet(hole):
        x, cells, kind = specimen(nx=24, ny=6, pattern="unstructured", cell=cell)
        cells = cells[np.linalg.norm(x[cells].mean(1) - [100, 25, 0], axis=1) >= hole]
        return ff.Blank.from_arrays(COMM, *((x, cells, kind) if COMM.rank == 0 else 3 * (None,)))

    whole, holed = sheet(0.0), sheet(9.0)
    assert measures.covers(whole, (100, 25)) and not measures.covers(holed, (100, 25))
    for blank in (whole, holed):  # nodes, edges, corners of the sheet, and what lies beside it
        places = (0, 0), (200, 50), (50, 25), *np.random.default_rng(0).uniform(1, 15, (20, 2))
        assert all(measures.covers(blank, p) for p in places)
        assert not any(measures.covers(blank, p) for p in ((-0.1, 25), (200.1, 25), (100, 50.1)))


@pytest.mark.mpi
def test_means_and_quantiles_are_by_weight():
    """Each value in the middle of its weight: at 1, 3, 5.5 and 7.5 of 8; an exact linear sample."""
    mine = np.arange(COMM.rank, 4, COMM.size)
    values, weights = np.array([[3.0, 1, 7, 2], [3, 2, 1, 2]])[:, mine]
    assert measures.mean(COMM, values, weights) == 22 / 8
    assert measures.mean(COMM, values, 0 * weights) is None
    found = measures.quantiles(COMM, values, weights, (0.1, 0.25, 0.5, 0.75, 0.99))
    assert found == pytest.approx([1, 1.5, 2.4, 4, 7])
    assert measures.extremes(COMM, values) == (1, 7)
    sample = np.arange(COMM.rank, 100, COMM.size) + 0.5
    assert measures.quantiles(COMM, sample, 0 * sample + 2, (0.01, 0.99)) == pytest.approx([1, 99])


def test_places_near_a_point_are_within_the_radius_or_the_nearest():
    places = np.array([[3.0, 0, 0, -5.1], [0, 4.9, 5.1, 0], [9, 9, 9, 9]])
    assert measures.near(COMM, places, (0, 0), 5.0).tolist() == [True, True, False, False]
    assert measures.near(COMM, places, (0, 20), 5.0).tolist() == [False, False, True, False]


@pytest.mark.mpi
def test_of_values_that_differ_by_rounding_the_first_row_is_told():
    """Whichever ranks have them, and if some have none."""
    mine = np.arange(COMM.rank, 4, COMM.size)
    values = np.array([5.0, 7.0, 7.0 * (1 + 1e-9), 6.0])[mine]
    rows = np.array([[0.0, 1], [2, 0], [2, 1], [1, 1]])[mine]
    largest, row = measures.where_largest(COMM, values, rows)
    assert largest == 7.0 * (1 + 1e-9) and row == [2, 0]
    values[mine == 1] = 7.0 * (1 - 2e-6)  # no rounding
    assert measures.where_largest(COMM, values, rows)[1] == [2, 1]
    assert measures.where_largest(COMM, -values, rows) == (-5, [0, 1])


def rows(loads, forces):
    return [{"load": x, "reaction_N": f} for x, f in zip(loads, forces)]


def both(first, second, loads=(0, 0.5, 1), **options):
    """The rules for cells of another kind and of the same."""
    runs = rows(loads, first), rows(loads, second)
    return [rule(*runs, of_other_kind=kind, **options) for kind in (True, False)]


def test_lines_of_unequal_steps_err_by_the_longer_one():
    """h^2 / 8 of the second derivative of 5 x^2, of steps of 0.2 and 0.8; of two points nothing."""
    run = rows((0, 0.2, 1), (0, 0.2, 5))
    by = Rule(2.0, 0.1)
    of_mesh, of_lines = curve_errors(run, rows((0, 1), (0, 4.8)), by)
    assert of_lines == pytest.approx([0.8**2 / 8 * 10] * 3)
    assert of_mesh == pytest.approx([0, 2 * 0.04, 0.5])  # 0.2 N are off at 1, 0.04 before
    assert curve_errors(run[::2], run[::2], by)[1].tolist() == [0, 0]


def test_a_chance_agreement_tells_nothing():
    """Curves that cross at full load are 20 and 30 % apart before, from half of the load on; forces
    of a tool that has gone back are compared with at least 5 % of the largest."""
    other_kind, same_kind = both((0, 3, 5, 7, 10), (9, 1, 6, 4.9, 10), (0, 0.25, 0.5, 0.75, 1))
    assert other_kind == pytest.approx((1.75, 0.3))
    # root mean square with the end's 0
    assert same_kind == pytest.approx((1.0, np.sqrt((0.2**2 + 0.3**2) / 3)))
    share = np.hypot(0.1, 0.01 / 0.5) / np.sqrt(2)
    assert both((0, 10.0, 0.0), (0, 9.0, 0.01))[1].share == pytest.approx(share)


def test_the_error_of_a_number_is_by_its_difference_or_its_share():
    by = Rule(1.75, 0.1)
    assert by.error(-10.0, -2.0) == 3.5 and by.error(10.0, 0.5) == 1.0
    assert by.errors([-10.0, 10.0], [-2.0, 0.5]).tolist() == [3.5, 1.0]
    assert by.error(10.0, 2.85) == pytest.approx(4.9875) and by.error(10.0, 2.86) is None


@pytest.mark.parametrize(
    "apart, lag, share", [(2e-3, 0, 2e-3), (2e-4, 0, 1e-3), (2e-4, 0.004, 0.008), (5e-7, 0.1, 5e-7)]
)
def test_two_runs_know_no_error_below_a_thousandth_and_twice_the_lag(apart, lag, share):
    """Unless they agree to rounding."""
    force = np.array([0, 5, 10.0])
    assert both(force, force * (1 + apart), lag=lag)[0].share == pytest.approx(share)


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
    and beside them the nearest. Curves are 10 % apart in the end, and on the way 0.2 N of 2;
    energies 25 % and 20 %."""
    fields = {"log_eps_11": (0.1, 0.3), "shear_angle": (-0.4, 0.2)}
    run = made(strip((1, 3)), **fields)
    others = {"log_eps_11": (0.12, 0.12, 0.28, 0.28), "shear_angle": (-0.4, -0.4, 4 / 15, 4 / 15)}
    other = made(strip((2, 2), (5, 5)), **others)
    run.fields.units["shear_angle"] = "rad"
    run.rows, other.rows = rows((0, 0.5, 1), (0, 2.0, 10)), rows((0, 0.5, 1), (0, 1.8, 9.0))
    for result, way, end in ((run, 1.0, 4.0), (other, 0.8, 3.0)):
        for row, energy in zip(result.rows, (0.0, way, end)):
            row["strain_energy_Nmm"] = energy
    for result, force, strain, own in ((run, 10.0, 4.0, 1.0), (other, 9.0, 3.0, 0.9)):
        result.summary |= {"reaction_N": force, "energy": {"strain": strain}}
        most = {"shear_angle_99_percent_deg": 2 * own, "shear_angle_99_percent_of_means_deg": 1.5}
        result.summary["quantities"] = {"own": {"force_N": own}, "text": "a", **most}
    names = "own.force_N", "text", "shear_angle_99_percent_deg"
    errors = estimate(run, other, names, of_other_kind=False, forces_only=False)
    eps = abs(np.array([0.1, 0.3]) - [0.12, 0.12 + 0.75 * 0.16])
    by_area = [1 / 4, 3 / 4]
    assert errors == {
        "reaction_N": pytest.approx(1.0),
        "strain_energy_Nmm": pytest.approx(1.5 * 4 * np.sqrt((0.2**2 + 0.25**2) / 2)),
        "own.force_N": pytest.approx(0.1),
        "shear_angle_99_percent_deg": pytest.approx(0.5),  # from 2 deg to 1.5 of means
        "curve_N": pytest.approx(1.75),
        "curve_steps_N": pytest.approx(0.75),  # slopes of 4 and 16 N, h^2 / 8 of their 24
        "log_eps_11_rms": pytest.approx(
            max(np.sqrt(by_area @ eps**2), 0.1 * np.sqrt(by_area @ np.square(fields["log_eps_11"])))
        ),
        "shear_angle_rms_deg": pytest.approx(np.degrees(np.sqrt(0.75 * 0.1**2))),
    }
    assert [row["error_N"] for row in run.rows] == pytest.approx([0.75, 0.95, 1.75])
    share = errors["log_eps_11_rms"] / np.sqrt(by_area @ eps**2)
    assert run.fields["error_log_eps_11"].sum() / eps.sum() == pytest.approx(share)
    forces = estimate(run, other, names, of_other_kind=True, forces_only=True)
    kept = "reaction_N", "strain_energy_Nmm", names[0], names[2], "curve_N", "curve_steps_N"
    assert [name for name, error in forces.items() if error is not None] == [*kept]
    assert forces["strain_energy_Nmm"] == pytest.approx(1.75)
