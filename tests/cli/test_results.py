"""Commands on the results of a run: what they ask of them and print, of made ones."""

from types import SimpleNamespace

import numpy as np
import pytest
import shapely

import fabric_fenicsx as ff
from fabric_fenicsx.cli import results
from fabric_fenicsx.results import pattern, states
from fabric_fenicsx.studies.lib.press_study import PressStudy, press_parser

TWO = {"lower": (0.5, 0.9), "upper": (1.2, 0.3)}  # plies and their thickness in cells [mm]


def ply(thickness):
    return SimpleNamespace(cell_data={"thickness_under_pressure": np.array([*thickness, np.nan])})


@pytest.fixture
def asked(monkeypatch):
    """Function of words behind `fabric pattern` to what its parts are asked for."""

    def run(*words):
        calls = []

        def flat_pattern(grid, where, reach):
            calls.append((where, reach))
            flat = shapely.box(0, 0, 30, 20)
            return SimpleNamespace(net=flat, formed_area=700.0, off=0.25)

        monkeypatch.setattr(states, "read_grids", lambda _: {n: ply(t) for n, t in TWO.items()})
        monkeypatch.setattr(states, "set_labels", lambda grids: dict(zip(grids, "ab")))
        monkeypatch.setattr(states, "units", lambda _: {})
        monkeypatch.setattr(pattern, "flat_pattern", flat_pattern)
        monkeypatch.setattr(pattern, "write_pattern", lambda *_: None)
        monkeypatch.setattr(pattern, "edge_distance", lambda grid, line: (5.0, 2.0))
        results.run("pattern", ["out", *words])
        return calls

    return run


def test_a_pattern_reaches_two_thicknesses_of_all_plies_and_tells_its_areas(asked, capsys):
    (where, reach), other = asked("--plane", "z=5")
    assert reach == other[1] == pytest.approx(2 * (0.9 + 1.2))
    assert (where.point, where.normal) == ((0, 0, 5), (0, 0, 1))
    line = capsys.readouterr().out.splitlines()[0].split(": ")[1]
    assert line == (
        "area 600 mm2, perimeter 100 mm, area of the formed part 700 mm2, "
        "trim line up to 0.25 mm off the ply"
    )
    ((where, reach),) = asked("--plane", "-1,2,3,0,0,2", "--reach", "0.7", "--sheet", "upper")
    assert reach == 0.7 and (where.point, where.normal) == ((-1, 2, 3), (0, 0, 2))
    for wrong in ("z=nan", "1,2,3,0,0,0", "w=1", "1,2,3"):
        with pytest.raises(ff.InputError, match=f"--plane is {wrong}; expected"):
            asked("--plane", wrong)


def test_the_distance_of_an_edge_is_told(asked, capsys, tmp_path):
    (tmp_path / "line.csv").write_text("x,y\n0,0\n1,0\n1,1\n")
    asked("--line", str(tmp_path / "line.csv"), "--edge", "--sheet", "upper")
    told = "the edge of ply upper is up to 5 mm from the trim line, 2 mm on average\n"
    assert capsys.readouterr().out == told


def test_a_quick_press_has_a_third_of_the_steps_and_cells_twice_as_large(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = "--nx", "8", "--set", "limits.shortening=0.3"
    for words, steps, cells in ((["--quick"], 6, 4), ([], None, 8)):
        study = PressStudy("form", press_parser("", press="hemisphere"), [*own, *words])
        assert (study.read().sheets[0].nx, study.args.steps) == (cells, steps)
        assert (study.args.max_shortening, study.args.max_strain) == (0.3, 0.1)
        study.output.close()
