"""Fits to raw bias tests, of which the law's force is that of the simulated specimen."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from ..core.errors import SolverFailure
from ..material.laws.coupled import SHEAR, WovenFabric
from .curves import Curve, Sheet
from .fit import identify
from .result import Identification, SimulatedFit

# Force (n,) [N] of the specimen of a raw bias test at its displacements, and its derivatives (n, 3)
# by s1, s2, s3 [N/MPa], as of `coupons.simulated.simulated_bias`.
Simulate = Callable[[WovenFabric, Curve], tuple[np.ndarray, np.ndarray]]


def identify_simulated(sheet: Sheet, curves: Sequence[Curve], simulate: Simulate) -> Identification:
    """As `identify`, with the specimens of raw bias tests simulated: no formula has to be trusted
    that makes an angle of a displacement and a stress of a force.

    The first fit is of homogeneous shear. Each other one takes forces as linear in s1, s2, s3 about
    the last values (Gauss-Newton). Where a specimen cannot be simulated, or its forces do not
    settle, the result is the first fit, with a warning.
    """
    start = identify(sheet, curves)
    if not any(curve.is_raw for curve in curves):
        return start
    try:
        return _fitted(sheet, curves, simulate, start)
    except SolverFailure as failure:
        words = f"a bias test could not be simulated: {failure}; the fit is of homogeneous shear"
        return dataclasses.replace(start, warnings=[*start.warnings, words])


def _fitted(sheet, curves, simulate, start, most=8):
    fit, first = start, dict[str, float]()
    for _ in range(most):
        forces = {c.file: simulate(fit.fabric, c) for c in curves if c.is_raw}
        off, change = {}, 0.0
        for curve, response, expected, _ in fit.fits:
            if curve.is_raw:
                force, peak = forces[curve.file][0], response.peak
                off[curve.file] = float(np.sqrt(np.mean((force - response.values) ** 2)) / peak)
                change = max(change, np.abs(force - expected).max() / peak)
        if first and change < 2e-3:  # of the peak
            shear = {name: getattr(start.fabric, name) for name in SHEAR}
            return dataclasses.replace(fit, simulated=SimulatedFit(shear, first, off))
        first = first or off
        fit = identify(sheet, [_linear(curve, fit.fabric, forces) for curve in curves])
    raise SolverFailure(f"its force did not settle in {most} fits")


def _linear(curve, fabric, forces):
    """A raw bias test, its force linear about that of the simulated specimen; others unchanged."""
    if not curve.is_raw:
        return curve
    force, slopes = forces[curve.file]
    rest = force - slopes @ [getattr(fabric, name) for name in SHEAR]
    (response,) = curve.responses
    response = dataclasses.replace(response, half=None, linear=np.column_stack([rest, slopes]))
    return dataclasses.replace(curve, responses=(response,))
