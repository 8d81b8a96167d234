"""Forming beside an explicit code, run as a user would."""

import csv

import pytest


@pytest.mark.long
def test_a_coarse_ply_is_near_the_explicit_one(launch):
    done = launch("openradioss", "--nx", 12, "--steps", 10, "--no-pictures")
    assert done.status == 0, done.err
    with open(done.folder / "openradioss.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    found = {name: float(value) for name, value in row.items()}
    assert found["nodes_apart_rms_mm"] < 2
    assert abs(found["shear_angle_max_deg"] - found["shear_angle_max_openradioss_deg"]) < 5
    assert found["punch_force_apart_rms_relative"] < 0.1
    assert "nodes_apart_rms_mm" in done.out + done.err
