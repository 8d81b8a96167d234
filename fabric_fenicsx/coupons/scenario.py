"""What all scenarios share: a rectangular sheet, or an own mesh, of one fabric."""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

from mpi4py import MPI

from .. import dolfinx_compat as compat
from ..job.job import Job, Result
from ..material.laws import Law
from ..material.presets import checked_fabric, load
from ..mechanics.shell import mesh_warnings
from ..mechanics.shell.membrane import INTEGRATION, Membrane
from ..mechanics.term import Term
from ..meshes.specimen import PATTERNS
from ..results.curve import Curves
from ..runtime import timing
from ..runtime.errors import InputError
from ..runtime.fields import check_fields, choice, declared, number, text
from ..runtime.rules import BELOW_180, COUNT, FINITE, POSITIVE, unknown_key
from ..scene.scene import Scene
from ..scene.supports import Supports
from ..sheets.blank import Blank
from ..sheets.layout import OF_OUTLINES, Layout, blank_options
from ..solve.limits import Limits
from ..solve.settings import Settings

ELEMENTS = "P1", "P2", "P3", "Q1", "Q2"
FITS = 1e-3  # of a length, by which an own mesh may differ from what is asked for


@dataclass(kw_only=True)
class Scenario:
    """A sheet of `fabric` in some test; a subclass says which.

    Lengths in mm, angles in deg. After construction `blank`, `membrane` and `scene` are there, and
    fields that were None have their values. Raises InputError for a field that is not allowed.
    """

    NAME: ClassVar[str] = ""
    # of mesh and solver; with P2 and path_tolerance 1e-4 the cheapest with curves right to 0.1 %
    FULL: ClassVar[Mapping[str, Any]] = {"nx": 32, "steps": 20}
    QUICK: ClassVar[Mapping[str, Any]] = {"nx": 20, "steps": 5}
    SOLVER: ClassVar[Mapping[str, Any]] = {}  # what its `Job` has by default
    LIMITS: ClassVar[Limits] = Limits()
    SIZES: ClassVar[tuple[str, str]] = ("length", "width")  # fields of the sheet's sides
    DEFAULT_SIZES: ClassVar[tuple[float, float]] = (200.0, 50.0)  # without a mesh of its own
    SPATIAL: ClassVar[bool] = False
    CHEAP_FROM: ClassVar[int] = 0  # cells from which errors are estimated unasked, 0: never
    HEADLINES: ClassVar[tuple[str, ...]] = ()  # quantities that get an estimated error

    fabric: Law = field(kw_only=False, default_factory=lambda: load("komeili"))
    mesh: str | None = text(
        None,
        "sheet from a file, as of gmsh or Abaqus [mm], instead of a rectangle that is meshed",
        "FILE",
        "mesh",
    )
    outline: str | None = text(
        None,
        "outline of the sheet with its holes, from a file: DXF, CSV of x and y [mm], or a mesh",
        "FILE",
        "mesh",
    )
    size: float = number(
        None, POSITIVE, "of the cells in an outline (its length over `nx`) [mm]", "mesh"
    )
    layer: str | None = text(
        None, "layer of a DXF outline, or several with commas between them (all)", "NAME", "mesh"
    )
    nx: int = number(None, COUNT, "rectangles along the length", "mesh")
    ny: int = number(
        None, COUNT, "rectangles across the width (by default they are square)", "mesh"
    )
    pattern: str = choice("crossed", PATTERNS, "how rectangles are divided into cells", "mesh")
    element: str = choice(
        None,
        ELEMENTS,
        "triangles (P) or quadrilaterals (Q), and their degree (P2; in forming P1 where cells "
        "follow the yarns)",
        "mesh",
    )
    integration: str = choice(
        None,
        INTEGRATION,
        "points of P2: full, or inner: nearer to a cell's centre (of strips, where cells don't "
        "follow the yarns)",
        "mesh",
    )
    fibre_angle: float = number(0.0, FINITE, "from the length to yarns a [deg]", "mesh")
    yarn_angle: float = number(
        90.0, BELOW_180, "from yarns a to yarns b in the flat sheet [deg]", "weave"
    )
    weave_angle: float | None = number(
        None,
        BELOW_180,
        "from yarns a to yarns b where the weave is free of shear (the yarn angle) [deg]",
        "weave",
    )
    comm: MPI.Comm = field(default_factory=lambda: MPI.COMM_WORLD, repr=False)
    warnings: list[str] = field(init=False, default_factory=list, repr=False)

    def __new__(cls, *_: Any, **given: Any) -> Self:
        """As of any class; InputError, with the nearest name, for a field that there is none."""
        known = [each.name for each in dataclasses.fields(cls) if each.init]
        for name in given:
            if name not in known:
                raise unknown_key(name, known, f"field `{name}` of {cls.__name__}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        checked_fabric("`fabric`", self.fabric)
        self.warnings += check_fields(self)
        # fields of the mesh that an own one makes idle, if they were asked for
        idle = {"nx": None, "ny": None, "pattern": type(self).pattern}
        given = [k for k, usual in idle.items() if getattr(self, k) not in (None, usual)]
        self._idle = given if self.mesh else [k for k in given if k == "ny" and self.outline]
        self._check_outline()
        if self.outline and "pattern" not in given:
            self.pattern = "unstructured"
        self._has_usual_nx = not (self.nx or self.mesh or self.size)
        if self._has_usual_nx:
            self.nx = self.FULL["nx"]
        if not self.sheet_file:
            for name, size in zip(self.SIZES, self.DEFAULT_SIZES):
                setattr(self, name, getattr(self, name) or size)
        self.prepare()
        membranes = self.membranes()
        self.scene = Scene(self.blank, [*membranes, *self.terms()], self.supports())
        for membrane in membranes:
            self.integration = membrane.integration
        self.start()

    def _check_outline(self):
        """Raise InputError for fields of an outline that do not go together."""
        if self.outline:
            if self.mesh:
                raise InputError("`outline` is given beside `mesh`; allowed is one of them")
            if self.nx and self.size:
                raise InputError("`nx` is given beside `size`; allowed is one of them")
        elif idle := next((k for k in OF_OUTLINES if getattr(self, k, None)), ""):
            raise InputError(f"`{idle}` is given without `outline`; allowed is it with one")

    @property
    def sheet_file(self) -> str:
        """The field that names the file of the sheet, and the file; "" for a rectangle."""
        given = next((k for k in ("mesh", "outline") if getattr(self, k)), "")
        return given and f"`{given}` {getattr(self, given)}"

    # -- what a subclass says

    def prepare(self) -> None:
        """Make `blank` and `membrane`, and check what belongs together."""
        self.blank = self.sheet()
        self.membrane = self.fabric_membrane()

    def membranes(self) -> list[Membrane]:
        """The membrane of the sheet, or of each one of several."""
        return [self.membrane]

    def terms(self) -> Iterable[Term]:
        """The terms of the scene besides the membrane."""
        return []

    def supports(self) -> Supports:
        """The supports of the scene."""
        raise NotImplementedError

    def start(self) -> None:
        """Set a displacement from which equilibrium at load 0 is sought."""

    def problem(self) -> dict[str, Any]:
        """What defines the run besides the fields and the fabric, as what files that these name
        hold: a checkpoint must agree in it."""
        return {}

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """Displacement [mm] and force [N] for the history, at a load factor."""
        raise NotImplementedError

    def quantities(self, result: Result) -> dict[str, Any]:
        """The scenario's own numbers for the summary; their names end with their units."""
        return {}

    def tables(self, result: Result, folder: Path) -> None:
        """Write the scenario's own tables into `folder`; called on all ranks."""

    def pictures(self, result: Result, folder: Path) -> None:
        """Draw the scenario's own pictures into `folder`; called on rank 0."""

    def beside(self) -> Curves:
        """Curves of force over displacement to draw beside the run's."""
        return {}

    # -- what a caller asks for

    def order(self) -> float:
        """Observed order of forces and energies in the size of cells, see docs/accuracy.md."""
        return 1.0

    def can_be_coarser(self) -> bool:
        """Whether a mesh twice as coarse is known."""
        if self.outline:
            low, high = self.blank.extent()
            sides = (high - low)[:2]
            return 4 * (self.size or sides[0] / self.nx) <= min(sides) * (1 + 1e-9)
        return bool(self.nx and self.nx > 1)

    def has_cheap_error(self) -> bool:
        """Whether a study estimates errors unasked: the coarser run then costs a tenth to a third
        of the run."""
        cells = self.blank.mesh.topology.index_map(2).size_global
        return self.can_be_coarser() and 0 < self.CHEAP_FROM <= cells

    def coarser(self) -> Self:
        """The same on a mesh twice as coarse: with half the rectangles along each side."""
        return dataclasses.replace(self, **self.coarser_mesh())

    def coarser_mesh(self) -> dict[str, Any]:
        """The fields in which a mesh twice as coarse differs."""
        found = {"nx": halved(self.nx), "ny": halved(self.ny), "size": self.size and 2 * self.size}
        return found | (dict.fromkeys(self.SIZES) if self.outline else {})

    def job(self, **changes: Any) -> Job:
        """The `Job` of this scenario with its defaults, `changes` in its fields."""
        known = [each.name for each in declared(Settings)]
        usual: dict[str, Any] = {k: size for k, size in self.FULL.items() if k in known}
        usual |= {
            "name": self.NAME,
            "measure": self.measure,
            "force_name": self.force_name(),
            "modelled": self.modelled(),
            "quantities": self.quantities,
            "tables": self.tables,
            "pictures": self.pictures,
            "warnings": self.warnings,
            "beside": self.beside(),
            "coarser": self._coarser_job if self.can_be_coarser() else None,
            "order": self.order(),
            "headlines": self.HEADLINES,
            "limits": self.LIMITS,
        }
        return Job(self.scene, **usual | dict(self.SOLVER) | changes)

    def force_name(self) -> str:
        """What the force of `measure` is called."""
        return "reaction"

    def modelled(self) -> float:
        """Share of the sheet that symmetry leaves."""
        return 1.0

    def about(self) -> tuple[str, str]:
        """Title and description of the report, "" for those of the study."""
        return "", ""

    def _coarser_job(self):
        return self.coarser().job()

    # -- what subclasses use

    def sheet(self, turned: float = 0.0, share: float = 1.0, centred: bool = False) -> Blank:
        """Blank of the fields; turned: angle from x to the length [rad], share: of length and
        width that is modelled; centred: about the origin, which otherwise is a corner."""
        sides = [getattr(self, name) for name in self.SIZES]
        length, width = (share * (size or 0.0) for size in sides)
        source = self.sheet_file or "the specimen"
        layout: Layout = {
            "element": self.element,
            "fibre_angle": self.fibre_angle,
            "yarn_angle": self.yarn_angle,
            "turned": turned,
            "centred": centred,
        }
        with timing.phase("setup"):
            if self.mesh:
                options = blank_options(layout)
                blank = Blank.read(self.mesh, spatial=self.SPATIAL, comm=self.comm, **options)
            elif self.outline:
                blank = Blank.outline(
                    self.outline,
                    nx=self.nx or 1,
                    size=self.size,
                    pattern=self.pattern,
                    layer=self.layer,
                    spatial=self.SPATIAL,
                    comm=self.comm,
                    **layout,
                )
            else:
                blank = Blank.rectangle(
                    length,
                    width,
                    nx=self.nx,
                    ny=self.ny,
                    pattern=self.pattern,
                    spatial=self.SPATIAL,
                    comm=self.comm,
                    **layout,
                )
        if blank.mesh.geometry.dim == 3 and not self.SPATIAL:
            raise InputError(
                f"{source} is not plane in z; allowed in this study is a sheet in a plane z = const"
            )
        kind = "P" if compat.cell_name(blank.mesh) == "triangle" else "Q"
        if self.element and self.element[0] != kind:
            raise InputError(
                f"`element` {self.element} does not fit the cells of {source}; "
                "allowed is P on triangles, Q on quadrilaterals"
            )
        self.element = f"{kind}{blank.degree}"
        self.warnings += blank.warnings
        self.warnings += filter(
            None, [mesh_warnings.size_warning(blank, self.fabric.thickness, source)]
        )
        if self.sheet_file:
            self.warnings += mesh_warnings.cell_warnings(blank, source)
            self._take_sizes(blank, share)
        return blank

    def fabric_membrane(self) -> Membrane:
        """Membrane of the blank and the fabric."""
        weave = None if self.weave_angle is None else math.radians(self.weave_angle)
        integration = self.integration or "full"
        return Membrane(self.fabric, integration=integration, weave_angle=weave)

    def _take_sizes(self, blank, share):
        """Make the own mesh's length and width the scenario's."""
        low, high = blank.extent()
        # rounded, to be the same on any number of ranks
        own = [float(f"{size / share:.9g}") for size in high - low]
        where = self.sheet_file
        if self.SIZES[0] == self.SIZES[1] and abs(own[0] - own[1]) > FITS * own[0]:
            raise InputError(
                f"{where} is {own[0]:g} x {own[1]:g} mm; allowed in this study is a square"
            )
        for name, size in zip(self.SIZES, own):
            asked = getattr(self, name)
            if asked is not None and abs(asked - size) > FITS * size:
                raise InputError(
                    f"`{name}` {asked:g} does not fit {where}, of {size:g} mm; allowed "
                    "is its own, or none"
                )
            setattr(self, name, size)
        if self._idle:
            names = ", ".join(f"`{name}`" for name in self._idle)
            why = "has its own cells" if self.mesh else "has cells of one size"
            self.warnings.append(f"{names} changes nothing, as {where} {why}")
        for name in ("nx", "ny", "pattern") if self.mesh else ("ny",):
            setattr(self, name, None)


def halved(count: int | None) -> Any:
    """Half of a number of rectangles, at least 1; None of None."""
    return count and max(1, round(count / 2))
