"""Forming of a woven ply over a generic double dome: Figs 11 to 16 of Schäfer et al., for a single
ply between rigid tools. It is `form double_dome`."""

from fabric_fenicsx.cli.study import run
from fabric_fenicsx.studies.form import main, options
from fabric_fenicsx.studies.lib.press_study import PressStudy

if __name__ == "__main__":
    run("double_dome", options(__doc__, "double_dome"), main, PressStudy)
