"""Forming of a fibre-metal laminate over a generic double dome: Figs 11 to 16 of Schäfer et al.,
metal, three plies at 0/90, metal. It is `form laminate`."""

from fabric_fenicsx.cli.study import run
from fabric_fenicsx.studies.form import main, options
from fabric_fenicsx.studies.lib.press_study import PressStudy

if __name__ == "__main__":
    run("laminate", options(__doc__, "laminate"), main, PressStudy)
