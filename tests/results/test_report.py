"""How the report names and writes numbers."""

import json

from fabric_fenicsx.results.report import page


def test_numbers_have_units_errors_and_places(tmp_path):
    file = tmp_path / "summary.json"
    found = {"shear_angle_deg": [-1.5, 47.12345], "shear_angle_max_at_mm": [3.0, 4.5]}
    found |= {"draw_in": {"largest_mm": 12.5}, "own_N_per_mm": 1234.5678}
    errors = {"draw_in.largest_mm": 0.25, "own_N_per_mm": None}
    facts = {"quantities": found, "wall_s": {"total": 2.5}, "error": errors}
    file.write_text(json.dumps(facts | {"energy": {"strain": 4.0}}))
    text = page("dome", {"": (file, [])}, "", "done")
    for words in (
        "<th>shear angle [deg]</th><td>-1.5 to 47.123</td>",
        "<th>shear angle max at [mm]</th><td>(3, 4.5)</td>",
        "<th>largest [mm]</th><td>12.5 +- 0.25</td>",
        "<th>own [N/mm]</th><td>1234.6 +- unknown</td>",
    ):
        assert words in text, words


def test_the_verdict_is_first_then_the_part_and_six_numbers(tmp_path):
    """Of a stack with the draw-in of each ply and its place; all other numbers are folded."""
    file = tmp_path / "summary.json"
    draw_in = {"largest_mm": 12.5, "largest_at_mm": [0.0, 60.0]}
    found = {"draw_in": {"largest_mm": 12.5}, "plies": {"lower": {"draw_in": draw_in}}, "own": 7}
    reason = {"verdict": "invalid", "text": "a cell is sheared by 89 deg", "of": ""}
    facts = {"verdict": "invalid", "reasons": [reason], "reaction_N": 5.0, "reaction_is": "force"}
    file.write_text(json.dumps({"quantities": found, "wall_s": {}, **facts}))
    (picture := tmp_path / "formed.png").touch()
    text = page("dome", {"": (file, [picture])}, "what it is", "not believed: sheared")
    order = ["Verdict: invalid", "sheared by 89 deg", "The formed ply", "<th>force [N]"]
    order += ["<th>largest draw-in [mm]</th><td>12.5</td><td>12.5 at (0, 60) mm", "<details>"]
    places = [text.index(words) for words in [*order, "<th>own</th><td>7</td>", "what it is"]]
    assert places == sorted(places) and "not believed: sheared" not in text
