"""Data sets on disk, for `read`."""

import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import tomli_w

from ...runtime.errors import InputError
from .model import STRAINS, TESTS, Curve, Sheet, unit_inside, units


def write(
    folder: Path | str, sheet: Sheet, curves: Iterable[Curve], remarks: Iterable[str] = ()
) -> None:
    """Write a data set that `read` reads back to 12 digits; remarks: comment lines for each CSV.
    Raises InputError."""
    folder = Path(folder)
    shown = {"eps_a": "%", "eps_b": "%", "gamma": "deg"}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        numbers = {"thickness_mm": sheet.thickness, "density_g_per_cm3": sheet.density}
        text = tomli_w.dumps({"name": sheet.name, **numbers, "balanced": sheet.balanced})
        (folder / "sheet.toml").write_text(text, encoding="utf-8")
        for curve in curves:
            test = TESTS[curve.test]
            strains = [
                c
                for c in (*test.strains, *test.optional)
                if c in test.strains or np.any(curve.strains[:, STRAINS.index(c)])
            ]
            columns = {c: curve.strains[:, STRAINS.index(c)] for c in strains} | {
                r.column: r.values for r in curve.responses
            }
            header = {c: shown.get(c, unit_inside(c)) for c in columns}
            head = [
                *remarks,
                f"test: {curve.test}",
                *(f"{k}: {v:g} mm" for k, v in curve.keys.items()),
            ]
            if "lateral" in test.keys:
                head.append(f"lateral: {'held' if curve.free is None else 'free'}")
            if curve.noise:
                kind, size = curve.noise
                head.append(
                    f"noise: {size:g} {curve.responses[0].unit}"
                    if kind == "absolute"
                    else f"noise: {100 * size:g} % of {kind}"
                )
            with open(folder / curve.file, "w", newline="", encoding="utf-8") as stream:
                stream.writelines(f"# {line}\n" for line in head)
                writer = csv.writer(stream, lineterminator="\n")
                writer.writerow(f"{c} [{unit}]" for c, unit in header.items())
                writer.writerows(
                    [f"{v / units(c)[header[c]]:.12g}" for c, v in zip(columns, row)]
                    for row in zip(*columns.values())
                )
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror}); allowed is a folder of this user"
        ) from None
