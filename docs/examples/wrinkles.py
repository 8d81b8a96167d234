"""Wrinkles of a sheet pulled along x with narrowed ends, compared with Cerda and Mahadevan.

Prints, for several tensions T [N/mm], the number of half waves across the sheet, and that for their
wavelength 2 sqrt(pi L) (B / T)^(1/4), with the length L and the bending stiffness B.
"""

import math

import matplotlib.pyplot as plt
import numpy as np

import fabric_fenicsx as ff

L, W, H, B = 100.0, 152.0, 0.2, 4 / 3  # length, width, thickness [mm], bending stiffness [N mm]
film = ff.WovenFabric(*2 * [ff.Yarn(b=2e4, d=2e3)], s1=0.5, thickness=H)
edges = [lambda x: x[1] < 1e-6, lambda x: x[1] > W - 1e-6]  # as if it continued beyond
for tension in (1.0, 4.0, 16.0):
    critical = 2 * math.sqrt(B * tension) * math.pi / L  # compression [N/mm]; the energy is b eps^2
    strains = np.array([tension / film.warp.b, -1.3 * critical / film.weft.d]) / 2 / H

    def moved(x, load, strains=strains):
        """First the pull, then the ends narrow."""
        share = np.array([min(1, 4 * load), max(0, 4 * load - 1) / 3]) * strains
        return np.array([*(share[:, None] * (x[:2] - [[L / 2], [W / 2]])), 0 * x[2]])

    sheet = ff.Blank.rectangle(L, W, nx=8, ny=80, fibre_angle=0, spatial=True)
    held = [ff.Support("ends", lambda x: abs(x[0] - L / 2) > L / 2 - 1e-6, (0, 1, 2), moved)]
    held += [ff.Support("edge", edge, (1,), moved) for edge in edges]
    terms = [ff.Membrane(film), ff.Bending(B, D_t=2 * B, symmetric=edges)]
    ff.Job(ff.Scene(sheet, terms, supports=held)).run()
    (x, y, _), z = sheet.coordinates().T, sheet.nodal_displacement()[:, 2]
    middle = abs(x - L / 2) < 1e-6
    across = z[middle][np.argsort(y[middle])]
    theory = W / math.sqrt(math.pi * L) * (tension / B) ** 0.25
    print(tension, (across[1:] * across[:-1] < 0).sum(), round(theory, 1))
    labels = {"title": f"{tension:g} N/mm", "xlabel": "x / mm", "ylabel": "y / mm"}
    plt.subplot(131 + int(math.log(tension, 4)), **labels).label_outer()
    plt.tricontourf(x, y, z, 20, cmap="RdBu")
    plt.colorbar(label="z / mm", location="bottom", ticks=[z.min(), 0, z.max()], format="%.2f")
plt.savefig("wrinkles.png", dpi=100, bbox_inches="tight")
