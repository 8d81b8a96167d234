"""Compiles the forms and loops of usual runs, which the caches keep for later ones."""

import logging
from contextlib import suppress
from dataclasses import replace

from ..core.errors import SolverFailure
from ..core.status import log, task
from ..coupons.bias_extension import BiasExtension
from ..coupons.coupon import Coupon
from ..coupons.picture_frame import PictureFrame
from ..coupons.tensile import Tensile
from ..material.presets import load
from ..press.press import Press
from ..press.stages import Stage

PRESSES = "double_dome", "hemisphere", "laminate"


@task("compiling the forms of standard runs")
def prepare() -> None:
    """Run a small one of each test and of some presses for two steps, and keep no results."""
    log.setLevel(logging.ERROR)  # so few cells are warned of
    kinds = Tensile, BiasExtension, PictureFrame
    tests: list[Coupon | Press] = [kind(load("komeili"), nx=4) for kind in kinds]
    stages = [Stage("forming", moves={"punch": 1.0})]
    for press in map(Press.read, PRESSES):
        sheets = [replace(sheet, nx=4) for sheet in press.sheets]
        tests.append(press.replace(sheets=sheets, stages=stages))
    for data in tests:
        with suppress(SolverFailure):  # so few steps may fail
            data.build().job(steps=2, balance=None).run()
