"""Yarn directions of a formed ply, for a structural analysis of the part.

Prints the number of shell elements in the Abaqus file, and the minimum angle between yarns [deg].
"""

import numpy as np
import pyvista

import fabric_fenicsx as ff

press = ff.Press.read("double_dome", ["blank.nx=12"])
press = press.replace(stages=[ff.Stage("forming", moves={"punch": 20}, steps=4)])
result = press.job().run("results/forming", overwrite=True)
result.export("formed.inp")  # Abaqus; formed.k is for LS-DYNA, formed.bdf for Nastran
result.export("formed.vtu")  # ParaView, PyVista and other readers of VTK

ply = pyvista.read("formed.vtu")
angle = np.degrees(np.arccos((ply["yarn_a"] * ply["yarn_b"]).sum(1)))
print(ply.n_cells, round(angle.min(), 1))
