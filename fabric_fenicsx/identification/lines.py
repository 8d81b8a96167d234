"""What an identification found, in lines for the screen."""

from collections.abc import Iterator, Mapping
from typing import Any

from ..runtime.formatting import percent
from .result import Identification


def result_lines(result: Identification) -> Iterator[str]:
    """Lines for the parameters of `result`, the errors of its curves and its warnings."""
    for name, p in result.all_determined.items():
        low, high = p.interval
        yield f"{name:20s} {p.value:12.6g} {p.unit:4s} 95 % interval {low:.6g} to {high:.6g}"
    for name, assumed in result.all_assumed.items():
        yield f"{name:20s} {assumed.value:12.6g} {assumed.unit:4s} {assumed}"
    for curve in result.report()["curves"]:
        yield (
            f"{curve['file']}: r.m.s. error of {curve['column']} {curve['rms_error']:.4g} "
            f"{curve['unit']}, {percent(curve['rms_error_of_peak'])} of its peak"
        )
    across = result.report()["compaction"] or {"tests": []}
    for test in across["tests"]:
        yield f"{test['file']}: r.m.s. error of thickness {test['rms_error_mm']:.3g} mm"
    if result.areal_weight is not None:
        density = f"{result.fabric.density:.4g} g/cm3"
        yield f"density {density} = areal weight {result.areal_weight:g} g/m2 / thickness"
    for warning in result.warnings:
        yield f"warning: {warning}"


def coverage_lines(found: Mapping[str, Any]) -> Iterator[str]:
    """Lines for what `coverage` found: how often true values lay in their intervals."""
    for name, inside in found["inside"].items():
        times = f"{inside} of {found['determined'][name]} times"
        yield f"{name:12s} in its 95 % interval {times}, {found['seeds']} seeds"
