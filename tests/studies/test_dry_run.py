"""Checks without a run."""

import re

import pytest

from fabric_fenicsx.press.press import EXAMPLES

PRESS = EXAMPLES / "hemisphere.toml"


@pytest.mark.mpi
def test_a_dry_run_tells_the_size_and_leaves_the_folder_free(launch):
    press = PRESS, "--set", "blank.nx=4", "--set", "stage.1.moves.punch=1", "--steps", 1
    more = "--dry-run", "--error", "--refine", "--disturb", 1
    checked = launch("form", *press, *more, overwrite=False)
    assert checked.status == 0, checked.err
    assert "64 cells (P1), 123 degrees of freedom; membrane, bending, contact" in checked.out
    told = re.findall(r"^(.*?),? takes ([\d.]+) to ([\d.]+) s", checked.out, re.MULTILINE)
    names = [name.split(",")[0] for name, *_ in told]
    assert names[:3] == ["the run", "the run on coarser cells", "--refine"]
    assert names[3:] == ["--disturb", "--disturb after --refine"]
    assert all(float(low) < float(high) for _, low, high in told)
    assert "MiB" in checked.out
    assert (checked.folder / "setup.png").stat().st_size > 10_000
    assert not (checked.folder / "history.csv").exists()
    run = launch("form", *press, "--no-pictures", overwrite=False)
    assert run.status == 0 and run.summary["dofs"] == 123
    assert f" {run.summary['newton_iterations']} iterations at the first" in checked.out
