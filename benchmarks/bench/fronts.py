"""Errors against cost: judged by the references, the front, what to recommend, and a table as
text."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np

from fabric_fenicsx.runtime.errors import SolverFailure

from .cost_plan import Configuration
from .reference import curve_distance
from .strips import STRIPS

GOALS = 0.1, 0.01, 0.001  # errors of a curve
Row = dict[str, Any]
# column of the printed table -> its format
PRINTED = {
    **dict.fromkeys(("scene", "sweep", "element", "pattern", "integration"), "s"),
    **dict.fromkeys(("nx", "steps"), "d"),
    **dict.fromkeys(("tolerance", "path_tolerance"), ".0e"),
    "linear_solver": "s",
    **dict.fromkeys(("ranks", "dofs", "iterations"), "d"),
    **dict.fromkeys(("wall_s", "own_solves", "cost"), ".3g"),
    "tangent_ratio": ".2f",
    "memory_mib": ".0f",
    **dict.fromkeys(("error_curve", "error_reaction", "error_energy", "error_strain"), ".2%"),
    **dict.fromkeys(("error_shear_deg", "error_centre_shear_deg"), ".3f"),
    "error_centre_eps_b": ".2%",
    "yarn_strain_max": ".1e",
    "on_front": "d",
    "reason": "s",
}
PRINTED_FORMING = {
    **dict.fromkeys(("scene", "sweep", "element"), "s"),
    **dict.fromkeys(("nx", "steps", "cells", "accepted", "rejected", "iterations"), "d"),
    "cpu_s": ".3g",
    "peak_mib": ".0f",
    "punch_force_N": ".0f",
    "error_curve": ".2%",
    **dict.fromkeys(
        ("error_shear_max_deg", "error_shear_99_percent_deg", "error_draw_in_mm"), ".2f"
    ),
    "on_front": "d",
    **dict.fromkeys(("reason", "doubt"), ".60s"),
}
PRINTED_SIZES = {
    "nx": "d",
    "linear_solver": "s",
    **dict.fromkeys(("ranks", "dofs", "cells"), "d"),
    **dict.fromkeys(("tangent_s", "residual_s", "elastic_assembly_s"), ".3g"),
    "tangent_ratio": ".2f",
    "solve_s": ".3g",
    "linear_iterations": "d",
    "linear_error": ".1e",
    "memory_mib": ".0f",
    "reason": "s",
}


def judge(rows: Sequence[Row], reference: Mapping[str, Mapping[str, float]]) -> None:
    """Add to the rows of one strip, the baseline's first, their errors, their cost in elastic
    solves (their own mesh's, the baseline's) and whether they are on the front of those for which
    none is both cheaper and more accurate. Raises SolverFailure if the baseline failed."""
    base = rows[0]
    if base["reason"]:
        raise SolverFailure(f"the baseline of {base['scene']} failed: {base['reason']}")
    alike = "element", "pattern", "nx", "ranks"
    same = [r for r in rows if "elastic_solve_s" in r and all(r[k] == base[k] for k in alike)]
    unit = min(r["elastic_solve_s"] for r in same)
    bars = {
        name: quantity["error"] / abs(quantity["value"]) for name, quantity in reference.items()
    }
    for r in rows:
        r |= {"own_solves": None, "cost": None, "error_bar": bars["reaction_N"], "on_front": False}
        if r["reason"]:
            continue
        r["own_solves"], r["cost"] = r["wall_s"] / r["elastic_solve_s"], r["wall_s"] / unit

        def error(name, r=r):
            return r[name] / reference[name]["value"] - 1

        r["error_reaction"], r["error_energy"] = error("reaction_N"), error("energy_Nmm")
        if STRIPS[r["scene"]].angle:
            shear = "centre_shear_deg"
            r["error_centre_shear_deg"] = r[shear] - reference[shear]["value"]
        else:
            r["error_centre_eps_b"] = error("centre_eps_b")
    mark_front(succeeded(rows))


def mark_front(rows: Iterable[Row]) -> None:
    """Tell which of the rows are `on_front`: none is both cheaper and more accurate."""
    least = math.inf
    for r in sorted(rows, key=lambda r: (r["cost"], resolved_error(r))):
        error_now = resolved_error(r)
        r["on_front"], least = error_now < least, min(least, error_now)


def judge_forming(rows: Sequence[Row]) -> Row:
    """Add to the rows of one angle of forming their errors to the finest that succeeded, which is
    returned, and whether they are on the front of the others that are to be believed. Raises
    SolverFailure if none did."""
    if not (good := succeeded(rows)):
        raise SolverFailure(f"no run of {rows[0]['scene']} succeeded: {rows[0]['reason']}")
    finest = max(good, key=lambda r: (r["dofs"], r["element"]))
    for r in good:
        r |= {"cost": r["cpu_s"], "error_bar": 0.0, "on_front": False}
        r["error_curve"] = curve_distance(np.transpose(r["curve"]), np.transpose(finest["curve"]))
        for name in ("shear_max_deg", "shear_99_percent_deg", "draw_in_mm"):
            r[f"error_{name}"] = r[name] - finest[name]
    mark_front(r for r in good if r is not finest and not r["doubt"])
    return finest


def succeeded(rows: Iterable[Row]) -> list[Row]:
    """The rows without a reason why they failed."""
    return [r for r in rows if not r["reason"]]


def resolved_error(r: Row) -> float:
    """Error of the curve, as far as the reference resolves it."""
    return max(r["error_curve"], r["error_bar"])


def within(r: Row, goal: float) -> bool:
    """Whether the row's curve is surely within `goal`."""
    return not r["reason"] and r["error_curve"] + r["error_bar"] <= goal


def configuration(r: Row) -> Configuration:
    """The `Configuration` of a row."""
    return Configuration(**{each.name: r[each.name] for each in fields(Configuration)})


def recommended(rows: Sequence[Row]) -> dict[float, Row | str | None]:
    """{goal: cheapest row whose curve is within it, None if there is none, or a word if the
    reference is not}."""
    found: dict[float, Row | str | None] = {}
    bar = rows[0]["error_bar"]
    for goal in GOALS:
        good = [r for r in rows if within(r, goal)]
        found[goal] = min(good, key=lambda r: r["cost"], default=None)
        if bar >= goal:
            found[goal] = f"not resolved by the reference, known to {bar:.2g} of it"
    return found


def recommended_for_all(strips: Mapping[str, Sequence[Row]]) -> dict[float, list[Row] | None]:
    """{goal: of the configurations whose curves are within it in all strips {name: rows}, the
    cheapest's rows}."""
    found = {}
    for goal in GOALS:
        good: dict[Configuration, dict[str, Row]] = {}
        for r in (r for rows in strips.values() for r in rows if within(r, goal)):
            good.setdefault(replace(configuration(r), scene="", sweep=""), {})[r["scene"]] = r
        all_of_them = [list(mine.values()) for mine in good.values() if len(mine) == len(strips)]
        found[goal] = min(all_of_them, key=lambda mine: sum(r["cost"] for r in mine), default=None)
    return found


def facts(rows: Sequence[Row], advice: Mapping[float, Row | str | None]) -> dict[str, Any]:
    """What summary.json says of the rows of one strip; advice: what `recommended` gave."""
    return {
        "runs": len(rows),
        "failed": sum(bool(r["reason"]) for r in rows),
        "reference_error_bar": rows[0]["error_bar"],
        "baseline_elastic_solve_s": rows[0]["wall_s"] / rows[0]["cost"],
        "front": [str(configuration(r)) for r in rows if r["on_front"]],
        "recommended": {f"{goal:g}": choice for goal, choice in advice.items()},
    }


def advice_lines(
    by_strip: Mapping[str, Mapping[float, Row | str | None]],
    common: Mapping[float, list[Row] | None],
) -> Iterable[str]:
    """What `recommended` and `recommended_for_all` found, a line each."""
    for name, choices in by_strip.items():
        for goal, r in choices.items():
            words = r or "none of these"
            if isinstance(r, dict):
                words = (
                    f"{configuration(r)}: {r['wall_s']:.3g} s, {r['cost']:.3g} baseline solves, "
                    f"errors of the curve {r['error_curve']:.2%}, the reaction "
                    f"{r['error_reaction']:.2%} and strain {r['error_strain']:.2%}"
                )
            yield f"{name}, curve within {goal:.1%}: {words}"
    for goal, choice in common.items():
        words = "; ".join(f"{configuration(r)}: {r['cost']:.3g}" for r in choice or ())
        words = words or "none of these"
        yield f"all scenes, curve within {goal:.1%}, cost in baseline solves: {words}"


def size_exponents(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """From rows of `cost.solution_cost`: exponents over the unknowns and costs an unknown, by
    solver, and gains by ranks."""
    found: dict[str, dict[str, float]] = {}
    good, costs = succeeded(rows), ("tangent_s", "solve_s", "memory_mib")
    for solver in dict.fromkeys(r["linear_solver"] for r in good):
        mine = [r for r in good if r["linear_solver"] == solver and r["ranks"] == 1]
        if len(mine) > 1:
            dofs, last = np.log([r["dofs"] for r in mine]), mine[-1]
            found[solver] = {
                f"exponent_of_{k}": float(np.polyfit(dofs, np.log([r[k] for r in mine]), 1)[0])
                for k in costs
            }
            found[solver] |= {f"{k}_per_dof": last[k] / last["dofs"] for k in costs}
    alike = "nx", "linear_solver"
    for two in (r for r in good if r["ranks"] > 1):
        same = (r for r in good if r["ranks"] == 1 and all(r[k] == two[k] for k in alike))
        alone, parts = next(same), ("tangent_s", "residual_s", "solve_s")
        gains = {f"gain_of_{k}": alone[k] / two[k] for k in parts}
        found[f"{two['ranks']} ranks, {two['cells']} cells"] = gains
    return found


def size_lines(found: Mapping[str, Mapping[str, float]]) -> Iterable[str]:
    """What `size_exponents` found, a line each."""
    for name, values in found.items():
        yield f"{name}: " + ", ".join(f"{k} {v:.3g}" for k, v in values.items())


def table(rows: Iterable[Row], printed: Mapping[str, str] = PRINTED) -> str:
    """The columns `printed` {name: format} of rows as text."""

    def text(value, form):
        return "-" if value is None or value == "" else format(value, form)

    def short(name):
        name = name.replace("error_", "e_").replace("tolerance", "tol")
        return name.replace("centre_", "")

    lines = [[short(name) for name in printed]]
    lines += [[text(r.get(k), form) for k, form in printed.items()] for r in rows]
    widths = [max(map(len, column)) for column in zip(*lines)]
    padded = [[word.rjust(w) for word, w in zip(line, widths)] for line in lines]
    return "\n".join("  ".join(line).rstrip() for line in padded)
