"""Compiles the forms and loops of usual runs, which the caches keep for later ones."""

import logging
from contextlib import suppress
from dataclasses import replace

from ..coupons.coupon import BiasExtension, PictureFrame, Tensile
from ..forming.press import Press
from ..forming.stages import Stage
from ..material.presets import load
from ..runtime.errors import SolverFailure
from ..runtime.status import task

PRESSES = "double_dome", "hemisphere", "laminate"


@task("compiling what usual runs need")
def prepare() -> None:
    """Run a small one of each test and of some presses for two steps, and keep no results."""
    log = logging.getLogger("fabric_fenicsx")
    level = log.level
    log.setLevel(logging.ERROR)  # so few cells are warned of
    try:
        for data in _small():
            with suppress(SolverFailure):  # so few steps may fail
                data.build().job(steps=2, balance=None).run()
    finally:
        log.setLevel(level)


def _small():
    """The tests and presses, on few cells."""
    for test in (Tensile, BiasExtension, PictureFrame):
        yield test(load("komeili"), nx=4)
    for name in PRESSES:
        press = Press.read(name)
        sheets = [replace(sheet, nx=4) for sheet in press.sheets]
        yield press.replace(sheets=sheets, stages=[Stage("forming", moves={"punch": 1.0})])
