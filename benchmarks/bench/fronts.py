"""Errors against cost: judged by the references, the front, the cheapest, and their picture."""

import math

import fabric_fenicsx as ff

from .strips import curve_distance

MARKERS = {"P1": "^", "P2": "v", "P3": "<", "Q1": "s", "Q2": "D"}


def judge(rows, reference):
    """Add to the rows of one strip their errors and whether they are on the front; those that
    succeeded."""
    force, good = reference["reaction_N"], succeeded(rows)
    for r in good:
        r["error_bar"] = force["error"] / abs(force["value"])
        for name in ("reaction_N", "energy_Nmm"):
            r[f"error_{name.split('_')[0]}"] = r[name] / reference[name]["value"] - 1
    mark_front(good)
    return good


def judge_forming(rows):
    """Add to the rows of one angle of forming their errors to the finest that succeeded, which is
    returned, and whether they are on the front of the others that are valid. SolverFailure if none
    did."""
    if not (good := succeeded(rows)):
        raise ff.SolverFailure(f"no run of {rows[0]['scene']} succeeded: {rows[0]['reason']}")
    finest = max(good, key=lambda r: (r["dofs"], r["mesh"]))
    for r in good:
        r |= {"error_bar": 0.0, "error_curve": curve_distance(r["curve"], finest["curve"])}
        for name in ("shear_max_deg", "shear_99_percent_deg", "draw_in_mm"):
            r[f"error_{name}"] = r[name] - finest[name]
    mark_front([r for r in good if r is not finest and not r["doubt"]])
    return finest


def mark_front(rows):
    """Tell which of the rows are `on_front`: none is both cheaper and more accurate, as far as the
    reference resolves errors of the curve."""
    least = math.inf
    for r in rows:
        r["resolved_error"] = max(r["error_curve"], r["error_bar"])
    for r in sorted(rows, key=lambda r: (r["cost"], r["resolved_error"])):
        r["on_front"] = r["resolved_error"] < least
        least = min(least, r["resolved_error"])


def succeeded(rows):
    """The rows without a reason why they failed."""
    return [r for r in rows if not r["reason"]]


def draw_fronts(path, strips, cost_of):
    """Draw error over cost of the strips {name: rows}, with their fronts; cost_of: what cost is."""
    from fabric_fenicsx.results.pictures import figure

    colours, shown = dict[str, str](), dict[str, object]()
    with figure(path, (5.2 * len(strips), 5.8), 1, len(strips)) as (drawn, (axes,)):
        for ax, (name, rows) in zip(axes, strips.items()):
            for r in succeeded(rows):
                element, pattern, _ = r["mesh"].split()
                pattern = "rectangles" if element[0] == "Q" else pattern
                style = {"color": colours.setdefault(pattern, f"C{len(colours)}"), "ms": 5}
                label = f"{element} {pattern}"
                if r["integration"] == "inner":
                    label, style = f"{label} inner", style | {"mfc": "none"}
                (shown[label],) = ax.plot(r["cost"], r["error_curve"], MARKERS[element], **style)
            front = sorted((r["cost"], r["resolved_error"]) for r in rows if r.get("on_front"))
            (shown["front"],) = ax.step(*zip(*front), where="post", color="k", lw=1)
            if bar := rows[0]["error_bar"]:
                shown["not resolved"] = ax.axhspan(0, bar, color="0.9")
            ax.set(xscale="log", yscale="log", xlabel=cost_of, title=name)
            ax.set_ylabel("largest error of the curve / final reaction")
            ax.grid(alpha=0.3)
        below = 0.02 + 0.035 * math.ceil(len(shown) / (3 * len(strips)))
        drawn.get_layout_engine().set(rect=(0, below, 1, 1 - below))
        where = {"loc": "lower center", "ncols": 3 * len(strips), "fontsize": "small"}
        drawn.legend([*shown.values()], [*shown], **where)
