"""The force of a simulated bias test, and what each shear parameter adds to it."""

import numpy as np
import scipy
from mpi4py import MPI

from ..core.errors import SolverFailure
from ..identification.curves import Curve
from ..material.laws.coupled import SHEAR, WovenFabric
from ..sheet.specimen import blocks
from ..solve.newton import Newton
from ..solve.progress import Accepted
from ..solve.settings import Settings
from ..solve.stepping import LoadStepping
from .bias_extension import BiasExtension


def simulated_bias(fabric: WovenFabric, curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Force (n,) [N] of the specimen of a raw bias test at its displacements, and its derivatives
    (n, 3) by s1, s2, s3 [N/MPa]; on one rank. Raises SolverFailure.

    In equilibrium the energy U is least at the displacement d of the clamp, where the force is
    F = dU/dd. So dU/ds is that at fixed strains, the integral of the law's own dW/ds over the
    sheet, and dF/ds its derivative by d along the path: no system of equations is solved for it.
    """
    try:
        return _simulated(fabric, curve, "graded", 6)
    except SolverFailure:  # its thin cells fold in deep shear
        return _simulated(fabric, curve, "crossed", 12)


def _simulated(fabric, curve, pattern, cells):
    """With so many rectangles across the width: forces up to 45 deg are right to 0.3 % of 6
    `graded`, and to 1 % of 12 `crossed` ones."""
    at, height, width = curve.displacement, curve.keys["height"], curve.keys["width"]
    sizes = {"length": height, "width": width, "nx": cells * max(2, blocks(height, width))}
    test = BiasExtension(fabric, **sizes, strain=at[-1] / height, pattern=pattern)
    strip = test.build(MPI.COMM_SELF)
    volume = np.outer(strip.blank.areas(), strip.membrane.weights) * fabric.thickness
    stiffer = [fabric.replace(**{name: getattr(fabric, name) + 1.0}) for name in SHEAR]
    rows: list[list[float]] = []

    def keep(accepted: Accepted) -> None:
        """Displacement, force and dU/ds [N mm/MPa] of an accepted state; W is linear in s."""
        strains = strip.membrane.strains_at_points()
        of_shear = [np.sum(volume * law.energy(*strains)[2]) for law in (fabric, *stiffer)]
        slopes = [each - of_shear[0] for each in of_shear[1:]]
        rows.append([*strip.measure(strip.scene, accepted.load), *slopes])

    settings = Settings(steps=25, viscosity="off")
    outcome = LoadStepping(Newton(strip.scene), settings, on_accept=keep).run()
    if outcome.reason:
        raise SolverFailure(outcome.reason)
    d, force, *slopes = np.array(rows).T
    spline = scipy.interpolate.CubicSpline
    return spline(d, force)(at), spline(d, np.transpose(slopes)).derivative()(at)
