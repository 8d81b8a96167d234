"""The result of an identification, for a material file, a report, the screen and pictures."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.formatting import percent, rounded
from ..material.laws.coupled import WovenFabric
from .curves import STRAINS, Curve, Response
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
            lines.append("compaction is assumed (default): there is no test of it")
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


def result_lines(result: Identification) -> Iterator[str]:
    """Lines for the screen: the parameters of `result`, the errors of its curves, its warnings."""
    for name, p in result.all_determined.items():
        low, high = p.interval
        yield f"{name:20s} {p.value:12.6g} {p.unit:4s} 95 % interval {low:.6g} to {high:.6g}"
    for name, assumed in result.all_assumed.items():
        yield f"{name:20s} {assumed.value:12.6g} {assumed.unit:4s} {assumed}"
    report = result.report()
    for curve in report["curves"]:
        error = f"{curve['rms_error']:.4g} {curve['unit']}"
        share = f"{percent(curve['rms_error_of_peak'])} of its peak"
        yield f"{curve['file']}: r.m.s. error of {curve['column']} {error}, {share}"
    for test in (report["compaction"] or {"tests": []})["tests"]:
        yield f"{test['file']}: r.m.s. error of thickness {test['rms_error_mm']:.3g} mm"
    if fit := result.simulated:
        shear = ", ".join(f"{name} {value:.4g} MPa" for name, value in fit["homogeneous"].items())
        yield f"specimens of bias tests were simulated; by homogeneous shear: {shear}"
        for file, off in fit["off"].items():
            before = f"{percent(fit['off_homogeneous'][file])} with the fit of homogeneous shear"
            share = f"{percent(off)} of its peak"
            yield f"{file}: the simulated force is {share} off r.m.s., and {before}"
    if result.areal_weight is not None:
        density = f"{result.fabric.density:.4g} g/cm3"
        yield f"density {density} = areal weight {result.areal_weight:g} g/m2 / thickness"
    for warning in result.warnings:
        yield f"warning: {warning}"


def draw(result: Identification, stem: Path | str) -> list[str]:
    """Write stem_fit.png (measured and fitted curves), stem_residuals.png (in standard deviations),
    stem_correlation.png and, with tests of it, stem_compaction.png; returns their names."""
    from ..results.pictures import figure  # takes long to import

    count, names = len(result.fits), list(result.determined)
    across = min(4, count)
    down, side = -(-count // across), 0.45 * len(names)
    kinds = ["fit", "residuals", "correlation", *(["compaction"] if result.compaction else [])]
    files = {kind: f"{stem}_{kind}.png" for kind in kinds}
    for kind in ("fit", "residuals"):
        size = 0.6 + 3.1 * across, 0.4 + 2.5 * down
        with figure(files[kind], size, down, across) as (_, axes):
            for ax, fit in zip(axes.flat, result.fits):
                _draw_curve(ax, *fit, kind == "residuals" and math.sqrt(result.variance))
            for ax in axes.flat[count:]:
                ax.set_axis_off()
            if kind == "fit":
                axes[0, 0].legend(fontsize=7)
    with figure(files["correlation"], (1.8 + side, 1.2 + side)) as (page, ((ax,),)):
        image = ax.imshow(result.correlation, cmap="coolwarm", vmin=-1, vmax=1)
        ax.set_xticks(range(len(names)), names, rotation=90)
        ax.set_yticks(range(len(names)), names)
        page.colorbar(image, label="correlation")
    if result.compaction:
        with figure(files["compaction"], (4.4, 3.2)) as (_, ((ax,),)):
            for test, measured, fitted in result.compaction.tests:
                (dots,) = ax.semilogx(1e3 * test.pressure, measured, ".", label=test.file)
                ax.semilogx(1e3 * test.pressure, fitted, "-", color=dots.get_color())
            ax.set(xlabel="pressure / kPa", ylabel="thickness of a ply / mm")
            ax.legend(fontsize=8)
    return [*files.values()]


def _draw_curve(ax, curve, response, predicted, sd, scale):
    """Measured and fitted values, or with a `scale` of deviations the residuals over these."""
    name = STRAINS[curve.abscissa]
    factor, unit = (180 / math.pi, "deg") if name == "gamma" else (100, "%")
    x = factor * curve.strains[:, curve.abscissa]
    if scale:
        ax.axhline(0, color="0.6", linewidth=0.8)
        off, sd = response.values - predicted, scale * sd
        ax.plot(x, off / np.where(sd > 0, sd, 1), ".", markersize=4)
        ax.set_ylabel("residual / std. deviation", fontsize=8)
    else:
        style = {"fmt": ".", "markersize": 4, "elinewidth": 0.6}
        ax.errorbar(x, response.values, sd, label="measured", **style)
        ax.plot(x, predicted, "-", label="fitted")
        ax.set_ylabel(f"{response.column} / {response.unit}", fontsize=8)
    ax.set_xlabel(f"{name} / {unit}", fontsize=8)
    ax.set_title(f"{curve.file.removesuffix('.csv')}: {response.column}", fontsize=8)
    ax.tick_params(labelsize=7)
