"""`fabric form` of a press file: its command, and what the press tells before a run."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ..core.processes import on_ranks
from ..material.presets import read_laws
from ..press.press import Press
from ..press.schema import OF_ALL_PLIES, short_forms
from .varied import Range, Values, changes


class SweepRun:
    """`fabric form` of a press file with these options, on so many ranks."""

    def __init__(self, press: Path, options: Sequence[str] = (), ranks: int = 1) -> None:
        self.press, self.options, self.ranks = press, list(options), ranks
        known = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
        for name in ("law_file", *OF_ALL_PLIES):
            known.add_argument(f"--{name.replace('_', '-')}")
        given, _ = known.parse_known_args(self.options)
        self._short_forms = short_forms(vars(given))
        if given.law_file:
            read_laws(given.law_file)

    def command(self, values: Values, folder: Path) -> list[str]:
        """The command of the run with these values into its folder, but for how it goes on."""
        settings = [word for each in changes(values) for word in ("--set", each)]
        ranks = on_ranks(self.ranks) if self.ranks > 1 else []
        start = [sys.executable, "-m", "fabric_fenicsx", "form", str(self.press)]
        return [*ranks, *start, *settings, "--out", str(folder), *self.options]

    def read(self, values: Values) -> Press:
        """The press with these values; InputError if it cannot have them."""
        return Press.read(self.press, [*self._short_forms, *changes(values)])

    def scatter(self) -> list[Range]:
        """The intervals of the press's materials; one for all sheets of one fabric or metal."""
        found, press = [], self.read({})
        for kind in ("fabric", "metal"):
            own = {f"{p}.{kind}": getattr(s, kind) for p, s in zip(press.paths(), press.sheets)}
            materials = [material for material in own.values() if material]
            if materials and all(each == materials[0] for each in materials):
                own = {kind: materials[0]}
            for path, material in own.items():
                scatter = material.scatter if material else {}
                found += [Range(f"{path}.{n}", *ends) for n, ends in scatter.items()]
        return found
