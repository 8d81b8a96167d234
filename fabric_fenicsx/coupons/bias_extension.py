"""Bias extension of a woven strip, its yarns at +-45 deg to the load."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import InputError
from ..core.fields import documented
from ..core.formatting import rounded
from ..energy.bending import Bending
from ..identification.curves import bias_normalised
from ..job.job import Result
from ..results import measures
from ..sheet.sheet import Values, YarnBending, declared_again
from .pin_jointed import PinJointedStrip
from .strip import Strip


@documented
@dataclass(frozen=True, kw_only=True)
class BiasExtension(Strip, YarnBending):
    """Tension of a woven strip whose yarns are at +-45 deg to the load.

    Raises
    ------
    InputError
        For a value that is not allowed; by `build` for a strip that is too short.

    References
    ----------
    Fig. 9 of Schäfer et al.

    Examples
    --------
    >>> test = ff.BiasExtension(nx=4, element="P1", strain=0.05)
    >>> result = test.job(steps=4).run()
    >>> round(result.summary["quantities"]["theory_shear_angle_deg"], 2)
    7.92
    """

    NAME = "bias_extension"
    FULL = {"nx": 40, "steps": 20}
    HEADLINES = (
        "centre_shear_angle_deg",
        "half_zone_shear_angle_deg",
        "normalised_shear_force_N_per_mm",
    )

    fibre_angle: float = declared_again(Strip, "fibre_angle", default=45.0)

    @property
    def strip(self) -> PinJointedStrip:
        """The same strip with inextensible yarns."""
        a, (length, width) = math.radians(self.fibre_angle), self.high - self.low
        return PinJointedStrip(length, width, a, a + math.radians(self.yarn_angle))

    @property
    def no_theory(self) -> str:
        """Why inextensible yarns say nothing of this test, or ""."""
        whole = abs(self.area / np.prod(self.high - self.low) - 1) < 1e-6
        return self.strip.locked if whole else "the sheet is not the whole rectangle"

    def sheet_warnings(self) -> list[str]:
        """As of a strip; InputError for one that is too short."""
        length, width = self.high - self.low
        if length < 2 * width * (1 - 1e-9):
            raise InputError(
                f"the strip is {rounded(length, 6)} mm long and {rounded(width, 6)} mm wide; "
                "expected a length of 2 widths or more, for a zone of full shear"
            )
        return super().sheet_warnings()

    def terms(self) -> Sequence[Bending]:
        """In-plane bending of yarns that the grips hold straight, if asked for."""
        if not self.bend_within:
            return []
        near, sides = 1e-6 * (self.high - self.low)[0], (self.low[0], self.high[0])
        along, ratio, own = self.blank.along, self.in_plane_bending, self.in_plane_stiffness
        ends = [lambda x, at=at: abs(along(x)[0] - at) < near for at in sides]
        E = self.bending_modulus
        return [Bending(modulus=E, in_plane=ratio, in_plane_stiffness=own, clamped=ends)]

    def quantities(self, result: Result) -> Values:
        """Shear angles by zones, beside theory's, and the shear force as a test derives it."""
        rows, gamma = result.rows, np.abs(result.fields["shear_angle"])
        strip, rest = self.strip, self.membrane.weave_angle
        theory, found = [math.nan], Values()
        if not self.no_theory:
            theory = [abs(strip.shear_angle(row["displacement_mm"], rest)) for row in rows]
            found = self._by_zones(gamma)
        known = math.isfinite(theory[-1])
        if self.at_45 and rest is None and known and theory[-1] > 0:
            reaction = [row["reaction_N"] for row in rows]
            force = bias_normalised(theory, reaction, strip.length, strip.width)
            found["normalised_shear_force_N_per_mm"] = float(force[-1])
        centre = measures.mean(self.comm, gamma, self.near_centre() * self.blank.areas())
        at_centre = math.degrees(centre) if self.has_centre and centre is not None else None
        found["centre_shear_angle_deg"] = at_centre
        found["theory_shear_angle_deg"] = math.degrees(theory[-1]) if known else None
        if not known:
            apart = "the clamps are further apart than inextensible yarns allow"
            found["no_theory_because"] = self.no_theory or apart
        return found | self.ranges(result)

    def _by_zones(self, gamma):
        """Mean shear angle of each zone of the theory [deg]."""
        (x, y), width = self.blank.midpoints() - self.low[:, None], (self.high - self.low)[1]
        (a, b), distance = self.strip.held(x, y)
        # elsewhere the two yarns turn by different angles
        halves = {"half": a != b} if self.at_45 else {"only_a_held": a & ~b, "only_b_held": b & ~a}
        found: Values = {}
        for name, zone in {"free": ~a & ~b, **halves, "clamped": a & b}.items():
            area = (zone & (distance > width / 10)) * self.blank.areas()
            if (mean := measures.mean(self.comm, gamma, area)) is not None:
                found[f"{name}_zone_shear_angle_deg"] = math.degrees(mean)
        return found

    def end(self, result: Result, folder: Path) -> None:
        """axis.csv: position [mm] and magnitude of the shear angle [deg] of the cells along the
        strip's axis, those with their middle within a twentieth of the width, or, of a mesh too
        coarse for that, those nearest to it."""
        width = (self.high - self.low)[1]
        x, y = self.blank.midpoints() - self.low[:, None]
        off = np.abs(y - width / 2)
        near = off <= max(width / 20, measures.extremes(self.comm, off)[0] * (1 + 1e-6))
        gamma = np.degrees(np.abs(result.fields["shear_angle"]))
        parts = self.comm.gather(np.column_stack([x, y, gamma])[near])
        if parts:
            profile = np.concatenate(parts)
            profile = profile[np.lexsort(np.round(profile[:, 1::-1].T, 6))][:, ::2]
            how = {"fmt": "%.9g", "delimiter": ",", "comments": ""}
            np.savetxt(folder / "axis.csv", profile, header="position_mm,shear_angle_deg", **how)

    def pictures(self, result: Result, folder: Path) -> None:
        """axis.png, beside theory, on rank 0."""
        from ..results import pictures  # takes long to import

        profile = np.loadtxt(folder / "axis.csv", delimiter=",", skiprows=1, ndmin=2)
        series = {"simulated": (*profile.T, ".")}
        if not self.no_theory:
            length, width = self.high - self.low
            x, stroke = np.linspace(0, length, 2001), result.rows[-1]["displacement_mm"]
            rest = self.membrane.weave_angle
            theory = self.strip.shear_angles(x, np.full_like(x, width / 2), stroke, rest)
            if np.isfinite(theory).any():
                series["inextensible yarns"] = (x, np.degrees(np.abs(theory)), "-")
        labels = "position along the axis / mm", "magnitude of the shear angle / deg"
        pictures.curves(folder / "axis.png", series, *labels)
