"""Pictures of an identification."""

import math
from pathlib import Path

import numpy as np

from .curves import STRAINS
from .result import Identification


def draw(result: Identification, stem: Path | str) -> list[str]:
    """Write stem_fit.png (measured and fitted curves), stem_residuals.png (in standard deviations),
    stem_correlation.png and, with tests of it, stem_compaction.png; returns their names."""
    figures = {
        "fit": _panels(result, False),
        "residuals": _panels(result, True),
        "correlation": _correlation(result),
    }
    if result.compaction:
        figures["compaction"] = _compaction(result.compaction)
    for kind, figure in figures.items():
        figure.savefig(f"{stem}_{kind}.png", dpi=130)
    return [f"{stem}_{kind}.png" for kind in figures]


def _figure(width, height):
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _panels(result, residuals):
    """Measured and fitted values of each curve, or the residuals in standard deviations."""
    n = len(result.fits)
    across = min(4, n)
    down = -(-n // across)
    figure = _figure(0.6 + 3.1 * across, 0.4 + 2.5 * down)
    axes = figure.subplots(down, across, squeeze=False).ravel()
    for ax, (curve, response, predicted, sd) in zip(axes, result.fits):
        name, sd = STRAINS[curve.abscissa], sd * math.sqrt(result.variance)
        factor, unit = (180 / math.pi, "deg") if name == "gamma" else (100, "%")
        x = factor * curve.strains[:, curve.abscissa]
        if residuals:
            ax.axhline(0, color="0.6", linewidth=0.8)
            ax.plot(x, (response.values - predicted) / np.where(sd > 0, sd, 1), ".", markersize=4)
            ax.set_ylabel("residual / std. deviation", fontsize=8)
        else:
            style = {"fmt": ".", "markersize": 4, "elinewidth": 0.6}
            ax.errorbar(x, response.values, sd, label="measured", **style)
            ax.plot(x, predicted, "-", label="fitted")
            ax.set_ylabel(f"{response.column} / {response.unit}", fontsize=8)
            axes[0].legend(fontsize=7)
        ax.set_xlabel(f"{name} / {unit}", fontsize=8)
        ax.set_title(f"{curve.file.removesuffix('.csv')}: {response.column}", fontsize=8)
        ax.tick_params(labelsize=7)
    for ax in axes[n:]:
        ax.set_axis_off()
    return figure


def _correlation(result):
    names = list(result.determined)
    figure = _figure(1.8 + 0.45 * len(names), 1.2 + 0.45 * len(names))
    ax = figure.subplots()
    image = ax.imshow(result.correlation, cmap="coolwarm", vmin=-1, vmax=1)
    ax.set_xticks(range(len(names)), names, rotation=90)
    ax.set_yticks(range(len(names)), names)
    figure.colorbar(image, label="correlation")
    return figure


def _compaction(fit):
    figure = _figure(4.4, 3.2)
    ax = figure.subplots()
    for test, measured, fitted in fit.tests:
        (dots,) = ax.semilogx(1e3 * test.pressure, measured, ".", label=test.file)
        ax.semilogx(1e3 * test.pressure, fitted, "-", color=dots.get_color())
    ax.set_xlabel("pressure / kPa")
    ax.set_ylabel("thickness of a ply / mm")
    ax.legend(fontsize=8)
    return figure
