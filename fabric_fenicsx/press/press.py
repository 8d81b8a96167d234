"""A press: the blank, its tools and holders, and the stages in which it is formed."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from mpi4py import MPI

from ..job.job import Job
from . import schema
from .build import build
from .forming_scene import FormingScene
from .press_data import PressData

EXAMPLES = Path(__file__).parents[1] / "studies" / "presses"


class Press(PressData):
    """A blank, one sheet or several, formed by rigid tools in stages.

    The flat blank lies in z = 0; tools and sheets may lie anywhere along x and y.

    Parameters
    ----------
    sheets
        The lowest first; a single sheet needs no list.
    symmetry
        "x": x = 0 is a plane of symmetry, and x >= 0 is modelled; "y" likewise, "xy" for both: a
        quarter. "none" for the whole blank. {"y": -400.0} for a plane elsewhere [mm].
    interface
        Contact between sheets and tools.
    tools
        {name: `PressTool`}.
    holders
        {name: holder}, as `PressureHolder(0.1)`, or a list of holders as segments. A holder presses
        the blank on the tool that its `against` names, by default on the tool that does not move
        and has a flat face on the blank.
    stages
        One after the other.
    limits
        Beyond which a result is invalid.
    stop_when_invalid
        True: end the run at the step where the ply cannot be formed, see `Settings`.
    title
        Of the report.
    gravity
        Acceleration [m/s^2], down or as a vector (3,), of sheets with the mass of their materials.

    Raises
    ------
    InputError
        For parts that do not fit together; when built, for tools that can't stand or move as given.

    Examples
    --------
    >>> press = ff.Press.read("hemisphere", ["blank.nx=4"])
    >>> press.sheets[0].nx, press.tools["punch"].surface.radius
    (4, 50.0)
    >>> press == press.replace(symmetry="xy")
    True
    """

    NAME = "form"
    HEADLINES = (
        *("shear_angle_max_deg", "shear_angle_99_percent_deg"),
        *("draw_in.largest_mm", "shortening_mean"),
    )
    FULL, QUICK = {"balance": 0.02}, {"balance": None}
    SOLVER = {"path_tolerance": 1e-5, "every": 5}
    CHEAP_FROM = 1  # cells: errors are always estimated

    @classmethod
    def read(cls, path: str | os.PathLike[str], changes: Sequence[str] = ()) -> Self:
        """The press in a TOML file, or the example of that name in studies/presses.

        changes: of its entries, as "tools.punch.radius=40", or of all plies, as "nx=8". Raises
        InputError that names file, table and key.
        """
        example = EXAMPLES / f"{path}.toml"
        file = example if not os.path.isfile(path) and example.is_file() else Path(path)
        return schema.read(cls, file, changes)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a file that `read` reads; materials that are no presets go into files beside it.
        Raises InputError for what a file cannot hold, as functions and surfaces of your own."""
        schema.write(self, path)

    def build(self, comm: MPI.Comm | None = None) -> FormingScene:
        """The scene of the press. Raises InputError for tools that can't stand or move as given."""
        return build(self, comm)

    def job(self, **changes: Any) -> Job:
        """The `Job` of the built press, with `changes` in its fields."""
        return self.build().job(**changes)
