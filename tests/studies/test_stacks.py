"""The example stack files in studies/stacks."""

from pathlib import Path

import pytest
from builders import dome_press

from fabric_fenicsx.command_line.forming_study import DomeTest, dome_parser

ROOT = Path(__file__).parents[2]
FOLDER = "studies/stacks"
ANGLES = {
    "two_plies": [45, 0],
    "three_plies": [0, 45, 0],
    "laminate": 5 * [0],
}  # of yarns a, from the punch on


def test_angles_are_known_of_all_files():
    assert {path.stem for path in (ROOT / FOLDER).glob("*")} == set(ANGLES)


@pytest.mark.parametrize("stem", ANGLES)
def test_each_file_is_read(stem):
    plies = dome_press(stack=str(ROOT / FOLDER / f"{stem}.toml")).sheets
    assert [ply.fibre_angle for ply in plies] == ANGLES[stem]
    assert len({ply.name for ply in plies}) == len(plies)


def test_help_says_where_they_are():
    assert FOLDER in "".join(dome_parser(DomeTest, "").format_help().split())
