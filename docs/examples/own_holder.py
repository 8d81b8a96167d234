"""A ply formed with three blank holders: one over the whole edge, one of two segments, and
one of your own whose pressure increases along the ply.

Prints for each the force of the punch on the whole ply [N] and the draw-in [mm].
"""

import numpy as np

import fabric_fenicsx as ff


class Cushion:
    """A holder of your own: its method `terms` gets its site, and makes what it likes."""

    def terms(self, site):
        flange = site.on_flange()

        def under(x):  # share of the pressure at positions (3, n)
            return flange(x) * (0.2 + 0.8 * np.clip(abs(x[0]) / 235, 0, 1))

        options = {"lag": site.lag, "friction": site.friction}
        return [ff.BlankHolderPressure(0.25, site.up, under, **options)]


segments = [
    ff.PressureHolder(0.05, where=lambda x: abs(x[0]) < 100),  # at positions (3, n)
    ff.PressureHolder(0.25, where=lambda x: abs(x[0]) >= 100),
]
press = ff.Press.read("double_dome", ["blank.nx=8"])
press = press.replace(stages=[ff.Stage("forming", moves={"punch": 15}, steps=6)])
for name, holder in {"one": ff.PressureHolder(0.05), "two": segments, "own": Cushion()}.items():
    job = press.replace(holders={"blank holder": holder}).job()
    result = job.run(f"results/{name}", overwrite=True, pictures=False)
    force, draw_in = result.number("force_of_whole_blank_N"), result.draw_in()
    print(name, round(force), round(draw_in["largest_mm"], 2))
