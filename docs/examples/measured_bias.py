"""Bias tests of glass/PP of Cao et al. (2008): the law is fitted to a specimen of 150 x 450 mm,
and one of 115 x 230 mm is predicted.

Prints for both the displacement [mm], the measured force [N], and simulated / measured force.
"""

from importlib.resources import files

from fabric_fenicsx import identification
from fabric_fenicsx.coupons.simulated import simulated_bias
from fabric_fenicsx.identification import curves

data = files("fabric_fenicsx") / "studies/data"
large, small = (curves.read(str(data / f"glass_pp_{size}")) for size in ("150x450", "115x230"))
law = identification.identify_simulated(*large, simulated_bias).fabric
for _, (test,) in (large, small):
    size = f"{test.keys['width']:.0f}x{test.keys['height']:.0f}"
    force, _ = simulated_bias(law, test)
    for d, measured, simulated in zip(test.displacement, test.responses[0].values, force):
        print(f"{size} {d} {measured} {simulated / measured:.3f}")
