"""A quick `pkg_resources`, which Debian 12's UFL and FFCx import for their own versions alone."""

import sys
from importlib import import_module, metadata
from importlib.util import find_spec
from types import ModuleType, SimpleNamespace

NAME = "pkg_resources"


class QuickVersions(ModuleType):
    """Knows versions; whatever else is asked of it puts setuptools' own in its place."""

    @staticmethod
    def get_distribution(name: str) -> SimpleNamespace:
        """The version of an installed distribution. Raises PackageNotFoundError."""
        return SimpleNamespace(version=metadata.version(name))

    def __getattr__(self, name: str) -> object:
        if sys.modules.get(NAME) is self:
            del sys.modules[NAME]
        return getattr(import_module(NAME), name)


def install() -> None:
    """Use it instead of setuptools' own, if that is not imported yet."""
    if NAME not in sys.modules and find_spec(NAME):
        sys.modules[NAME] = QuickVersions(NAME)
