"""Coupon tests as data: what is tested, and how. `build` makes mesh and scene of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

from ..material.laws import Law
from ..material.presets import checked_fabric, load
from ..meshes.specimen import PATTERNS
from ..runtime.errors import InputError
from ..runtime.fields import choice, documented, number, text
from ..runtime.rules import FINITE, FROM_ZERO, POSITIVE, SHARE, Rule
from ..sheets.layout import FULL_TURN
from ..sheets.sheet_fields import ELEMENTS, SheetFields

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..job.job import Job
    from .bias_extension import BiasSetup
    from .picture_frame import FrameSetup
    from .setup import CouponSetup
    from .tensile import TensileSetup

INTEGRATION = "full", "inner"  # as of `Membrane`
BELOW_85 = Rule("an angle above 0 and below 85 deg", lambda v: 0 < v < 85)
UP_TO_10_PERCENT = Rule("a strain from 0 to 0.1", lambda v: 0 <= v <= 0.1)


@dataclass(frozen=True, kw_only=True)
class Coupon(SheetFields):
    """A test of a sheet of `fabric`, as data; a subclass says which test.

    A field that is None has a default that depends on others; `build().data` has them all.
    """

    NAME: ClassVar[str] = ""
    # of mesh and solver; with P2 and path_tolerance 1e-4 the cheapest with curves right to 0.1 %
    FULL: ClassVar[Mapping[str, Any]] = {"nx": 32, "steps": 20}
    QUICK: ClassVar[Mapping[str, Any]] = {"nx": 20, "steps": 5}
    SOLVER: ClassVar[Mapping[str, Any]] = {}  # other defaults of its `Job`
    SIDES: ClassVar[Mapping[str, float]] = {"length": 200.0, "width": 50.0}  # field: default [mm]
    CHEAP_FROM: ClassVar[int] = 0  # cells from which errors are estimated unasked, 0: never
    HEADLINES: ClassVar[tuple[str, ...]] = ()  # quantities that get an estimated error

    fabric: Law = field(kw_only=False, default_factory=lambda: load("komeili"))
    integration: str = choice(
        None,
        INTEGRATION,
        "points of P2: full, or inner: nearer to a cell's centre (of strips, where cells don't "
        "follow the yarns)",
        "mesh",
    )

    def __post_init__(self) -> None:
        checked_fabric("`fabric`", self.fabric)
        super().__post_init__()
        self.fabric.at(self.temperature)

    def build(self, comm: MPI.Comm | None = None) -> CouponSetup:
        """Mesh the sheet and make its scene, on the ranks of `comm` (all)."""
        raise NotImplementedError

    def job(self, **changes: Any) -> Job:
        """The job of the built test; changes: fields of `Job`."""
        return self.build().job(**changes)


@dataclass(frozen=True, kw_only=True)
class Strip(Coupon):
    """A strip of `fabric`, gripped at its ends, of which one moves."""

    CHEAP_FROM: ClassVar[int] = 1000
    COMPARED: ClassVar[str] = ""  # measured tests that can be laid over the curve

    length: float = number(
        None, POSITIVE, "of the specimen, along the load (200, or the mesh's) [mm]"
    )
    width: float = number(None, POSITIVE, "of the specimen (50, or the mesh's) [mm]")
    strain: float = number(0.10, SHARE, "nominal strain at full load: 0.1 is 10 %")
    pattern: str = choice(
        None,
        PATTERNS,
        "how rectangles are divided into cells (crossed with yarns along the length; at +-45 deg "
        "graded up to 20 % strain, else crossed; yarns at other angles)",
        "mesh",
    )
    measured: str | None = text(
        None,
        "test to lay over the curve: a CSV file as `identify` reads it, or a folder of some",
        "FILE|DIR",
    )


@documented
@dataclass(frozen=True, kw_only=True)
class Tensile(Strip):
    """Uniaxial tension of a woven strip along its yarns.

    Parameters
    ----------
    fabric : Law
        The material, by default the preset `komeili`.

    Raises
    ------
    InputError
        For a value that is not allowed; by `build` for a mesh that does not fit.

    References
    ----------
    Figs 8 and 10 of Schäfer et al.

    Examples
    --------
    >>> test = ff.Tensile(length=100, strain=0.01, nx=4, element="P1")
    >>> result = test.job(steps=2).run()
    >>> round(result.summary["reaction_N"], 1)  # N
    647.6
    """

    NAME = "tensile"
    COMPARED = "a tension test along the load: uniaxial_a with `fibre_angle` 0, uniaxial_b with 90"
    HEADLINES = ("log_eps_22_middle", "width_at_middle_mm", "nominal_stress_MPa")

    strain: float = number(0.03, SHARE, "nominal strain at full load: 0.1 is 10 %")
    grips: str = choice(
        "clamped",
        ("clamped", "rollers"),
        "rollers let the ends narrow: the state is then homogeneous",
    )
    turned: float = number(0.0, FINITE, "angle of the whole test in the plane [deg]")

    def build(self, comm: MPI.Comm | None = None) -> TensileSetup:
        from .tensile import TensileSetup  # which imports this

        return TensileSetup(self, comm)


@documented
@dataclass(frozen=True, kw_only=True)
class BiasExtension(Strip):
    """Tension of a woven strip whose yarns lie at +-45 deg to the load.

    Parameters
    ----------
    fabric : Law
        The material, by default the preset `komeili`.

    Raises
    ------
    InputError
        For a value that is not allowed; by `build` for a strip that is too short.

    References
    ----------
    Fig. 9 of Schäfer et al.

    Examples
    --------
    >>> test = ff.BiasExtension(nx=4, element="P1", strain=0.05)
    >>> result = test.job(steps=4).run()
    >>> round(result.summary["quantities"]["theory_shear_angle_deg"], 2)
    7.92
    """

    NAME = "bias_extension"
    FULL = {"nx": 40, "steps": 20}
    HEADLINES = (
        "centre_shear_angle_deg",
        "half_zone_shear_angle_deg",
        "normalised_shear_force_N_per_mm",
    )
    COMPARED = "bias_extension, or shear without strain along the yarns"

    fibre_angle: float = number(45.0, FULL_TURN, "from the length to yarns a [deg]", "mesh")
    element: str = choice(
        None,
        ELEMENTS,
        "triangles (P) or quadrilaterals (Q), and their degree (P2; P1 with in-plane bending)",
        "mesh",
    )
    bending_modulus: float = number(100.0, FROM_ZERO, "bending modulus of the yarns [MPa]")
    in_plane_bending: float = number(
        0.0, FROM_ZERO, "stiffness of yarns against bending within the sheet, over that out of it"
    )

    def build(self, comm: MPI.Comm | None = None) -> BiasSetup:
        from .bias_extension import BiasSetup  # which imports this

        return BiasSetup(self, comm)


@documented
@dataclass(frozen=True, kw_only=True)
class PictureFrame(Coupon):
    """Shear of a woven square in a rigid hinged frame, its yarns along the arms.

    Parameters
    ----------
    fabric : Law
        The material, by default the preset `komeili`.

    Raises
    ------
    InputError
        For a value that is not allowed, and for yarns off the arms.

    Examples
    --------
    >>> test = ff.PictureFrame(nx=2, angle=30.0)
    >>> found = test.job(steps=10).run().summary["quantities"]
    >>> force, law = found["normalised_shear_force_N_per_mm"], found["closed_form_N_per_mm"]
    >>> bool(abs(force / law - 1) < 1e-6)  # the state is homogeneous
    True
    """

    NAME = "picture_frame"
    CHEAP_FROM = 1000
    HEADLINES = ("normalised_shear_force_N_per_mm",)
    FULL = {"nx": 20, "steps": 40}
    QUICK = {"nx": 20, "steps": 10}
    SIDES = {"side": 200.0}

    element: str = choice(
        "P1", ELEMENTS, "triangles (P) or quadrilaterals (Q), and their degree", "mesh"
    )
    side: float = number(None, POSITIVE, "side of the square (200, or the mesh's) [mm]")
    angle: float = number(45.0, BELOW_85, "shear angle at full load [deg]")
    pre_tension: float = number(
        0.0, UP_TO_10_PERCENT, "yarn strain applied first, in the first tenth of the load"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.fibre_angle % 90 or self.yarn_angle != 90:
            raise InputError(
                f"yarns are at {self.fibre_angle:g} deg to the frame and {self.yarn_angle:g} deg "
                "to each other; allowed is 0 and 90, along its arms"
            )

    def build(self, comm: MPI.Comm | None = None) -> FrameSetup:
        from .picture_frame import FrameSetup  # which imports this

        return FrameSetup(self, comm)
