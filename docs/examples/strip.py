"""A strip pulled along its yarns, with and without the biaxial coupling.

With the coupling the strip necks. Without it the width does not change.
Prints the reaction [N] and the transverse logarithmic strain at the middle, for both.
"""

import fabric_fenicsx as ff

fabric = ff.load("komeili")
for law in (fabric, fabric.without("biaxial")):
    result = ff.Tensile(law, nx=16, strain=0.03).job(steps=5).run()
    strain_across = result.summary["quantities"]["log_eps_22_middle"]
    print(round(result.summary["reaction_N"], 1), round(strain_across, 4))
    if law is fabric:
        result.plot("log_eps_22", "strip.png")
