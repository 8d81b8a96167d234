"""Error over cost of runs, with their fronts, as a picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from .fronts import Row, resolved_error, succeeded

SOLVES = "wall time / linear-elastic solves of the baseline mesh"
MARKERS = {"P1": "^", "P2": "v", "P3": "<", "Q1": "s", "Q2": "D"}


def draw_fronts(path: Path, strips: Mapping[str, Sequence[Row]], cost_of: str = SOLVES) -> None:
    """Draw error over cost of the strips {name: rows}, with their fronts; cost_of: what cost is."""
    size = 5.2 * len(strips), 5.4
    figure, axes = plt.subplots(1, len(strips), figsize=size, squeeze=False, layout="constrained")
    patterns: dict[str, str] = {}
    for ax, (name, rows) in zip(axes[0], strips.items()):
        good = succeeded(rows)
        kinds = [(r["element"], r["pattern"], r["integration"]) for r in good]
        for element, pattern, integration in dict.fromkeys(kinds):
            kind = element, pattern, integration
            mine = [r for r, each in zip(good, kinds) if each == kind]
            shape = "rectangles" if element[0] == "Q" and pattern == "crossed" else pattern
            colour = patterns.setdefault(shape, f"C{len(patterns)}")
            fill = {"mfc": "none"} if integration == "inner" else {}
            cost, error = [r["cost"] for r in mine], [r["error_curve"] for r in mine]
            ax.plot(cost, error, MARKERS[element], color=colour, ms=5, **fill)
        front = sorted((r["cost"], resolved_error(r)) for r in good if r["on_front"])
        ax.step([x for x, _ in front], [y for _, y in front], where="post", color="k", lw=1)
        ax.axhspan(0, rows[0]["error_bar"], color="0.9")
        ax.set(xscale="log", yscale="log", xlabel=cost_of, title=name)
        ax.set_ylabel("largest error of the curve / final reaction")
        ax.grid(alpha=0.3)
    used = dict.fromkeys(r["element"] for rows in strips.values() for r in succeeded(rows))
    point = {"ls": "", "color": "0.4"}
    keys = [
        plt.Line2D([], [], color="k", lw=1, label="front"),
        *(plt.Line2D([], [], marker=MARKERS[e], label=e, **point) for e in sorted(used)),
    ]
    if any(r["error_bar"] for rows in strips.values() for r in succeeded(rows)):
        keys.append(plt.Rectangle((0, 0), 1, 1, color="0.9", label="not resolved"))
    if any(r["integration"] == "inner" for rows in strips.values() for r in rows):
        keys.append(plt.Line2D([], [], marker="v", mfc="none", label="inner", **point))
    for shape, colour in patterns.items():
        keys.append(plt.Line2D([], [], ls="", marker="o", color=colour, label=shape))
    figure.get_layout_engine().set(rect=(0, 0.13, 1, 0.87))
    figure.legend(handles=keys, loc="lower center", ncols=6, fontsize="small")
    figure.savefig(path, dpi=130)
    plt.close(figure)
