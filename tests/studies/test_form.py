"""Runs that follow a run of a press: on finer cells, and disturbed."""

import json

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.forming.press import EXAMPLES

PRESS = EXAMPLES / "hemisphere.toml"
SMALL = PRESS, "--set", "blank.nx=4", "--steps", 2, "--balance", 9, "--no-pictures"


@pytest.mark.long
def test_finer_cells_where_waves_are_and_a_disturbed_run(launch):
    """The ply that nothing holds waves; its waves get more cells, on the whole ply, too."""
    free = "--set", "holders.holder.pressure=0.0001", "--set", "stage.1.moves.punch=10"
    run = launch("form", *SMALL, *free, "--refine", "--disturb", 2)
    assert run.status == 0, run.err
    coarse = run.summary["quantities"]["wrinkles"]
    finer = json.loads((run.folder / "finer" / "summary.json").read_text())
    times = finer["cells"] / run.summary["cells"]
    assert coarse["cells_a_wave"] < 7 and times >= (7 / coarse["cells_a_wave"]) ** 2 - 1e-9
    assert (run.folder / "finer" / "wrinkles.vtu").exists()
    last = max(run.folder.glob("finer/**/summary.json"), key=lambda p: len(p.parts))
    disturbed = json.loads((run.folder / "disturbed" / "summary.json").read_text())
    assert disturbed["cells"] == 4 * json.loads(last.read_text())["cells"]
    told = json.loads(last.read_text())["disturbed"]
    number = disturbed["quantities"]["force_of_whole_blank_N"]
    assert told["force_of_whole_blank_N"] == pytest.approx(number)


def test_the_disturbed_press_is_whole_and_its_punch_aside():
    press = ff.Press.read(PRESS, ["blank.nx=4"]).build()
    other = press.disturbed(2.0)
    (sheet,) = other.sheets
    assert not other.quarter and sheet.nx == 8
    assert other.tools["punch"].at == pytest.approx((2 * 0.75**0.5, 1.0))
    assert other.tools["ring"] == press.data.tools["ring"]


def test_a_mesh_from_a_file_gets_no_finer_cells(tmp_path):
    sheet = ff.Sheet(ff.load("komeili"), mesh=str(tmp_path / "ply.msh"))
    with pytest.raises(ff.InputError, match="ply.msh can't be made finer; allowed is a rectangle"):
        sheet.finer(2.0)
    outline = ff.Sheet(ff.load("komeili"), outline="ply.dxf", size=9.0)
    assert outline.finer(3.0).size == 3.0
