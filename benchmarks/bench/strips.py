"""Three strips that are pulled, on which meshes they are solved, and what is compared of them."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.material.laws import Law
from fabric_fenicsx.mechanics.shell.membrane import Membrane
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.results import measures
from fabric_fenicsx.results.curve import Measure
from fabric_fenicsx.scene import output as reports
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.scene.supports import clamped_ends
from fabric_fenicsx.sheets.blank import Blank

LENGTH, WIDTH = 200.0, 50.0

# of quadrature, with which the files of studies/reference were made
DEGREES = {"P1": 1, "P2": 2, "P3": 4, "Q1": 2, "Q2": 4}


@dataclass(frozen=True)
class Discretisation:
    """Element, number of rectangles along the length, pattern as of `specimen`, degree of
    quadrature (None: the membrane's own) and its integration."""

    element: str
    nx: int
    pattern: str = "crossed"
    quadrature: int | None = None
    integration: str = "full"

    def __str__(self) -> str:
        words = [self.element, self.pattern, str(self.nx)]
        return " ".join(words + ([f"degree {self.quadrature}"] if self.quadrature else []))


@dataclass(frozen=True)
class Strip:
    """A strip with yarns a at `angle` [deg] to its length, clamped and pulled by `strain` of it; a
    `series` of discretisations, each halving the cells of the one before, and others as
    `checks`."""

    angle: float
    strain: float
    series: tuple[Discretisation, ...]
    checks: tuple[Discretisation, ...]

    @property
    def stroke(self) -> float:
        """Displacement of the moving end at full load [mm]."""
        return self.strain * LENGTH


# Shear jumps across yarns from the corners, over tenths of a millimetre: meshes are graded there.
STRIPS = {
    "tensile": Strip(
        0.0,
        0.03,
        tuple(Discretisation("P2", nx) for nx in (24, 48, 96, 192)),
        (Discretisation("P1", 192), Discretisation("P2", 96, "unstructured")),
    ),
    "bias10": Strip(
        45.0,
        0.1,
        tuple(Discretisation("P1", nx, "graded") for nx in (24, 48, 96, 192, 384)),
        (Discretisation("P2", 96, "graded"), Discretisation("P2", 96, "graded", 4)),
    ),
    "bias30": Strip(
        45.0,
        0.3,
        tuple(Discretisation("P1", nx, "graded") for nx in (24, 48, 96, 192)),
        (Discretisation("P2", 96), Discretisation("P2", 96, quadrature=4)),
    ),
}


def moving_grip(stroke: float) -> Measure:
    """Function of a strip's scene and its load factor to the moving grip's displacement [mm] and
    reaction [N]."""
    return lambda scene, load: (load * stroke, float(scene.reaction("moving grip")[0]))


def strip_scene(
    comm: MPI.Comm, fabric: Law, strip: Strip, how: Discretisation, degree: int | None = None
) -> Scene:
    """Scene of `strip` in the `Discretisation` `how`; degree: of its quadrature where it has none
    of its own."""
    arrays: tuple[Any, Any, str | None] = (None, None, None)
    angle = math.radians(strip.angle)
    if comm.rank == 0:
        cell = "triangle" if how.element[0] == "P" else "quadrilateral"
        ny = max(1, round(how.nx * WIDTH / LENGTH))
        arrays = specimen(LENGTH, WIDTH, how.nx, ny, how.pattern, cell, angle)
    blank = Blank.from_arrays(comm, *arrays, a=angle, degree=int(how.element[1]))
    membrane = Membrane(fabric, how.quadrature or degree, how.integration)
    return Scene(blank, [membrane], clamped_ends(strip.stroke))


def strip_values(scene: Scene) -> dict[str, float]:
    """What is compared of a solved strip. Means at the centre, by area, are of cells with midpoints
    within an eighth of the width of it (or the nearest)."""
    blank, comm, fields = scene.blank, scene.comm, reports.cell_fields(scene)
    shear = np.degrees(np.abs(fields["shear_angle"]))
    distance = np.linalg.norm(blank.midpoints() - [[LENGTH / 2], [WIDTH / 2]], axis=0)
    centre = distance <= max(WIDTH / 8, measures.extremes(comm, distance)[0])
    x = blank.mesh.geometry.x[compat.geometry_dofmap(blank.mesh)[: len(distance)]]
    first, second = x[:, -1] - x[:, 0], x[:, 1] - x[:, 2 if x.shape[1] == 4 else 0]
    weights = np.linalg.norm(np.cross(first, second), axis=1) * centre
    compared = {"eps_a": fields["eps_a"], "eps_b": fields["eps_b"], "shear_deg": shear}
    values = {
        "reaction_N": float(scene.reaction("moving grip")[0]),
        "energy_Nmm": scene.energies()["strain"],
    }
    for name, field in compared.items():
        mean = measures.mean(comm, field, weights)
        assert mean is not None  # the nearest cell counts
        values[f"centre_{name}"] = mean
    for name, field in compared.items():
        values[f"{name}_min"], values[f"{name}_max"] = measures.extremes(comm, field)
    del values["shear_deg_min"]
    return values
