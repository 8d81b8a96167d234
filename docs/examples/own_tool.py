"""A tool of your own: an egg, defined by its equation, pushed into a clamped strip.

Prints the force of the egg [N].
"""

import numpy as np

import fabric_fenicsx as ff


class Egg(ff.ImplicitSurface):
    """(x/a)^2 + (y/b)^2 + (z/c)^2 = 1 with half axes a, b, c [mm]."""

    axes = np.array([40.0, 20.0, 20.0])
    radii = (10.0, np.inf)  # smallest convex radius of curvature, c^2 / a; not concave anywhere

    def implicit(self, x):
        """F, its gradient and its Hessian at x (3, n)."""
        weights = 2 / self.axes[:, None] ** 2
        hessian = np.eye(3)[:, :, None] * (weights + 0 * x)
        return (weights * x * x).sum(0) / 2 - 1, weights * x, hessian

    def bound(self, F, x):
        """A lower bound of the distance."""
        return abs(np.sqrt(np.maximum(F + 1, 0)) - 1) * self.axes.min()


egg = Egg()
assert "agree" in ff.check_derivatives(egg, [[10.0, 5.0, 20.0], [30.0, -3.0, 15.0]])
tool = ff.Tool(egg, lambda load: (50.0, 25.0, 6.0 * load - 20.5), name="egg")
ply = ff.Blank.rectangle(100, 50, nx=12, spatial=True)
terms = [ff.Membrane(ff.load("komeili")), ff.Bending(modulus=100.0), ff.Contact(tool)]
scene = ff.Scene(ply, terms, supports=ff.clamped_ends())
result = ff.Job(scene, steps=10).run("results/egg", overwrite=True)
print(round(result.force(tool)[2], 2))
result.plot("shear_angle", "own_tool.png")
