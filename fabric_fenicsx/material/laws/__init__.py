"""Constitutive laws, one file each.

A law is a subclass of `Law` in a file of this folder: there is no list to extend. A material file
names it as `law = "NAME"`; so it does with one that a user's own script defines.
"""

from importlib import import_module
from pkgutil import iter_modules

from .base import COUPLINGS, LAWS, Law, Range

for _module in iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
