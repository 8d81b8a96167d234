"""A holder presses a ply on a plate with a round opening, and a ball pushes the ply through it.

A quarter is modelled. Prints the forces of the ball and of the holder on the whole ply [N], the
largest shear angle [deg] and the draw-in [mm].
"""

import numpy as np

import fabric_fenicsx as ff

fabric = ff.load("komeili").without("compression_shear")
t = fabric.thickness  # the mesh is the middle of the ply, in z = 0
ply = ff.Blank.rectangle(80, 80, nx=12, fibre_angle=0, spatial=True)
plate = ff.Tool(ff.Plate(length=70, entry=8, centre=(0, 0, -t / 2)), name="plate")
ball = ff.Tool(ff.Sphere(radius=30), lambda load: (0, 0, 30.1 + t / 2 - 20 * load), name="ball")


def under(x):
    """Whether points (3, n) are under the holder; a share of 0 to 1 would do, too."""
    return np.hypot(x[0], x[1]) > 43


holder = ff.BlankHolderPressure(0.05, (0, 0, -1), under, friction=0.25)  # 0.05 MPa downwards
planes = [lambda x: x[0] < 1e-6, lambda x: x[1] < 1e-6]  # of symmetry, at points (3, n)
terms = [ff.Membrane(fabric), ff.Bending(modulus=100.0, symmetric=planes), holder]
terms += [ff.Contact(tool, friction=0.25) for tool in (plate, ball)]
supports = [ff.Support("plane x = 0", planes[0], (0,)), ff.Support("plane y = 0", planes[1], (1,))]
scene = ff.Scene(ply, terms, supports=supports)
result = ff.Job(scene, steps=8).run("results/holder", overwrite=True)

forces = [round(4 * result.force(tool)[2], 1) for tool in (ball, holder.tool)]
shear = np.degrees(abs(result.fields["shear_angle"]).max())
print(*forces, round(shear, 2), round(result.draw_in()["largest_mm"], 2))
result.plot("shear_angle", "holder.png")
