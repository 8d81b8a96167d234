"""What a run's history says of work and energies."""

from fabric_fenicsx.results.history import energy_balance, viscous_warning


def row(load, work, strain):
    missing = abs(work - strain) / strain
    return {
        "load": load,
        "external_work_Nmm": work,
        "strain_energy_Nmm": strain,
        "energy_imbalance": missing if load else 0.0,
        "saddles": 0,
    }


def test_the_largest_imbalance_is_over_the_largest_energies():
    rows = [row(0.0, 3.0, 1.0), row(0.1, 2.0, 1.0), row(0.5, 54.0, 50.0), row(1.0, 101.0, 100.0)]
    found = energy_balance(rows, {"strain": 100.0, "external_work": 101.0})
    assert found["energy_imbalance"] == 0.01
    assert found["energy_imbalance_largest"] == {"value": 0.04, "load": 0.5}


def test_nothing_is_out_of_balance_where_nothing_is_stored():
    rows = [{**row(0.0, 0.0, 1.0), "strain_energy_Nmm": 0.0}]
    found = energy_balance(rows, {"strain": 0.0, "external_work": 0.0})
    assert found["energy_imbalance_largest"] == {"value": 0.0, "load": 0.0}


def test_drag_is_compared_with_all_that_stretching_stores():
    """Metal alone stores no "strain", and a sheet that nothing has stretched yet stores nothing."""
    rows = [row(0.5, 0.0, 1.0) | {"strain_energy_Nmm": 0.0, "viscous_energy_Nmm": 0.0}]
    rows.append(rows[0] | {"viscous_energy_Nmm": 0.3})
    assert "has taken more than 1000 % of the strain" in viscous_warning(rows, 0.5)
    rows[1]["metal_energy_Nmm"] = 10.0
    assert "has taken 3 % of the strain" in viscous_warning(rows, 0.5)
