"""Shear of a woven square in a rigid picture frame, its yarns along the arms."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..job.job import Job, Result
from ..material.laws.base import stresses_of_energy
from ..material.paths import conjugate, gradient
from ..results import measures
from ..runtime.errors import InputError
from ..runtime.fields import choice, number
from ..runtime.rules import POSITIVE, Rule
from ..scene import output as reports
from ..scene.scene import Scene
from ..scene.supports import Supports, frame
from .scenario import ELEMENTS, Scenario

BELOW_85 = Rule("an angle above 0 and below 85 deg", lambda v: 0 < v < 85)
UP_TO_10_PERCENT = Rule("a strain from 0 to 0.1", lambda v: 0 <= v <= 0.1)
STRETCHED = 0.1  # of the load, in which the yarns are stretched before shear begins


@dataclass(kw_only=True)
class PictureFrame(Scenario):
    """A square of `fabric` that a rigid frame shears to `angle`; its state is homogeneous. `fabric
    picture_frame --help` tells what each field is, and its unit."""

    NAME: ClassVar[str] = "picture_frame"
    CHEAP_FROM = 1000
    HEADLINES = ("normalised_shear_force_N_per_mm",)
    FULL = {"nx": 20, "steps": 40}
    QUICK = {"nx": 20, "steps": 10}
    SIZES = ("side", "side")
    DEFAULT_SIZES = (200.0, 200.0)

    element: str = choice(
        "P1", ELEMENTS, "triangles (P) or quadrilaterals (Q), and their degree", "mesh"
    )
    side: float = number(None, POSITIVE, "side of the square (200, or the mesh's) [mm]")
    angle: float = number(45.0, BELOW_85, "shear angle at full load [deg]")
    pre_tension: float = number(
        0.0, UP_TO_10_PERCENT, "yarn strain applied first, in the first tenth of the load"
    )

    def prepare(self) -> None:
        """Make blank and membrane."""
        if self.fibre_angle % 90 or self.yarn_angle != 90:
            raise InputError(
                f"yarns are at {self.fibre_angle:g} deg to the frame and {self.yarn_angle:g} deg "
                "to each other; allowed is 0 and 90, along its arms"
            )
        super().prepare()
        low, high = self.blank.extent()
        self._side = (high - low)[0]

    def state(self, load: float) -> tuple[float, float]:
        """Yarn strain [-] and shear angle [rad] that the frame prescribes at a load factor."""
        stretched = STRETCHED if self.pre_tension else 0.0
        shear = max(load - stretched, 0) / (1 - stretched)
        strain = self.pre_tension * min(load / stretched, 1) if stretched else 0.0
        return strain, math.radians(self.angle) * shear

    def _deformation(self, load):
        strain, gamma = self.state(load)
        return gradient(*np.atleast_1d(strain, strain, gamma))[0]

    def supports(self) -> Supports:
        """The whole edge in the frame."""
        return frame(self._deformation)

    def job(self, **changes: Any) -> Job:
        """The `Job`, which hits the end of the pre-tension, and a state on the way there."""
        if self.pre_tension:
            changes = {"milestones": [STRETCHED / 2, STRETCHED]} | changes
        return super().job(**changes)

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Lengthening of the frame's diagonal [mm] and the force along it [N], from the power of
        the frame's forces."""
        (strain, gamma), side, t = self.state(load), self._side, self.fabric.thickness
        P = reports.virial(scene) / (side**2 * t)
        tau = conjugate(P[None], self._deformation(load)[None])[0, 2]
        arm = side * (1 + strain) * math.sin(math.pi / 4 - gamma / 2)  # d(diagonal)/d(gamma)
        turned = (1 + strain) * math.cos(math.pi / 4 - gamma / 2)
        return 2 * side * (turned - math.cos(math.pi / 4)), tau * t * side**2 / arm

    def shear_force(self, row: dict[str, Any]) -> tuple[float, float]:
        """Shear angle [deg] and normalised shear force F_s L_frame / L_fabric^2 [N/mm] of a row of
        the history (Cao et al. 2008)."""
        gamma = self.state(row["load"])[1]
        force = row["reaction_N"] / (2 * math.cos(math.pi / 4 - gamma / 2)) / self._side
        return math.degrees(gamma), force

    def closed_form(self, strain: float, gamma: np.ndarray) -> np.ndarray:
        """The law's normalised shear force [N/mm] at yarn strain and shear angles (n,) [rad]."""
        mounted = math.radians((self.weave_angle or 90) - 90)  # how sheared the weave is at first
        tau = stresses_of_energy(self.fabric, strain, strain, mounted + gamma)[2]
        return tau * self.fabric.thickness / ((1 + strain) * np.cos(gamma))

    def quantities(self, result: Result) -> dict[str, Any]:
        """Shear angle and normalised shear force, beside the law's."""
        rows, fields = result.rows, result.fields
        strain, gamma = self.state(rows[-1]["load"])
        angle, force = self.shear_force(rows[-1])
        names = "shear_angle", "eps_a", "eps_b"
        return {
            "shear_angle_deg": angle,
            "normalised_shear_force_N_per_mm": force,
            "closed_form_N_per_mm": float(self.closed_form(strain, np.array([gamma]))[0]),
            **{name: measures.extremes(self.comm, fields[name]) for name in names},
        }

    def pictures(self, result: Result, folder: Path) -> None:
        """shear_force.png: elements beside the law."""
        from ..plot import pictures

        rows = [r for r in result.rows if not self.pre_tension or self.state(r["load"])[1] > 0]
        angles, forces = np.array([self.shear_force(row) for row in rows]).T
        gamma = np.linspace(0, math.radians(self.angle), 200)
        exact = self.closed_form(self.pre_tension, gamma)
        series = {"elements": (angles, forces, "o"), "closed form": (np.degrees(gamma), exact, "-")}
        labels = "shear angle / deg", "normalised shear force / (N/mm)"
        pictures.curves(folder / "shear_force.png", series, *labels)
