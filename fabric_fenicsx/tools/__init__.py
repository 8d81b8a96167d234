"""Rigid surfaces of tools: signed distance, normal and curvature at many points at once, and the
tools that carry them.

A surface bounds a body; its normal points out of it, and the gap (signed distance) is positive
outside. `Surface` and `ImplicitSurface` are the bases of own surfaces.
"""

from .checks import check_motion, check_own_punch, check_punch, check_start, check_triangles, height
from .double_dome import DoubleDome
from .primitives import Cylinder, Plane, Plate, Sphere, Torus
from .surfaces import Flipped, ImplicitSurface, Nearest, Offset, Reversed, Surface
from .tool import OfLoad, Tool
from .triangulated import TriangulatedSurface

__all__ = [
    "Cylinder",
    "DoubleDome",
    "Flipped",
    "ImplicitSurface",
    "Nearest",
    "OfLoad",
    "Offset",
    "Plane",
    "Plate",
    "Reversed",
    "Sphere",
    "Surface",
    "Tool",
    "Torus",
    "TriangulatedSurface",
    "check_motion",
    "check_own_punch",
    "check_punch",
    "check_start",
    "check_triangles",
    "height",
]
