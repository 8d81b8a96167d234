"""A ball pushed 15 mm into a strip that is clamped at its ends.

Prints the load factor, the force of the ball [N] and the largest shear angle [rad].
"""

import fabric_fenicsx as ff

fabric = ff.load("komeili").without("compression_shear")  # or your own: ff.load("fabric.toml")
ply = ff.Blank.rectangle(200, 50, nx=40, fibre_angle=0, spatial=True)
ball = ff.Tool(ff.Sphere(radius=30), lambda load: (100.0, 25.0, 15.0 * load - 30.5), name="ball")
terms = [ff.Membrane(fabric), ff.Bending(modulus=100.0), ff.Contact(ball, friction=0.25)]
scene = ff.Scene(ply, terms, supports=ff.clamped_ends())
result = ff.Job(scene, steps=20).run("results/ball", overwrite=True)
shear = abs(result.fields["shear_angle"]).max()
print(result.rows[-1]["load"], round(result.force(ball)[2], 2), round(shear, 4))
result.plot("shear_angle", "ball.png")
