"""Shear of a woven square in a rigid picture frame, its yarns along the arms."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..core.errors import InputError
from ..core.fields import documented, quantity
from ..core.rules import POSITIVE, Rule
from ..job.job import Job, Result
from ..material.homogeneous import conjugate, gradient
from ..material.laws.base import stresses_of_energy
from ..results import measures
from ..scene import output as scene_output
from ..scene.scene import Scene
from ..scene.supports import Supports, frame
from ..sheet.sheet import Values, declared_again
from .coupon import Coupon


@documented
@dataclass(frozen=True, kw_only=True)
class PictureFrame(Coupon):
    """Shear of a woven square in a rigid hinged frame, its yarns along the arms.

    Raises
    ------
    InputError
        For a value that is not allowed, and for yarns off the arms.

    Examples
    --------
    >>> test = ff.PictureFrame(nx=2, angle=30.0)
    >>> found = test.job(steps=10).run().summary["quantities"]
    >>> force, law = found["normalised_shear_force_N_per_mm"], found["closed_form_N_per_mm"]
    >>> bool(abs(force / law - 1) < 1e-6)  # the state is homogeneous
    True
    """

    NAME = "picture_frame"
    CHEAP_FROM = 1000
    HEADLINES = ("normalised_shear_force_N_per_mm",)
    FULL = {"nx": 20, "steps": 40}
    QUICK = {"nx": 20, "steps": 10}
    SIDES = {"side": 200.0}
    STRETCHED: ClassVar[float] = 0.1  # of the load, in which the yarns are stretched before shear

    element: str = declared_again(Coupon, "element", default="P1")
    side: float = quantity(None, POSITIVE, "side of the square (200, or the mesh's) [mm]")
    angle: float = quantity(
        45.0,
        Rule("an angle above 0 and below 85 deg", lambda v: 0 < v < 85),
        "shear angle at full load [deg]",
    )
    pre_tension: float = quantity(
        0.0,
        Rule("a strain from 0 to 0.1", lambda v: 0 <= v <= 0.1),
        "yarn strain applied first, in the first tenth of the load",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fibre_angle % 90 or self.yarn_angle != 90:
            raise InputError(
                f"yarns are at {self.fibre_angle:g} deg to the frame and {self.yarn_angle:g} deg "
                "to each other; expected 0 and 90, along its arms"
            )

    def state(self, load: float) -> tuple[float, float]:
        """Yarn strain [-] and shear angle [rad] that the frame prescribes at a load factor."""
        stretched = self.STRETCHED if self.pre_tension else 0.0
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
            changes = {"milestones": [self.STRETCHED / 2, self.STRETCHED]} | changes
        return super().job(**changes)

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Lengthening of the frame's diagonal [mm] and the force along it [N], from the power of
        the frame's forces."""
        (strain, gamma), side, t = self.state(load), self.side, self.fabric.thickness
        P = scene_output.virial(scene) / (side**2 * t)
        tau = conjugate(P[None], self._deformation(load)[None])[0, 2]
        arm = side * (1 + strain) * math.sin(math.pi / 4 - gamma / 2)  # d(diagonal)/d(gamma)
        turned = (1 + strain) * math.cos(math.pi / 4 - gamma / 2)
        return 2 * side * (turned - math.cos(math.pi / 4)), tau * t * side**2 / arm

    def shear_force(self, row: Values) -> tuple[float, float]:
        """Shear angle [deg] and normalised shear force F_s L_frame / L_fabric^2 [N/mm] of a row of
        the history (Cao et al. 2008)."""
        gamma = self.state(row["load"])[1]
        force = row["reaction_N"] / (2 * math.cos(math.pi / 4 - gamma / 2)) / self.side
        return math.degrees(gamma), force

    def closed_form(self, strain: float, gamma: np.ndarray) -> np.ndarray:
        """The law's normalised shear force [N/mm], with friction between yarns, at yarn strain and
        shear angles (n,) [rad]."""
        mounted = math.radians((self.weave_angle or 90) - 90)
        tau = stresses_of_energy(self.fabric, strain, strain, mounted + gamma)[2]
        if friction := self.fabric.shear_friction:
            tau = tau + friction.respond(gamma, np.zeros(1)).stress
        return tau * self.fabric.thickness / ((1 + strain) * np.cos(gamma))

    def quantities(self, result: Result) -> Values:
        """Shear angle and normalised shear force, beside the law's."""
        last, fields = result.rows[-1], result.fields
        strain, gamma = self.state(last["load"])
        angle, force = self.shear_force(last)
        names = "shear_angle", "eps_a", "eps_b"
        return {
            "shear_angle_deg": angle,
            "normalised_shear_force_N_per_mm": force,
            "closed_form_N_per_mm": float(self.closed_form(strain, np.array([gamma]))[0]),
            **{name: measures.extremes(self.comm, fields[name]) for name in names},
        }

    def pictures(self, result: Result, folder: Path) -> None:
        """shear_force.png: elements beside the law."""
        from ..results import pictures  # takes long to import

        rows = [r for r in result.rows if not self.pre_tension or self.state(r["load"])[1] > 0]
        angles, forces = np.array([self.shear_force(row) for row in rows]).T
        gamma = np.linspace(0, math.radians(self.angle), 200)
        exact = self.closed_form(self.pre_tension, gamma)
        series = {"elements": (angles, forces, "o"), "closed form": (np.degrees(gamma), exact, "-")}
        labels = "shear angle / deg", "normalised shear force / (N/mm)"
        pictures.curves(folder / "shear_force.png", series, *labels)
