"""Forming of a ply with a cold edge, which is stiffer in shear than its warm middle.

Prints the punch force [N], the maximum shear angle [deg] and the draw-in [mm] of a warm ply and of
one with a cold edge.
"""

import dataclasses

import numpy as np

import fabric_fenicsx as ff

# factors on the shear stresses at 20 and 200 deg C
stiffer = {20.0: {"shear_factor": 8.0}, 200.0: {"shear_factor": 1.0}}
fabric = ff.load("komeili").replace(at_temperatures=stiffer)


def cold_rim(x, y):
    """Temperature at places of the flat ply [deg C]: 200 up to 50 mm, 20 from 80 mm on."""
    return np.interp(np.hypot(x, y), [50, 80], [200, 20])


press = ff.Press.read("hemisphere", ["blank.nx=6"])
for name, temperature in {"warm": 200.0, "cold_rim": cold_rim}.items():
    ply = dataclasses.replace(press.sheets[0], fabric=fabric, temperature=temperature)
    job = press.replace(sheets=ply).job(steps=4, balance=None, path_tolerance=1e-3)
    result = job.run(f"results/{name}", overwrite=True, pictures=False)
    numbers = "force_of_whole_blank_N", "shear_angle_max_deg", "draw_in.largest_mm"
    print(name, *(round(result.number(each), 1) for each in numbers))
