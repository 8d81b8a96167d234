"""Fabrics of other laws than the paper's that several tests share."""

from fabric_fenicsx.material.laws.law58 import Law58
from fabric_fenicsx.material.laws.tabulated import Curve, TabulatedFabric

LAW58 = Law58(1335.0, 900.0, 4000.0, 0.0, 1e-3, 0.025, 0.6, 0.8, thickness=0.4, name="law58")
TABLE = TabulatedFabric(
    warp=Curve((-0.2, 0.0, 0.01, 0.03, 0.06), (-0.3, 0.0, 9.0, 45.0, 130.0)),
    weft=Curve((-0.1, 0.0, 0.02, 0.05), (-0.1, 0.0, 12.0, 60.0)),
    shear=Curve((0.0, 0.3, 0.8), (0.0, 0.01, 0.09)),
    name="table",
)
