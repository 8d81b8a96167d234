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


@pytest.mark.parametrize(
    "study, options, words",
    [
        ("form", (PRESS, "--set", "stage.1.moves.pnch=1"), "tool pnch is unknown (did you mean"),
        ("form", (PRESS, "--set", "tools.punch.at=[9,0,50]", "--set", "blank.nx=0"), "blank.nx"),
        ("tensile", ("--mesh", "none.msh"), "none.msh"),
    ],
)
def test_what_is_wrong_is_found_by_a_dry_run(study, options, words, launch):
    done = launch(study, *options, "--dry-run")
    assert done.status == 2 and words in done.err
    assert not done.folder.exists()
