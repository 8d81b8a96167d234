"""A strip pulled at 45 degrees to its yarns: the bias extension test.

Three zones of shear appear, in agreement with the theory of inextensible yarns.
Prints the shear angle at the centre and that of this theory [deg].
"""

import fabric_fenicsx as ff

result = ff.BiasExtension(ff.load("komeili"), nx=20, strain=0.10).job(steps=5).run()
found = result.summary["quantities"]
print(round(found["centre_shear_angle_deg"], 2), round(found["theory_shear_angle_deg"], 2))
result.plot("shear_angle", "bias.png")
