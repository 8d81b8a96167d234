"""An outline of your own: a strip with a hole, pulled along its yarns.

Prints the reaction [N].
"""

import numpy as np

import fabric_fenicsx as ff

strip = [(0, 0), (100, 0), (100, 50), (0, 50)]
angles = np.linspace(0, 2 * np.pi, 100, endpoint=False)
hole = np.column_stack([50 + 10 * np.cos(angles), 25 + 10 * np.sin(angles)])

ply = ff.Blank.outline([strip, hole], size=5)  # yarns a along x, b across; quadratic cells
scene = ff.Scene(ply, [ff.Membrane(ff.load("komeili"))], supports=ff.clamped_ends(1.0))
result = ff.Job(scene, steps=4).run()
print(round(result.summary["reaction_N"], 1))
result.plot("log_eps_11", "own_mesh.png")
