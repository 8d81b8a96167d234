"""Pictures of an identification."""

import math
from pathlib import Path

import numpy as np

from . import curves as data
from .result import Identification


def draw(result: Identification, stem: Path | str) -> list[str]:
    """Write stem_fit.png (measured and fitted curves), stem_residuals.png (in standard deviations),
    stem_correlation.png and, with tests of it, stem_compaction.png; returns their names."""
    from matplotlib.figure import Figure

    n = len(result.fits)
    across = min(4, n)
    down = -(-n // across)
    written = []
    for kind in ("fit", "residuals"):
        figure = Figure(figsize=(0.6 + 3.1 * across, 0.4 + 2.5 * down), layout="constrained")
        axes = figure.subplots(down, across, squeeze=False).ravel()
        for ax, (curve, response, predicted, sd) in zip(axes, result.fits):
            column = data.STRAINS[curve.abscissa]
            x = (
                np.degrees(curve.strains[:, 2])
                if column == "gamma"
                else 100 * curve.strains[:, curve.abscissa]
            )
            if kind == "fit":
                ax.errorbar(
                    x,
                    response.values,
                    sd * math.sqrt(result.variance),
                    fmt=".",
                    markersize=4,
                    elinewidth=0.6,
                    label="measured",
                )
                ax.plot(x, predicted, "-", label="fitted")
                ax.set_ylabel(f"{response.column} / {response.unit}", fontsize=8)
            else:
                ax.axhline(0, color="0.6", linewidth=0.8)
                ax.plot(
                    x,
                    (response.values - predicted) / (sd * math.sqrt(result.variance or 1)),
                    ".",
                    markersize=4,
                )
                ax.set_ylabel("residual / std. deviation", fontsize=8)
            ax.set_xlabel(f"{column} / {'deg' if column == 'gamma' else '%'}", fontsize=8)
            ax.set_title(f"{curve.file.removesuffix('.csv')}: {response.column}", fontsize=8)
            ax.tick_params(labelsize=7)
        axes[0].legend(fontsize=7) if kind == "fit" else None
        for ax in axes[n:]:
            ax.set_axis_off()
        written.append(f"{stem}_{kind}.png")
        figure.savefig(written[-1], dpi=130)
    names = list(result.determined)
    figure = Figure(
        figsize=(1.8 + 0.45 * len(names), 1.2 + 0.45 * len(names)), layout="constrained"
    )
    ax = figure.subplots()
    image = ax.imshow(result.correlation, cmap="coolwarm", vmin=-1, vmax=1)
    ax.set_xticks(range(len(names)), names, rotation=90)
    ax.set_yticks(range(len(names)), names)
    figure.colorbar(image, label="correlation")
    written.append(f"{stem}_correlation.png")
    figure.savefig(written[-1], dpi=130)
    if result.compaction:
        written.append(_draw_compaction(result.compaction, stem))
    return written


def _draw_compaction(fit, stem):
    """Measured and fitted thickness over pressure; returns the file's name."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.4, 3.2), layout="constrained")
    ax = figure.subplots()
    for test, measured, fitted in fit.tests:
        (dots,) = ax.semilogx(1e3 * test.pressure, measured, ".", label=test.file)
        ax.semilogx(1e3 * test.pressure, fitted, "-", color=dots.get_color())
    ax.set_xlabel("pressure / kPa")
    ax.set_ylabel("thickness of a ply / mm")
    ax.legend(fontsize=8)
    figure.savefig(name := f"{stem}_compaction.png", dpi=130)
    return name
