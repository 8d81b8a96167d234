"""Two plies, 0/90 over +-45, with contact and friction between them, pushed up by a ball.

Prints the load factor, the force of the ball [N] and how far the plies slide on each other [mm].
"""

import fabric_fenicsx as ff

fabric, sheets, terms = ff.load("komeili"), [], []
for name, angle in {"lower": 45, "upper": 0}.items():  # the lowest first
    ply = ff.Blank.rectangle(100, 100, nx=6, fibre_angle=angle, spatial=True)
    sheets.append((ply, fabric.thickness, name))
    terms += [ff.Membrane(fabric).on(name), ff.Bending(modulus=100.0).on(name)]
ball = ff.Tool(ff.Sphere(radius=30), lambda load: (50.0, 50.0, 4.0 * load - 30.5), name="ball")
terms += [ff.Contact(ball, friction=0.25), ff.SheetContact("lower", "upper", friction=0.334)]
scene = ff.Scene(ff.Stack(sheets), terms, supports=ff.clamped_ends())
result = ff.Job(scene, steps=4).run("results/stack", overwrite=True)
pair = result.summary["sheet_contacts"]["lower, upper"]
force, slid = result.force(ball)[2], pair["sliding_largest_mm"]
print(result.rows[-1]["load"], round(force, 1), round(slid, 2))
result.plot("shear_angle", "stack.png")
