"""From test curves to a material file, and from there to a simulated test.

The curves are synthetic: held tension, biaxial tension and shear of the preset `komeili` with
noise of 2 %. Prints how many of the ten parameters the tests determine, the stiffness b of the
yarns [MPa], and the reaction of a strip with the fitted fabric [N].
"""

from importlib.resources import files

import fabric_fenicsx as ff
from fabric_fenicsx import identification
from fabric_fenicsx.identification import curves

data = files("fabric_fenicsx") / "studies/data/komeili_paper"  # a folder as yours would be
fit = identification.identify(*curves.read(str(data)))
fit.fabric.to_toml("fabric.toml", fit.remarks())
fabric = ff.load("fabric.toml")
result = ff.Tensile(fabric, nx=12, strain=0.02).job(steps=4).run()
reaction = result.summary["reaction_N"]
print(len(fit.determined), round(fabric.warp.b, 1), round(reaction, 1))
result.plot("log_eps_22", "own_fabric.png")
