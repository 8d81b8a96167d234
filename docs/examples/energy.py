"""The paper's Figs 3 and 4: curves of one yarn direction and of shear, and the energy over I4, I8.

Prints the nominal stress along a free strip at 1, 2 and 3 %, in MPa, and the energy of the state
I4 = 1.04, I8 = 1 at shear angles of 0, 0.3 and 0.6 rad, in MPa.
"""

import matplotlib.pyplot as plt
import numpy as np

import fabric_fenicsx as ff
from fabric_fenicsx.material.homogeneous import lateral_strain, nominal

fabric = ff.load("komeili")
eps = np.linspace(0.0, 0.03, 31)
across = lateral_strain(fabric, 0, eps)
free = nominal(fabric, np.stack([eps, across, 0 * eps], -1))[:, 0]
held = fabric.derivatives(eps, 0 * eps, 0 * eps).first[0]
print(*(round(float(free[k]), 2) for k in (10, 20, 30)))

figure, axes = plt.subplots(1, 5, figsize=(17, 3.6), layout="constrained")
axes[0].plot(100 * eps, free, label="sides free")
axes[0].plot(100 * eps, held, label="sides held")
axes[0].set(xlabel="strain along a / %", ylabel="nominal stress / MPa", title="tension")
axes[0].legend()
gamma = np.linspace(0.0, 0.8, 41)
axes[1].plot(gamma, fabric.derivatives(0 * gamma, 0 * gamma, gamma).first[2])
axes[1].set(xlabel="shear angle / rad", ylabel="shear stress / MPa", title="shear")
I4, I8 = np.meshgrid(np.linspace(0.94, 1.06, 61), np.linspace(0.94, 1.06, 61))
for ax, angle in zip(axes[2:], (0.0, 0.3, 0.6)):
    W = fabric.derivatives(np.sqrt(I4) - 1, np.sqrt(I8) - 1, 0 * I4 + angle).parts.sum(-1)
    drawn = ax.contourf(I4, I8, W, 20)
    figure.colorbar(drawn, label="energy / MPa")
    ax.set(xlabel="I4", ylabel="I8", title=f"energy at {angle:g} rad")
    print(round(float(W[30, 50]), 4), end=" ")
print()
figure.savefig("energy.png", dpi=70)
