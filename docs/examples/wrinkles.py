"""A sheet, pulled along x, that wrinkles as its ends become narrower: as Cerda and Mahadevan say?

Prints, for several tensions T [N/mm], how many half waves lie across the sheet, and how many waves
of their length 2 sqrt(pi L) (B / T)^(1/4) would, with the length L and the bending stiffness B.
"""

import math

import numpy as np

import fabric_fenicsx as ff

LENGTH, WIDTH, THICKNESS, STIFFNESS = 100.0, 152.0, 0.2, 4 / 3  # mm, and N mm
no = dict.fromkeys(("a", "p_min", "c", "s_T", "s_C", "s2", "s3"), 0.0)
film = ff.WovenFabric.balanced(b=2e4, d=2e3, s1=0.5, thickness=THICKNESS, density=1.0, **no)

for tension in (1.0, 4.0, 16.0):
    critical = 2 * math.sqrt(STIFFNESS * tension) * math.pi / LENGTH  # compression [N/mm]
    strains = np.array([tension / film.warp.b, -1.3 * critical / film.weft.d]) / 2 / THICKNESS

    def moved(x, load, strains=strains):
        """First the pull, then the ends narrow."""
        share = np.array([min(1, 4 * load), max(0, 4 * load - 1) / 3]) * strains
        return np.array([*(share[:, None] * (x[:2] - [[LENGTH / 2], [WIDTH / 2]])), 0 * x[2]])

    sheet = ff.Blank.rectangle(LENGTH, WIDTH, nx=8, ny=80, fibre_angle=0, spatial=True)
    edges = [lambda x: x[1] < 1e-6, lambda x: x[1] > WIDTH - 1e-6]  # as if it went on beyond
    held = [
        ff.Support("ends", lambda x: abs(x[0] - LENGTH / 2) > LENGTH / 2 - 1e-6, (0, 1, 2), moved)
    ]
    held += [ff.Support("edge", edge, (1,), moved) for edge in edges]
    bending = ff.Bending(STIFFNESS, D_t=2 * STIFFNESS, symmetric=edges)
    ff.Job(ff.Scene(sheet, [ff.Membrane(film), bending], supports=held)).run()

    x, height = sheet.coordinates(), sheet.nodal_displacement()[:, 2]
    middle = np.flatnonzero(abs(x[:, 0] - LENGTH / 2) < 1e-6)
    height = height[middle[np.argsort(x[middle, 1])]]
    theory = 2 * math.sqrt(math.pi * LENGTH) * (STIFFNESS / tension) ** 0.25
    print(tension, (height[1:] * height[:-1] < 0).sum(), round(2 * WIDTH / theory, 1))
