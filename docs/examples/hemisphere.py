"""A ply at 0/90 pressed over a hemisphere, compared with the exact net of inextensible yarns.

Arguments, if any: rectangles along the quarter (10), friction (0.02). Prints, for cells up to 95 %
of the radius on the flat ply, their number, the largest exact shear angle, and the differences from
the exact one: root mean square and largest [deg].
"""

import sys

import numpy as np
from nets import spherical_net  # next to this file

import fabric_fenicsx as ff

given = [float(word) for word in sys.argv[1:]]
nx, friction = int(given[0]) if given else 10, given[1] if given[1:] else 0.02
yarn = ff.Yarn(b=2e4, d=20.0)
fabric = ff.WovenFabric(yarn, yarn, s1=0.01, thickness=0.4)
round_ = {"dome_distance": 1e-3, "dome_radius": 50.0, "waist": 50.0, "wall_angle": 0.0}
dome = ff.DoubleDome(depth=60.0, top_radius=49.9, entry_radius=10.0, saddle_depth=0.0, **round_)
press = ff.Press(
    sheets=[ff.Sheet(fabric, length=200, width=200, nx=nx, bending_modulus=20.0)],
    symmetry="xy",
    interface=ff.Interface(friction=friction),
    tools={"die": ff.PressTool(ff.DieOf("punch"), side="above"), "punch": ff.PressTool(dome)},
    holders={"holder": ff.PressureHolder(0.05)},
    stages=[ff.Stage(moves={"punch": 40.0})],
)
job = press.job(steps=16, balance=None, path_tolerance=1e-3)
grid = job.run("results/hemisphere", overwrite=True).grid

radius = dome.top_radius + fabric.thickness / 2  # of the middle of the ply
u, v, _ = grid.cell_centers().points.T
on = np.hypot(u, v) < 0.95 * radius
exact = spherical_net.shear_angle(u[on], v[on], radius)
off = abs(grid["shear_angle"][on]) - exact
found = exact.max(), np.sqrt((off**2).mean()), abs(off).max()
print(on.sum(), *np.round(np.degrees(found), 1))
