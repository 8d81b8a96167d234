"""Quasi-static membrane finite elements for woven fabrics on FEniCSx (mm, N, MPa, rad).

`import fabric_fenicsx as ff` offers what `__all__` lists, as `__init__.pyi` has it; each name is
imported when it is first used.
"""

from contextlib import suppress
from importlib import import_module

import lazy_loader

from .core import package_versions
from .core.timing import phase
from .core.version import __version__

# pip's DOLFINx wants this before mpi4py, petsc4py and dolfinx; Debian's has no such package
with suppress(ModuleNotFoundError):
    import_module("dolfinx_solver")

package_versions.install()
_load, _, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    with phase("imports"):
        return _load(name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
