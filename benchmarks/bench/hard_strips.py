"""Hard cases of one sheet within its plane: strips, frames and single elements."""

import math
from functools import partial
from itertools import product

import numpy as np
from scipy.optimize import minimize, minimize_scalar

import fabric_fenicsx as ff
from fabric_fenicsx.scene.output import virial

from .hard import Number, Run, near


def density(fabric, a, b, g):
    """W [MPa] of eq. (30) at yarn strains a, b and shear angle g, of a balanced fabric."""
    y, g = fabric.warp, np.abs(g)
    W, k = 0 * g, 0 * g + 1
    shear = fabric.s1 * g**2 / 2 + fabric.s2 * g**3 / 3 + fabric.s3 * g**4 / 4
    for e, other in ((a, b), (b, a)):
        square = e * (2 + e)  # I - 1
        coupled = (1 - y.p_min) * np.exp(y.c * other) + y.p_min
        W = W + np.where(e > 0, (y.a * e + y.b) * e**2 * coupled, y.d * e**2)
        shear = shear + np.where(e > 0, y.s_T * square**2 * g**3 / 3, 0.0)
        k = k * np.where(e > 0, 1.0, np.exp(y.s_C * np.minimum(square, 0) ** 3))
    return W + shear * k


def of_gradient(fabric, F):
    """W [MPa] at gradients F (..., 2, 2) of a fabric with yarns along x and y."""
    (a, b), angle = np.linalg.norm(F, axis=-2).T - 1, (F[..., 0] * F[..., 1]).sum(-1)
    return density(fabric, a.T, b.T, np.arcsin(angle / ((1 + a.T) * (1 + b.T))))


def stress(energy, x, h=1e-6):
    """dW/dx of a function by differences."""
    return (8 * (energy(x + h) - energy(x - h)) - energy(x + 2 * h) + energy(x - 2 * h)) / 12 / h


def least(energy, low, high):
    """Smallest value of a function of one number between bounds, sought from a scan."""
    x = np.linspace(low, high, 2001)
    k = int(np.argmin([energy(v) for v in x]))
    bounds = x[max(k - 1, 0)], x[min(k + 1, 2000)]
    return float(minimize_scalar(energy, bounds=bounds, options={"xatol": 1e-13}).fun)


def banded(fabric, F):
    """Least W [MPa] of a sheet of the mean gradient F that folds within its plane into two kinds of
    bands, normal to either yarn: what it takes at most if bands are free to form."""
    found = [float(of_gradient(fabric, F))]
    for axis in (0, 1):

        def energy(p, axis=axis):
            share, jump = p[2], np.zeros((2, 2))
            jump[:, axis] = p[:2]
            bands = np.stack([F + (1 - share) * jump, F - share * jump])
            if not 0 < share < 1 or np.linalg.det(bands).min() < 1e-3:
                return 1e9
            return float(np.array([share, 1 - share]) @ of_gradient(fabric, bands))

        for start in product((-0.3, 0.3), (-0.5, 0.5), (0.15, 0.5, 0.85)):
            found.append(minimize(energy, start, method="Nelder-Mead").fun)
    return min(found)


def rectangle(s, length=200.0, width=50.0, nx=40, **more):
    return ff.Blank.rectangle(length, width, nx=nx, comm=s.comm, **{"element": "P1"} | more)


def strip(s, ends, fabric=None, steps=20, **shape):
    """Run of a strip with these ends."""
    scene = ff.Scene(rectangle(s, **shape), [ff.Membrane(fabric or s.fabric)], ends)
    return Run(scene, steps=steps)


def pull(run):
    """Force of the moving grip [N]."""
    return float(run.scene.reaction("moving grip")[0])


def bias_to_45_percent(s):
    """free tension at 45 deg to both yarns: 45 %, sheared beyond 50 deg"""
    run = strip(s, ff.rolling_ends(90.0), nx=20, fibre_angle=45, steps=40)

    def at(length, width):
        strain = np.sqrt((length**2 + width**2) / 2) - 1
        angle = np.arcsin(np.clip((length**2 - width**2) / (length**2 + width**2), -1, 1))
        return density(s.fabric, strain, strain, angle)

    def energy(e):
        return least(lambda width: at(1 + e, width), 0.05, 1.0)

    force = near("force/N", pull(run), 50 * stress(energy, 0.45, 1e-4), 1e-4)
    return [run], [force, Number("shear/deg", run.shear(), 50, 90)]


def tension_compression(s):
    """free tension to 3 %, p_min 0 to 1, cells of aspect 1 to 50: homogeneous where the law is
    stable, else less energy"""
    runs, numbers = [], []
    for p_min, ny in ((0.0, 6), (0.1, 6), (0.25, 120), (1.0, 300)):
        fabric = s.fabric.replace(p_min=p_min)
        runs.append(run := strip(s, ff.rolling_ends(6.0), fabric, nx=24, ny=ny))
        W = least(lambda b, f=fabric: float(density(f, 0.03, b, 0.0)), -0.6, 0.0)
        over = run.energy / (200 * 50 * W) - 1
        low, high = (-0.9, -1e-3) if p_min == 0 else (-1e-8, 1e-8)
        numbers.append(Number(f"p_min {p_min} energy over the homogeneous one", over, low, high))
    return runs, numbers


def framed(s, fabric, gradient, nx=16, steps=20):
    """Run of a square of 50 mm whose edge follows `gradient` of the load."""
    scene = ff.Scene(rectangle(s, 50, 50, nx), [ff.Membrane(fabric)], ff.frame(gradient))
    return Run(scene, steps=steps)


def over(run, fabric, gradient):
    """Energy of a square of 50 mm over that of bands; of a run that stops, over the homogeneous
    one. The edge hinders bands, and there are more kinds of them."""
    F, W = gradient(run.outcome.reached), run.energy / 2500
    if run.outcome.reached < 1:
        return Number("energy over the homogeneous one", W / of_gradient(fabric, F), 0.3, 1.2)
    return Number("energy over that of bands", W / banded(fabric, F), 0.85, 1.2)


def squeezed_strip(E_C):
    """A case of a compressed square with the yarns' E_C [MPa]."""

    def case(s):
        fabric = s.fabric.replace(d=E_C / 2)
        run = strip(s, ff.clamped_ends(-10.0), fabric, length=50.0, nx=16)
        return [run], [over(run, fabric, lambda load: np.diag([1 - 0.2 * load, 1.0]))]

    case.__doc__ = f"a clamped square compressed by 20 % along its yarns, E_C {E_C} MPa"
    return case


def sheared(degrees, load):
    """Gradient of a frame that is closed by an angle at full load."""
    g = math.radians(degrees * load)
    return np.array([[1, math.sin(g)], [0, math.cos(g)]])


def compression_and_shear(s_C):
    """A case of a frame that compresses and shears, with the fabric's s_C."""

    def case(s):
        fabric, gradient = s.fabric.replace(s_C=s_C), lambda v: (1 - 0.1 * v) * sheared(20, v)
        run = framed(s, fabric, gradient)
        return [run], [over(run, fabric, gradient)]

    case.__doc__ = f"a frame that compresses yarns by 10 % and shears them to 20 deg, s_C {s_C:g}"
    return case


def picture_frame(s):
    """a picture frame closed to 70 deg: the closed form of its energy"""
    run = framed(s, s.fabric, partial(sheared, 70), 12, 14)
    energy = 2500 * float(of_gradient(s.fabric, sheared(70, 1.0)))
    return [run], [near("energy/N mm", run.energy, energy, 1e-9)]


STATES = {"tension": (0.1, 0.06), "tension a": (0.1, -0.2), "tension b": (-0.2, 0.1)}
STATES["compression"] = (-0.3, -0.2)


def single_elements(s):
    """one element in each of the four states of strain, up to 30 %, with shear of 40 deg: work of
    its edge over the energy, and stress, against the law"""
    runs, numbers = [], []
    for name, (a, b) in STATES.items():
        g = math.radians(40)

        def gradient(load, a=a, b=b):
            G = np.array([[1 + a, (1 + b) * math.sin(g)], [0, (1 + b) * math.cos(g)]])
            return np.eye(2) + load * (G - np.eye(2))

        blank = rectangle(s, 1, 1, 1, element="Q1")
        scene = ff.Scene(blank, [ff.Membrane(s.fabric)], ff.frame(gradient))
        runs.append(Run(scene, steps=16))
        F, P = gradient(1.0), virial(scene) / s.fabric.thickness
        slope = stress(lambda x: of_gradient(s.fabric, F + np.array([[0, x], [0, 0]])), 0.0)
        numbers.append(near(f"{name} P12/MPa", P[0, 1], float(slope), 1e-6))
    return runs, numbers


def scales(s):
    """lengths of a thousandth and a thousand times, thickness 0.001, 0.01 and 20 mm: forces
    scale"""

    def scaled(k, t):
        fabric = s.fabric.replace(thickness=t * s.fabric.thickness)
        size = {"length": 200 * k, "width": 50 * k, "nx": 24}
        return strip(s, ff.clamped_ends(6.0 * k), fabric, **size)

    sizes = (1, 1), (1e-3, 1), (1e3, 1), (1, 1e-3), (1, 0.01), (1, 20)
    first, *others = (scaled(*size) for size in sizes)
    forces = (pull(run) / k / t for run, (k, t) in zip(others, sizes[1:]))
    return [first, *others], [near("force", each, pull(first), 1e-8) for each in forces]
