"""Validity of a result: limits that it exceeds, and doubts: the reasons of its verdict."""

import math
from collections.abc import Mapping, Sequence

from ..core.errors import NOT_VALID
from ..core.formatting import of_sheet, percent, rounded, share
from ..energy.materials import materials_of
from ..energy.membrane import Membrane
from ..results.error import ANGLE
from ..results.history import energy_balance, stretching
from ..results.quantities import fabric_doubts, limited
from ..results.result import Result
from ..results.verdict import OK, Numbers, Reason
from ..results.wrinkles import MIN_HEIGHT
from ..scene import output as scene_output
from ..scene.scene import Scene
from ..solve.limits import EDGES, Limits
from ..solve.step_criteria import UNBALANCED

MIN_CELLS = 7.0  # cells of a wave, from which on its height is within some per cent
AIM = 7.5  # cells to be taken, as waves on finer ones may be shorter
STILL = (
    "nothing moves or loads the sheet, so it does not deform; add a tool, a load or a moving "
    "support, such as `clamped_ends(stroke)`"
)
NO_ESTIMATE = Reason("the error of the mesh was not estimated", verdict=OK)


def not_valid(wrong: Sequence[str]) -> str:
    """One sentence of all that is wrong with a result, "" if nothing is."""
    return NOT_VALID + "; ".join(wrong) if wrong else ""


def _in_space(scene):
    """The checks of a sheet in space, None of one in a plane, which needs none of their modules."""
    if scene.blank.mesh.geometry.dim < 3:
        return None
    from . import space_validity

    return space_validity


def beyond_limits_now(scene: Scene, limits: Limits) -> list[str]:
    """Sentences on what no later state mends: penetration of tools, and stretched yarns."""
    depth, where = scene_output.deepest(scene)
    wrong = [f"{each}; deepest: {where}" for each in limits.exceeded({"penetration": depth})]
    over = scene_output.overstretched(scene, limits.strain)
    if over > EDGES:
        wrong.append(
            f"yarns are stretched by more than {percent(limits.strain, 3)} in {percent(over, 3)} "
            f"of the sheet; the limit is {percent(EDGES, 3)} (`Limits.strain`)"
        )
    return wrong


def not_formed(result: Result, limits: Limits) -> list[str]:
    """Sentences on fabric that can't lie as it does: sheared, filled or shortened too far."""
    return [
        f"{f'sheet {name}: ' if name else ''}{words}, at most at {of_sheet(place)}; "
        f"{_cure(result.scene, limit)}"
        for name, values in limited(result)
        for limit, (value, place) in values.items()
        for words in limits.exceeded({limit: value})
    ]


def _cure(scene, limit):
    """Advice where a limit of what can be formed is exceeded."""
    if limit == "fibre_share":
        may_be = "`density`, `fibre_density` or `compaction` is wrong"
        return f"pressure or shear is too large, or the thickness, {may_be}"
    if limit != "shortening":
        return "it cannot be formed there; other yarn angles, a larger radius or a cut may help"
    if scene_output.locking(scene):
        return "cells lock, which also shortens yarns; first use another mesh"
    fabrics = materials_of(scene, scene.blank.whole)
    doubt = any("d" in each.assumed_values() for each in fabrics)
    rests = ", and it depends on d, which no test has determined" if doubt else ""
    return f"more blank holder force may help{rests}"


def beyond_limits_at_end(
    scene: Scene, limits: Limits, rows: Sequence[Numbers], energy: Mapping[str, float]
) -> list[str]:
    """Sentences on what is wrong with the run as a whole; energy: as in summary.json [N mm]."""
    shares = {
        "imbalance": energy_balance(rows, energy)["energy_imbalance"],
        "viscous": share(energy["viscous"], stretching(energy)),
        "located": scene.supports.located_share(scene_output.outer_forces(scene)),
    }
    in_space = _in_space(scene)
    if in_space and limits.cell_size < math.inf:
        shares["cell_size"] = in_space.cells_over_radius(scene)
    passed = in_space.passed_through(scene) if in_space else []
    return [*passed, *limits.exceeded(shares)]


def warnings_at_start(scene: Scene, formed: bool = False) -> list[str]:
    """Warnings of a scene that need no result, before it is loaded or when it is `formed`."""
    in_space = _in_space(scene)
    of_tools = in_space.tool_warnings(scene, formed) if in_space else []
    return [*filter(None, [scene.check_held(), *of_tools])]


def doubts(result: Result, energy: Mapping[str, float], quantities: Numbers) -> list[Reason]:
    """Doubts about a result though nothing failed: about tools and cells first, then about what is
    formed, the path and the material. energy: as of `beyond_limits_at_end`; quantities: of the
    summary."""
    scene, in_space = result.scene, _in_space(result.scene)
    untouched = in_space.untouched_warning(scene) if in_space else ""
    is_still = not (untouched or any(energy.values()) or scene.u.norm())
    found = [
        *warnings_at_start(scene, formed=True),
        *fabric_doubts(result),
        *(Reason(each, of="wrinkles") for each in _of_waves(quantities)),
        untouched,
        in_space.plies_crossed(scene) if in_space else "",
        _mismatch(scene),
        STILL if is_still else "",
        *_of_path(result.rows, energy),
        *scene_output.warnings(scene),
    ]
    return [each if isinstance(each, Reason) else Reason(each) for each in found if each]


def error_doubts(result: Result, force_name: str) -> list[Reason]:
    """Doubts about force and shear angle whose estimated errors are large; of unknown ones, which
    are above half of the number, all of it is taken."""
    force, errors = abs(result.summary["reaction_N"]), result.summary["error"]
    sizes = {n: abs(result.number(n) or 0.0) if e is None else e for n, e in errors.items()}
    rows = (  # number, its largest error, how that is named, what is doubted
        ("reaction_N", 0.1 * force, f"10 %: {force_name} {{}} N", "_N"),
        (ANGLE, 3.0, "3 deg: 99th percentile of the shear angle {} deg", "shear_angle"),
    )
    words = "an estimated error may be above {}; use smaller cells"
    return [
        Reason(words.format(text.format(result.formatted(name, ".5g"))), of)
        for name, most, text, of in rows
        if sizes.get(name, 0.0) > most
    ]


def _of_path(rows, energy):
    balance = energy_balance(rows, energy)
    if branches := ", ".join(rounded(load, 6) for load in balance["branches"]):
        yield (
            f"the path branches at load {branches}: the equilibrium there is a saddle, and "
            "one of several branches was followed; others may lead to other results"
        )
    if balance["energy_imbalance"] > UNBALANCED:
        below = [kind for kind in energy if kind != "external_work" and energy[kind] < 0]
        negative = " and ".join(f"{kind} {rounded(energy[kind])} N mm" for kind in below)
        cause = "use smaller steps (`max_step`), unless the sheet snapped"
        if below:
            cause = f"negative energies drive the sheet instead of resisting it: {negative}"
        yield (
            "work of supports and tools and stored energy differ by "
            f"{percent(balance['energy_imbalance'], 3)}; {cause}"
        )


def _wrinkles(quantities):
    plies = quantities.get("plies", {"": quantities}).values()
    return [ply["wrinkles"] for ply in plies if ply.get("wrinkles")]


def coarsest_waves(quantities: Numbers) -> dict[str, float]:
    """Wrinkles of the ply with the fewest cells a wave; {} if none has few."""
    coarse = [w for w in _wrinkles(quantities) if (w["cells_a_wave"] or MIN_CELLS) < MIN_CELLS]
    return min(coarse, key=lambda each: each["cells_a_wave"], default={})


def _of_waves(quantities):
    """Sentences on wrinkles with few cells, and on waves that are no wrinkles."""
    if least := coarsest_waves(quantities):
        yield (
            f"heights of wrinkles, up to {rounded(least['height_mm'])} mm, are inaccurate: a wave "
            f"of {rounded(least['wavelength_mm'])} mm has {rounded(least['cells_a_wave'])} cells; "
            f"use {AIM:g}: `nx` {rounded(AIM / least['cells_a_wave'])} times as large"
        )
    most = max(_wrinkles(quantities), key=lambda each: each["ripples_mm"], default=None)
    if most and most["ripples_mm"] >= MIN_HEIGHT:
        yield (
            f"ripples up to {rounded(most['ripples_mm'])} mm high are mesh artefacts, not wrinkles:"
            f" cells or fabric form no waves shorter than {rounded(most['seen_mm'][0])} mm"
        )


def _mismatch(scene):
    """A sentence if stresses of the elements are not those of the kernel."""
    membranes = [term for term in scene.terms if isinstance(term, Membrane)]
    most = max((each.summary()["kernel_mismatch"].value for each in membranes), default=0.0)
    if most <= 1e-6:  # usual is 1e-12
        return ""
    return (
        f"stresses of elements and of the kernel differ by {percent(most, 3)}: `derivatives` of "
        "the law are not those of its `energy` (`check_derivatives` compares them), or a formula "
        "was changed in one of `membrane_energy.py` and `strains.py`"
    )
