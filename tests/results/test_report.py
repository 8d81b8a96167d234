"""How the report names and writes numbers."""

import json

import pytest

from fabric_fenicsx.results.report import label, page


@pytest.mark.parametrize(
    "name, words",
    [
        ("nominal_stress_MPa", "nominal stress [MPa]"),
        ("penalty_N_per_mm3", "penalty [N/mm^3]"),
        ("strain_energy_Nmm", "strain energy [N mm]"),
        ("punch_force_N", "punch force of what is modelled [N]"),
        ("log_eps_11_max", "logarithmic strain along yarns a max"),
        ("eps_b_98_percent", "nominal strain along yarns b, without 1 % of the area at either end"),
        (
            "shear_angle_98_percent_deg",
            "shear angle, without 1 % of the area at either end [deg]",
        ),
        (
            "shear_angle_99_percent_deg",
            "shear angle, which 99 % of the area stay below [deg]",
        ),
        ("shear_angle_max_at_mm", "shear angle max at [mm]"),
        ("shortening_max_at_mm", "shortening of yarns max at [mm]"),
        ("penetration_largest_mm", "penetration of tools, largest of the run [mm]"),
        ("steps_accepted", "steps accepted"),
    ],
)
def test_names_have_words_and_units(name, words):
    assert label(name) == words


def test_a_range_is_written_as_one(tmp_path):
    file = tmp_path / "summary.json"
    found = {"shear_angle_deg": [-1.5, 47.0], "nx": [1, 2]}
    file.write_text(json.dumps({"quantities": found, "wall_s": {}}))
    text = page("dome", {"": (file, [])}, "", "done")
    assert "<th>shear angle [deg]</th><td>-1.5 to 47</td>" in text
    assert "<td>1, 2</td>" in text
