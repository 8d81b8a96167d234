"""report.html: options, terms, results, errors and cost of a run in one file."""

import base64
import json
import re
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path

from ..core.formatting import rounded, with_error

# what a person looks at first, where a run has it
HEADLINES = {
    "reaction_N": "force [N]",
    "shear_angle_max_deg": "largest shear angle [deg]",
    "shear_angle_99_percent_deg": "shear angle, 99th percentile [deg]",
    "shortening_max": "largest shortening of yarns [-]",
    "draw_in.largest_mm": "largest draw-in [mm]",
    "wrinkles.height_mm": "largest height of wrinkles [mm]",
}
# picture -> what it shows, in the order of a report
CAPTIONS = {
    "formed": "The formed ply: magnitude of the shear angle, and yarns",
    "curve": "Force against displacement; the band is the estimated error",
    "maps": "Logarithmic strains, and shear angle (negative where the angle from a to b increases)",
    "axis": "Magnitude of the shear angle along the strip's axis",
    "compare": "Variants of the couplings: strains and shear angle",
    "compare_curves": "Variants of the couplings: reaction against displacement",
    "setup": "Tools and flat blank before the first step; arrows show the motions to scale",
    "states": "Strain states: which yarns are in tension, which in compression",
    "wrinkles": "Wrinkles: height of waves away from tools",
    "shortening": "Shortening of yarns by compression, where a real ply would wrinkle",
    "thickness": "Thickness of the plies under the pressure on them",
    "paths": "Strains and shear angle along paths from the centre",
    "error": "Estimated errors of strains and shear angle, from a coarser mesh",
}
# the beginning of a name -> its text, where that is not the name's own
WORDS = {
    "log_eps_11": "logarithmic strain along yarns a",
    "log_eps_22": "logarithmic strain along yarns b",
    "eps_a": "nominal strain along yarns a",
    "eps_b": "nominal strain along yarns b",
    "assumed": "parameters that no test has determined",
    "energy_imbalance": "difference of work and energies, relative to these",
    "kernel_mismatch": "difference of stresses of elements and of the kernel",
    "contact_forces_N": "contact forces on the modelled part N",
    "penetration_mm": "penetration of tools in the last state mm",
    "penetration_largest_mm": "penetration of tools, largest of the run mm",
    "penetration_of_thickness": "penetration of tools, largest of the run, over the thickness",
    "stability_ellipticity_min": "minimum ellipticity of the law (negative: it allows bands)",
    "cells_that_lost_ellipticity": "cells in which the law allows bands",
    "share_of_state_1_to_4": "area shares: both yarns in tension, only a, only b, none",
}


def page(
    title: str,
    runs: Mapping[str, tuple[Path, Iterable[Path]]],
    description: str,
    ending: str,
    log: Path | None = None,
) -> str:
    """HTML, with its pictures in it, of runs {name: (path of the summary, paths of pictures)}, as
    far as they are there. description: of the study; ending: "done", or the reason why it ended;
    log: path of a text."""
    shown = [_shown(name, *files) for name, files in runs.items()]
    return rendered(
        Path(__file__).with_name("report.html.jinja"),
        title=title.replace("_", " "),
        description=description,
        ending=ending,
        runs=[run for run in shown if run["summary"] or run["pictures"]],
        first=next((run["summary"] for run in shown if run["summary"]), {}),
        log=log.read_text() if log and log.is_file() else "",
    )


def rendered(template: Path, **values: object) -> str:
    """HTML of a template of `values`, and of the time `now`."""
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"number": _number, "words": label}
    environment.tests |= {
        "rows": _are_rows,
        "grid": lambda value: len(value) > 1 and _are_rows(list(value.values())),
    }
    now = f"{datetime.now():%Y-%m-%d %H:%M}"
    return environment.from_string(template.read_text()).render(now=now, **values)


def encoded(file: Path) -> str:
    """A picture as text, to stand in a page."""
    return base64.b64encode(file.read_bytes()).decode()


def label(name: str) -> str:
    """The name of a number as a reader would write it: "punch force [N]"."""
    longest = max((word for word in WORDS if name.startswith(word)), key=len, default="")
    text = WORDS.get(longest, "") + name.removeprefix(longest)
    text = text.replace("_98_percent", ", 1st and 99th percentile")
    text = text.replace("_99_percent", ", 99th percentile")
    if found := re.search(r"[_ ](N_per_mm\d?|Nmm|MPa|MiB|deg|mm|N)$", text):
        unit = re.sub(r"(\d)", r"^\1", found[1].replace("_per_", "/").replace("Nmm", "N mm"))
        return f"{text[: found.start()].replace('_', ' ')} [{unit}]"
    return text.replace("_", " ")


def _shown(name, summary, pictures):
    facts = json.loads(summary.read_text()) if summary.is_file() else {}
    order = [*CAPTIONS]
    files = sorted(pictures, key=lambda f: ([*order, f.stem].index(f.stem), f.stem))
    captions = {file: CAPTIONS.get(file.stem, file.stem.replace("_", " ")) for file in files}
    quantities = _with_errors(facts.get("quantities", {}), errors := facts.get("error") or {})
    sheets = {"": quantities} | quantities.get("plies", {})
    headlines = {text: [_headline(q, n) for q in sheets.values()] for n, text in HEADLINES.items()}
    # of a summary, what stands outside its list of numbers
    elsewhere = "verdict reasons reason warnings quantities reaction_N reaction_is command".split()
    elsewhere += ["options", "fabric", "versions"]
    renamed = {"energy": "energy_Nmm", "error": "estimated_absolute_errors", "wall_s": "seconds"}
    return {
        "name": name,
        "summary": facts,
        "force": _with_errors({"reaction_N": facts.get("reaction_N")}, errors)["reaction_N"],
        "sheets": list(sheets),
        "headlines": {text: values for text, values in headlines.items() if any(values)},
        "quantities": quantities,
        "facts": {renamed.get(k, k): v for k, v in facts.items() if k not in elsewhere},
        "pictures": [(file.stem, text, encoded(file)) for file, text in captions.items()],
    }


def _headline(quantities, name):
    """A number of a sheet with its place on the flat sheet, as text; "" if it has none."""
    *outer, name = name.split(".")
    for key in outer:
        quantities = quantities.get(key) or {}
    if quantities.get(name) is None:
        return ""
    place = quantities.get(re.sub("_(deg|mm)$", "", name) + "_at_mm", "")
    return _number(quantities[name]) + (f" at {place} mm" if place else "")


def _with_errors(values, errors, before=""):
    """The `values` with their errors, of nested ones by names with dots, and places as such."""
    shown = {}
    for name, value in values.items():
        if isinstance(value, dict):
            value = _with_errors(value, errors, f"{before}{name}.")
        elif before + name in errors:
            value = with_error(_number(value), value, errors[before + name])
        elif name.endswith("_at_mm"):
            value = f"({', '.join(map(_number, value))})"
        shown[name] = value
    return shown


def _are_rows(values):
    """True of a list of flat dicts that share their first's keys."""
    if not (isinstance(values, list) and values and all(isinstance(row, dict) for row in values)):
        return False
    is_flat = not any(isinstance(each, dict) for row in values for each in row.values())
    return is_flat and all(row.keys() >= values[0].keys() for row in values)


def _number(value):
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "-"}[value]
    if isinstance(value, float):
        return rounded(value, 5)
    if isinstance(value, list):
        is_range = [type(each) for each in value] == [float, float]
        return (" to " if is_range else ", ").join(map(_number, value)) or "-"
    return str(value)
