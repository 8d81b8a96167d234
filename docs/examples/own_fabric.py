"""From test curves to a material file, and from there to a simulated test.

The curves are synthetic: free tension, biaxial tension and shear of the preset `komeili` with
noise of 2 %. Prints how many of the ten parameters the tests determine, the stiffness b of the
yarns [MPa], and the reaction of a strip with the fitted fabric [N].
"""

import fabric_fenicsx as ff
from fabric_fenicsx import identification
from fabric_fenicsx.identification import curves

known = ff.load("komeili")
sheet, tests = identification.synthesise(known, "paper", noise=0.02, seed=1)
curves.write("tests", sheet, tests)  # a folder with a CSV file a test, as yours would be

fit = identification.identify(*curves.read("tests"))
fit.fabric.to_toml("fabric.toml", fit.remarks())
fabric = ff.load("fabric.toml")
result = ff.Tensile(fabric, nx=12, strain=0.02).job(steps=4).run()
reaction = result.summary["reaction_N"]
print(len(fit.determined), round(fabric.warp.b, 1), round(reaction, 1))
result.plot("log_eps_22", "own_fabric.png")
