"""An outline of your own: a strip with a hole, pulled at 45 degrees to its yarns.

Prints the reaction [N].
"""

import numpy as np

import fabric_fenicsx as ff

strip = [(0, 0), (100, 0), (100, 50), (0, 50)]
angles = np.linspace(0, 2 * np.pi, 100, endpoint=False)
hole = np.column_stack([50 + 10 * np.cos(angles), 25 + 10 * np.sin(angles)])

ply = ff.Blank.outline([strip, hole], size=5, fibre_angle=45)  # quadratic cells
scene = ff.Scene(ply, [ff.Membrane(ff.load("komeili"))], supports=ff.clamped_ends(3.0))
result = ff.Job(scene, steps=4).run()
print(round(result.summary["reaction_N"], 4))
result.plot("shear_angle", "own_mesh.png")
