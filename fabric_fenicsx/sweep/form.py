"""`fabric form` of a press file: its command, and what the press tells before a run."""

import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

from ..runtime.errors import InputError
from ..runtime.ranks import on_ranks
from .folder import ALWAYS, flat
from .varied import Range, Values, changes, label, spelled

FINER = 1.5  # times as many cells along each side, on the finer mesh


class Form:
    """`fabric form` of a press file with these options, on so many ranks."""

    def __init__(self, press: Path, options: Sequence[str] = (), ranks: int = 1) -> None:
        self.press, self.options, self.ranks = press, list(options), ranks
        self._laws_are_read = False
        self._built: dict[str, Any] = {}  # presses by the labels of their values

    def command(self, values: Values, folder: Path) -> list[str]:
        """The command of the run with these values into its folder, but for how it goes on."""
        settings = [word for each in changes(values) for word in ("--set", each)]
        ranks = on_ranks(self.ranks) if self.ranks > 1 else []
        start = [sys.executable, "-m", "fabric_fenicsx", "form", str(self.press)]
        return [*ranks, *start, *settings, "--out", str(folder), *self.options]

    def check(self, values: Sequence[Values]) -> None:
        """InputError for the first values that the press file cannot have."""
        for each in values:
            try:
                self._read(each)
            except InputError as error:
                raise InputError(f"run {label(each)}: {error}") from None

    def _read(self, values=MappingProxyType({})):
        """The press with these values."""
        from ..forming.press import Press  # takes seconds to import
        from ..forming.schema import OF_ALL_PLIES, short_forms
        from ..material.presets import read_laws

        words = [*(part for word in self.options for part in word.split("=", 1)), "--law-file", ""]
        law_file = words[words.index("--law-file") + 1]
        if law_file and not self._laws_are_read:
            read_laws(law_file)
            self._laws_are_read = True
        given = dict(zip(words, words[1:]))
        short = {name: given.get(f"--{name.replace('_', '-')}") for name in OF_ALL_PLIES}
        return Press.read(self.press, [*short_forms(short), *changes(values)])

    def _build(self, values):
        """The built press with these values."""
        if label(values) not in self._built:
            self._built[label(values)] = self._read(values).build()
        return self._built[label(values)]

    def scatter(self) -> list[Range]:
        """The intervals of the press's materials; one for all sheets of one fabric or metal."""
        found, press = [], self._read()
        for kind in ("fabric", "metal"):
            own = {f"{p}.{kind}": getattr(s, kind) for p, s in zip(press.paths(), press.sheets)}
            own = {path: material for path, material in own.items() if material}
            first = next(iter(own.values()), None)
            if first and all(each == first for each in own.values()):
                own = {kind: first}
            for path, material in own.items():
                found += [Range(f"{path}.{n}", *ends) for n, ends in material.scatter.items()]
        return found

    def quantities(self, values: Values) -> list[str]:
        """Names of the numbers that the run with these values will have: those of its blank as it
        lies, which is not run, with those that have no value there."""
        from ..results.fields import FieldSeries
        from ..results.history import COLUMN, ENERGIES
        from ..results.result import Result
        from ..scene.output import cell_fields

        made = self._build(values)
        fields = cell_fields(made.scene)
        row = defaultdict[str, Any](float, {f"{kind}{COLUMN}": 0.0 for kind in ENERGIES}, load=1.0)
        with TemporaryDirectory() as folder:
            FieldSeries(Path(folder), made.scene, ()).write(1.0, fields)
            result = Result({}, [row], fields, Path(folder), made.scene)
            return [*ALWAYS, "wall_s", *flat(made.quantities(result))]

    def finer(self, values: Values) -> dict[str, str]:
        """What makes the cells of the run with these values `FINER` times as fine: {key: value},
        nothing for own meshes and where `values` are of the cells."""
        if {key.split(".")[-1] for key in values} & {"nx", "ny", "size", "mesh"}:
            return {}
        press, cells = self._read(values), dict[str, str]()
        if any(sheet.mesh for sheet in press.sheets):
            return {}
        finer = self._build(values).finer(FINER).sheets
        for path, given, sheet in zip(press.paths(), press.sheets, finer):
            names = ("nx", "ny") if sheet.nx and given.ny else ("nx",) if sheet.nx else ("size",)
            cells |= {f"{path}.{name}": spelled(getattr(sheet, name)) for name in names}
        return cells
