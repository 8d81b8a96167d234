"""A square sheared in a hinged frame, with pre-tensioned yarns.

Prints the normalised shear force at 45 deg, of the elements and in closed form [N/mm].
"""

import matplotlib

import fabric_fenicsx as ff

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

for pre_tension in (0.0, 0.005, 0.01):
    test = ff.PictureFrame(ff.load("komeili"), nx=6, pre_tension=pre_tension).build()
    result = test.job(steps=15).run()
    angles, forces = zip(*map(test.shear_force, result.rows))
    plt.plot(angles, forces, label=f"yarns stretched by {100 * pre_tension:g} %")
    found = result.summary["quantities"]
    names = "normalised_shear_force_N_per_mm", "closed_form_N_per_mm"
    print(*(f"{found[name]:.5f}" for name in names))
plt.xlabel("shear angle / deg")
plt.ylabel("normalised shear force / (N/mm)")
plt.legend()
plt.savefig("picture_frame.png", dpi=100)
