"""Data sets on disk, for `read`."""

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import tomli_w

from ...runtime.files import unwritable
from .model import COMPACTION, STRAINS, TESTS, Curve, Sheet, noise_text, unit_inside, units

SHOWN = {"eps_a": "%", "eps_b": "%", "gamma": "deg"}  # units other than those used inside


def write(
    folder: Path | str, sheet: Sheet, curves: Iterable[Curve], remarks: Iterable[str] = ()
) -> None:
    """Write a data set that `read` reads back to 12 digits; remarks: comment lines for each CSV.
    Raises InputError."""
    folder, remarks = Path(folder), list(remarks)
    numbers = {"thickness_mm": sheet.thickness, "density_g_per_cm3": sheet.density}
    if sheet.fibre_density is not None:
        numbers["fibre_density_g_per_cm3"] = sheet.fibre_density
    text = tomli_w.dumps({"name": sheet.name, **numbers, "balanced": sheet.balanced})
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "sheet.toml").write_text(text, encoding="utf-8")
        for curve in curves:
            test, strains = TESTS[curve.test], dict(zip(STRAINS, curve.strains.T))
            kept = [*test.strains, *(c for c in test.optional if np.any(strains[c]))]
            columns = {c: strains[c] for c in STRAINS if c in kept}
            columns |= {r.column: r.values for r in curve.responses}
            keys = {"test": curve.test} | {k: f"{v:g} mm" for k, v in curve.keys.items()}
            if "lateral" in test.keys:
                keys["lateral"] = "held" if curve.free is None else "free"
            if curve.noise:
                keys["noise"] = noise_text(curve.noise, curve.responses[0].unit)
            _write_table(folder / curve.file, remarks, keys, columns)
        for pressed in sheet.compaction:
            response = pressed.response
            columns = {"pressure": pressed.pressure, response.column: response.values}
            keys = {"test": COMPACTION}
            if pressed.noise:
                keys["noise"] = noise_text(pressed.noise, response.unit)
            _write_table(folder / pressed.file, remarks, keys, columns)
    except OSError as error:
        raise unwritable(error) from None


def _write_table(path, remarks, keys, columns):
    """A CSV file of columns {name: (n,)} below comment lines."""
    header = {c: SHOWN.get(c, unit_inside(c)) for c in columns}
    numbers = [values / units(c)[header[c]] for c, values in columns.items()]
    with open(path, "w", newline="", encoding="utf-8") as stream:
        stream.writelines(f"# {line}\n" for line in remarks)
        stream.writelines(f"# {key}: {text}\n" for key, text in keys.items())
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(f"{c} [{unit}]" for c, unit in header.items())
        writer.writerows([f"{v:.12g}" for v in row] for row in zip(*numbers))
