"""Quasi-static membrane finite elements for woven fabrics on FEniCSx (mm, N, MPa, rad).

`import fabric_fenicsx as ff` offers what `__all__` lists; each name is imported when it is first
used.
"""

import ast
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .runtime.timing import phase
from .runtime.version import __version__

# pip's DOLFINx wants this before mpi4py, petsc4py and dolfinx; Debian's has no such package
with suppress(ModuleNotFoundError):
    import_module("dolfinx_solver")

if TYPE_CHECKING:
    from .coupons.bias_extension import BiasExtension
    from .coupons.picture_frame import PictureFrame
    from .coupons.tensile import Tensile
    from .forming.holders import (
        ForceHolder,
        GapHolder,
        Grippers,
        Holder,
        PressureHolder,
        SpringHolder,
    )
    from .forming.interface import Interface
    from .forming.press import Press
    from .forming.site import HolderSite
    from .forming.stages import Stage
    from .forming.tools import DieOf, PressTool
    from .forming.unloading import unloading
    from .job.job import Job, Result
    from .job.setup import Setup
    from .material.bending import MeasuredBending
    from .material.compaction import Compaction
    from .material.friction import BendingFriction, ShearFriction
    from .material.hardening import HardeningTable, Swift, Voce
    from .material.laws.base import Law
    from .material.laws.coupled import WovenFabric, Yarn
    from .material.laws.tabulated import TabulatedFabric
    from .material.metal import Metal, load_metal
    from .material.presets import load
    from .mechanics.contact.coulomb import Coulomb
    from .mechanics.contact.holder_pressure import BlankHolderPressure
    from .mechanics.contact.self_contact import SelfContact
    from .mechanics.contact.sheet_contact import SheetContact
    from .mechanics.contact.tool_contact import Contact
    from .mechanics.load import DeadPressure, EdgeTension
    from .mechanics.output import Value, largest, least, total
    from .mechanics.shell.bending import Bending
    from .mechanics.shell.membrane import Membrane
    from .mechanics.shell.metal import SheetMetal
    from .mechanics.springs import Springs
    from .mechanics.term import Term
    from .readers.field import Field
    from .runtime.errors import InputError, Interrupted, SolverFailure
    from .scene.scene import Scene
    from .scene.supports import Support, clamped_ends, frame, rolling_ends
    from .sheets.blank import Blank
    from .sheets.sheet import Sheet
    from .sheets.stack import Stack
    from .solve.limits import Limits
    from .tools.double_dome import DoubleDome
    from .tools.implicit import ImplicitSurface
    from .tools.primitives import Block, Cylinder, Plane, Plate, Sphere, Torus
    from .tools.surfaces import Flipped, Nearest, Offset, Reversed, Surface, Turned
    from .tools.tool import Tool
    from .tools.triangulated import TriangulatedSurface
    from .verification.derivatives import check_derivatives

# where each name lives, as listed above
_BLOCKS = [each for each in ast.parse(Path(__file__).read_text()).body if isinstance(each, ast.If)]
_LISTED = [each for each in _BLOCKS[0].body if isinstance(each, ast.ImportFrom)]
_HOME_OF = {alias.name: f".{each.module}" for each in _LISTED for alias in each.names}
__all__ = sorted(_HOME_OF)


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    with phase("imports"):
        return getattr(import_module(_HOME_OF[name], __name__), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
