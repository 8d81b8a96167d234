"""What an identification tells on the screen, and its pictures."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from fabric_fenicsx.core.formatting import percent
from fabric_fenicsx.identification import Identification
from fabric_fenicsx.identification.curves import STRAINS


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
    from fabric_fenicsx.results.pictures import figure  # takes long to import

    count, names = len(result.fits), list(result.determined)
    across = min(4, count)
    down, side = -(-count // across), 0.45 * len(names)
    kinds = ["fit", "residuals", "correlation", *(["compaction"] if result.compaction else [])]
    files = {kind: f"{stem}_{kind}.png" for kind in kinds}
    for kind in ("fit", "residuals"):
        size = 0.6 + 3.6 * across, 0.4 + 2.9 * down
        with figure(files[kind], size, down, across) as (_, axes):
            for ax, fit in zip(axes.flat, result.fits):
                _draw_curve(ax, *fit, kind == "residuals" and math.sqrt(result.variance))
            for ax in axes.flat[count:]:
                ax.set_axis_off()
            if kind == "fit":
                axes[0, 0].legend()
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
            ax.legend()
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
        ax.set_ylabel("residual / std. deviation")
    else:
        style = {"fmt": ".", "markersize": 4, "elinewidth": 0.6}
        ax.errorbar(x, response.values, sd, label="measured", **style)
        ax.plot(x, predicted, "-", label="fitted")
        ax.set_ylabel(f"{response.column} / {response.unit}")
    ax.set_xlabel(f"{name} / {unit}")
    ax.set_title(f"{curve.file.removesuffix('.csv')}: {response.column}", fontsize="medium")
