"""The paper's laminate: metal, three plies, metal."""

import numpy as np
import pytest
from builders import COMM

from fabric_fenicsx.results import forming_pictures
from fabric_fenicsx.results.states import read_state

SHEETS = ["lower metal", "lower", "middle", "upper", "upper metal"]


@pytest.mark.versions
def test_a_laminate_is_formed(launch, monkeypatch):
    monkeypatch.setattr(forming_pictures, "draw_compared", lambda *_: None)  # as of a single ply
    # a step of hardly any work: what is missing of it differs from machine to machine
    short = "--set", "stage.1.moves.punch=1.5", "--steps", 1, "--max-imbalance", 0.5
    done = launch("laminate", "--nx", 3, *short, "--balance", 9)
    assert done.status == 0, done.err
    s = done.summary
    q, energy = s["quantities"], s["energy"]
    assert s["converged"] and list(q["plies"]) == SHEETS
    # of the fabric, not of the smaller metal below it
    assert [s["options"][name] for name in ("nx", "length", "width")] == [3, 760, 460]
    assert energy["viscous"] <= 0.01 * energy["metal"]
    assert energy["metal"] > energy["strain"] > 0 and energy["plastic"] >= 0
    assert q["penetration_of_thickness"] < 0.02
    assert q["unbalanced_force_N"] < 1e-4 * q["contact_forces_N"]["die"]
    for name, ply in q["plies"].items():
        is_metal = "metal" in name
        assert ("thinning_max" in ply) == is_metal
        assert ("shear_angle_max_deg" in ply) != is_metal
    assert q["plies"]["middle"]["shear_contrast_deg"] > 0 and "shear_contrast_deg" not in q
    assert q["sheet_pressure_largest_MPa"] > 1  # of 2 MPa beneath the holder
    pictures = "middle", "middle_paths", "between", "metal", "formed", "states_middle"
    if COMM.rank == 0:
        assert all((done.folder / f"{name}.png").stat().st_size > 10_000 for name in pictures)
        grid = read_state(done.folder)
        is_metal = np.isin(np.asarray(grid.cell_data["part"]), (0, 4))
        thickness = np.asarray(grid.cell_data["metal_thickness"])
        assert np.array_equal(np.isfinite(thickness), is_metal)
        assert np.allclose(thickness[is_metal], 1.0, atol=0.01)
