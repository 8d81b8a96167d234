"""A quarter of a ply, formed 20 mm deep over the double dome, on a coarse mesh.

Prints the punch force of the quarter [N], the largest shear angle [deg] and the draw-in [mm].
"""

import fabric_fenicsx as ff

press = ff.Press.read("double_dome", ["blank.nx=12"])
press = press.replace(stages=[ff.Stage("forming", moves={"punch": 20}, steps=4)])
result = press.job().run("results/forming", overwrite=True)
found = result.summary["quantities"]
shear, draw_in = found["shear_angle_max_deg"], found["draw_in"]["largest_mm"]
print(round(found["punch_force_N"], 1), round(shear, 2), round(draw_in, 2))
result.plot("shear_angle", "forming.png")
