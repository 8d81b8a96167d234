"""Fabrics of other laws than the paper's that several tests share."""

import runpy
from pathlib import Path

from fabric_fenicsx.material.laws.tabulated import Curve, TabulatedFabric

EXAMPLES = Path(__file__).parents[1] / "docs/examples"
# under the name of tests/test_docs.py, so that the law replaces itself where both run
LAW58 = runpy.run_path(str(EXAMPLES / "own_law58.py"), run_name="program")["fabric"]
TABLE = TabulatedFabric(
    warp=Curve((-0.2, 0.0, 0.01, 0.03, 0.06), (-0.3, 0.0, 9.0, 45.0, 130.0)),
    weft=Curve((-0.1, 0.0, 0.02, 0.05), (-0.1, 0.0, 12.0, 60.0)),
    shear=Curve((0.0, 0.3, 0.8), (0.0, 0.01, 0.09)),
    name="table",
)
