"""The result of an identification, for a material file and a report."""

from dataclasses import dataclass

import numpy as np

from ..core.formatting import rounded
from ..material.laws.coupled import WovenFabric
from .curves import Curve, Response
from .problem import Assumed, Determined, numbers_report
from .separate import CompactionFit, FrictionFit


@dataclass(frozen=True)
class Identification:
    """The result of `identify`. fits: for each measured column (curve, response, predicted (n,),
    deviation (n,)); correlation (m, m) in the order of `determined`; variance: of the weighted
    residuals (1: as the noise was stated); simulated: how far a fit to simulated specimens of bias
    tests is from that of homogeneous shear: s1, s2, s3 of the latter [MPa], and for each file the
    r.m.s. difference of simulated from measured forces over the largest measured, with the latter
    (`off_homogeneous`) and with the fit itself (`off`)."""

    fabric: WovenFabric
    determined: dict[str, Determined]
    assumed: dict[str, Assumed]
    correlation: np.ndarray
    fits: list[tuple[Curve, Response, np.ndarray, np.ndarray]]
    degrees_of_freedom: int
    variance: float
    noise_estimated: float | None  # share of each peak, for curves that state none
    shear_stiffness_min: float | None  # least tau' over the measured angles [MPa]
    convex_in_tension: bool | None  # whether W(eps_a, eps_b) is, over the measured tension
    warnings: list[str]
    areal_weight: float | None = None  # [g/m2], if the density is from it
    compaction: CompactionFit | None = None  # None without a test of it: the default
    friction: FrictionFit | None = None  # between yarns; None without loops
    simulated: dict[str, dict[str, float]] | None = None  # None if no specimen was

    def remarks(self) -> list[str]:
        """Lines for a material file on the origin of its values."""
        lines = []
        if self.areal_weight is not None:
            weight, thickness = f"{self.areal_weight:g} g/m2", f"{self.fabric.thickness:g} mm"
            lines.append(f"density = areal weight {weight} / thickness {thickness}")
        for name, p in self.all_determined.items():
            low, high = (rounded(value, 4) for value in p.interval)
            lines.append(f"{name} was fitted, 95 % interval {low} to {high} {p.unit}")
        for name, assumed in self.all_assumed.items():
            value = f"{rounded(assumed.value, 6)} {assumed.unit}".removesuffix(" -")
            lines.append(f"{name} = {value} is {assumed}")
        if self.compaction is None:
            lines.append("compaction is assumed (default): no test measures it")
        return lines

    @property
    def all_determined(self) -> dict[str, Determined]:
        """Fitted parameters of law, compaction and friction."""
        across = self.compaction.determined if self.compaction else {}
        numbers = self.determined | {f"compaction.{name}": p for name, p in across.items()}
        return numbers | (self.friction.determined if self.friction else {})

    @property
    def all_assumed(self) -> dict[str, Assumed]:
        """Assumed parameters of the law and of compaction."""
        across = self.compaction.assumed if self.compaction else {}
        return self.assumed | {f"compaction.{name}": p for name, p in across.items()}

    def report(self) -> dict:
        """The result for JSON, with the r.m.s. error of each curve."""
        names = list(self.determined)
        return {
            "material": self.fabric.name,
            "balanced": self.fabric.is_balanced,
            "density_g_per_cm3": self.fabric.density,
            "areal_weight_g_per_m2": self.areal_weight,
            "parameters": len(names) + len(self.assumed),
            **numbers_report(self.determined, self.assumed),
            "correlation": {"names": names, "matrix": np.round(self.correlation, 4).tolist()},
            "curves": [_error(*fit) for fit in self.fits],
            "compaction": self.compaction and self.compaction.report(),
            "shear_friction": self.friction and self.friction.report(),
            "simulated": self.simulated,
            "degrees_of_freedom": self.degrees_of_freedom,
            "variance_of_weighted_residuals": self.variance,
            "noise_estimated_of_peak": self.noise_estimated,
            "shear_stiffness_min_MPa": self.shear_stiffness_min,
            "convex_in_tension": self.convex_in_tension,
            "warnings": self.warnings,
        }


def _error(curve, response, predicted, _):
    rms = float(np.sqrt(np.mean((predicted - response.values) ** 2)))
    kind, size = curve.noise or (None, 0.0)
    stated = f"{size:g} {response.unit}" if kind == "absolute" else f"{100 * size:g} % of {kind}"
    return {
        "file": curve.file,
        "test": curve.test,
        "column": response.column,
        "unit": response.unit,
        "points": len(predicted),
        "rms_error": rms,
        "rms_error_of_peak": rms / response.peak,
        "noise_stated": stated if kind else None,
    }
