"""Published bias tests, 70 x 210 mm: the examples of Comfor and of a torch-fem fork.

The optional argument is the stroke [mm] (50). Prints for both laws the shear angle near the
middle [deg] here, of the net of least energy and of the usual formula; and the force [N] of both.
"""

import sys
from dataclasses import dataclass

import numpy as np
from nets.relaxed_net import relaxed_net  # next to this file

import fabric_fenicsx as ff
from fabric_fenicsx.core.rules import above_zero
from fabric_fenicsx.material.functions import log, sin


@dataclass(frozen=True)
class Comfor(ff.Law):
    law, rules = "comfor", {"k": above_zero("stress")}
    k: float
    of, shear = staticmethod(sin), {2: 0.0185, 4: 0.0464, 6: -0.0213}

    def energy(self, eps_a, eps_b, gamma):
        along = (self.k * log(1 + eps) ** 2 for eps in (eps_a, eps_b))
        return *along, sum(c * self.of(gamma) ** n for n, c in self.shear.items())


class Fork(Comfor):
    law, of = "fork", staticmethod(abs)
    shear = {2: 0.051 / 2, 3: -0.83 / 6, 4: 6.1275 / 12, 5: -12.0972 / 20, 6: 8.48 / 30}


stroke, size = float(sys.argv[1]) if len(sys.argv) > 1 else 50.0, {"length": 210, "width": 70}
for law in (Comfor(k=100.0, thickness=1.0), Fork(k=17700.0, thickness=1.0)):
    run = ff.BiasExtension(law, **size, nx=24, strain=stroke / 210).job(steps=20).run()
    q, net = run.summary["quantities"], relaxed_net(law, *size.values(), stroke)
    net_angle = np.degrees(net.shear_angle(radius=70 / 8))
    angles = q["centre_shear_angle_deg"], net_angle, q["theory_shear_angle_deg"]
    print(*np.round([*angles, run.summary["reaction_N"], net.force], 1))
