"""Rooms of the package under their earlier names, so that older programs still import them."""

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

# the longest first
MOVED = {
    "mechanics.contact": "contact",
    "mechanics.shell": "energy",
    "mechanics": "energy",
    "runtime": "core",
    "readers": "io",
    "tools": "surfaces",
    "sheets": "sheet",
    "meshes": "sheet",
    "postprocess": "results",
    "plot": "results",
    "forming": "press",
    "command_line": "cli",
}


class EarlierNames(MetaPathFinder, Loader):
    """Finds `package`.runtime.rules, say, as `package`.core.rules, and warns of it."""

    def __init__(self, package: str) -> None:
        self.package = package + "."

    def _now(self, name: str) -> str | None:
        """The name now of a module with an earlier name."""
        inside = name.removeprefix(self.package)
        for room, now in MOVED.items() if inside != name else ():
            if inside == room or inside.startswith(room + "."):
                return self.package + now + inside[len(room) :]
        return None

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """See `MetaPathFinder`."""
        return ModuleSpec(fullname, self) if self._now(fullname) else None

    def exec_module(self, module: ModuleType) -> None:
        """Put the module of the name now in the place of this one."""
        name = module.__name__
        sys.modules[name] = import_module(self._now(name) or "")
        warnings.warn(f"{name} is {self._now(name)} now", DeprecationWarning, stacklevel=2)
