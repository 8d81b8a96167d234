"""The net shape of a part: its trim line as a flat pattern, and forming of the net blank.

Prints the maximum and mean distance of the edge of the formed net blank from the trim line [mm].
"""

import dataclasses

import numpy as np

import fabric_fenicsx as ff
from fabric_fenicsx.results.pattern import edge_distance, flat_pattern, write_pattern

press = ff.Press.read("hemisphere", ["blank.nx=8", "stage.1.moves.punch=25"])
angle = np.linspace(0, 2 * np.pi, 181)
trim = [80 * np.column_stack([np.cos(angle), np.sin(angle)])]  # on the flange, seen along z

formed = press.job(steps=4).run()
write_pattern("net", flat_pattern(formed.grid, trim, reach=2.0))

sheet = dataclasses.replace(press.sheets[0], length=None, width=None, nx=None)
net = press.replace(sheets=[dataclasses.replace(sheet, outline="net.csv", size=12)])
largest, mean = edge_distance(net.job(steps=4).run().grid, trim)
print(f"{largest:.2f} {mean:.2f}")
