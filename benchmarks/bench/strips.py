"""Three strips that are pulled: on which meshes they are solved, and what is compared of them."""

import math
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.results import measures
from fabric_fenicsx.scene import output
from fabric_fenicsx.solve.stepping import LoadStepping

LENGTH, WIDTH = 200.0, 50.0  # mm
SPACING = 2.5  # mm, of the points that a camera follows
# their undeformed places, (81, 21, 2) [mm]
GRID = SPACING * np.moveaxis(np.mgrid[0:81, 0:21], 0, -1)


class Strip(NamedTuple):
    """A strip with yarns a at `angle` [deg] to its length, clamped and pulled by `strain`. Its
    `series` has meshes of one kind with more and more rectangles along the length, others are
    `checks`: words such as "P2 crossed 24 degree 4", the last of quadrature."""

    angle: float
    strain: float
    series: list[str]
    checks: tuple[str, ...]


# Shear jumps across yarns from the corners, over tenths of a millimetre: meshes are graded there.
GRADED = [f"P1 graded {nx}" for nx in (24, 48, 96, 192, 384)]
CROSSED = [f"P2 crossed {nx}" for nx in (24, 48, 96, 192)]
STRIPS = {
    "tensile": Strip(0.0, 0.03, CROSSED, ("P1 crossed 192", "P2 unstructured 96")),
    "bias10": Strip(45.0, 0.1, GRADED, ("P2 graded 96", "P2 graded 96 degree 4")),
    "bias30": Strip(45.0, 0.3, GRADED[:-1], ("P2 crossed 96", "P2 crossed 96 degree 4")),
}


def strip_scene(comm, fabric, name, mesh, degree, integration):
    """Scene of the strip `name` on a mesh; degree: of quadrature, where the mesh has none."""
    strip, (element, pattern, nx, *own) = STRIPS[name], mesh.split()
    cells = {"nx": int(nx), "pattern": pattern, "element": element, "comm": comm}
    blank = ff.Blank.rectangle(LENGTH, WIDTH, fibre_angle=strip.angle, **cells)
    membrane = ff.Membrane(fabric, int(own[1]) if own else degree, integration)
    return ff.Scene(blank, [membrane], ff.clamped_ends(strip.strain * LENGTH))


def pull(newton, settings):
    """Outcome of a strip's run to full load; its load factors and reactions [N], (2, n)."""
    scene, curve = newton.scene, []

    def keep(accepted):
        curve.append((accepted.load, float(scene.reaction("moving grip")[0])))

    return LoadStepping(newton, settings, on_accept=keep).run(), np.transpose(curve)


def strip_values(scene):
    """What is compared of a solved strip. Means at the centre, by area, are of cells with midpoints
    within an eighth of the width of it (or the nearest)."""
    blank, comm, fields = scene.blank, scene.comm, output.cell_fields(scene)
    centre = measures.near(comm, blank.midpoints(), (LENGTH / 2, WIDTH / 2), WIDTH / 8)
    values: dict = {"reaction_N": float(scene.reaction("moving grip")[0])}
    values["energy_Nmm"] = scene.energies()["strain"]
    shear = np.degrees(np.abs(fields["shear_angle"]))
    compared = {"eps_a": fields["eps_a"], "eps_b": fields["eps_b"], "shear_deg": shear}
    for name, field in compared.items():
        values[f"centre_{name}"] = measures.mean(comm, field, blank.areas() * centre)
        values[f"{name}_min"], values[f"{name}_max"] = measures.extremes(comm, field)
    return values


def camera_displacements(scene):
    """Displacements of the camera's points on a strip, (81, 21, 2) [mm], on all ranks."""
    edge = 1e-9 * LENGTH  # points on the edge may be outside, by rounding
    points = np.clip(GRID.reshape(-1, 2), edge, [LENGTH - edge, WIDTH - edge])
    values = compat.values_at(scene.blank.u, np.pad(points, ((0, 0), (0, 1))))
    values = np.where(np.isnan(values), -np.inf, values)
    scene.comm.Allreduce(MPI.IN_PLACE, values, MPI.MAX)
    return values.reshape(GRID.shape)


def field_distance(angle, u, other):
    """Distances of two displacements [mm] of the camera's points on a strip with yarns a at `angle`
    [deg]: of Green-Lagrange strains, relative in L2, and of shear angles, root mean square
    [deg]."""
    strains, angles = [], []
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    for x in (GRID + u, GRID + other):
        along, across = np.diff(x, axis=0), np.diff(x, axis=1)
        F = np.stack([along[:, 1:] + along[:, :-1], across[1:] + across[:-1]], -1) / (2 * SPACING)
        strains.append((np.swapaxes(F, -1, -2) @ F - np.eye(2)) / 2)
        a, b = F @ [c, s], F @ [-s, c]
        angles.append(np.degrees(np.arctan2((a * b).sum(-1), np.linalg.det(F))))
    strain = np.linalg.norm(strains[0] - strains[1]) / np.linalg.norm(strains[1])
    return float(strain), float(np.sqrt(np.mean((angles[0] - angles[1]) ** 2)))


def curve_distance(curve, reference):
    """Largest distance of the polygon through the points of `curve` from those of `reference`, both
    (2, n), over the last of the latter: what is read off a plotted curve is off by that."""
    off = np.abs(np.interp(reference[0], *curve) - reference[1])
    return float(off.max() / abs(reference[1, -1]))
