"""Checks without a run."""

import pytest

from fabric_fenicsx.forming.press import EXAMPLES

PRESS = EXAMPLES / "hemisphere.toml"


@pytest.mark.mpi
def test_a_dry_run_tells_the_size_and_leaves_the_folder_free(launch):
    press = PRESS, "--set", "blank.nx=4", "--set", "stage.1.moves.punch=1", "--steps", 1
    checked = launch("form", *press, "--dry-run", overwrite=False)
    assert checked.status == 0, checked.err
    assert "64 cells (P1), 123 degrees of freedom; membrane, bending, contact" in checked.out
    assert "1 steps take" in checked.out and "MiB" in checked.out
    assert (checked.folder / "setup.png").stat().st_size > 10_000
    assert not (checked.folder / "history.csv").exists()
    run = launch("form", *press, "--no-pictures", overwrite=False)
    assert run.status == 0 and run.summary["dofs"] == 123
