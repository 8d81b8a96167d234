"""The studies of a press with a punch and its die: their options, and the press of these."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar

from mpi4py import MPI

from ..forming.build import FormingScene
from ..forming.holders import GROUP, HOLDERS, Holder, PressureHolder
from ..forming.interface import Interface
from ..forming.press import EXAMPLES, Press
from ..forming.schema import read_document
from ..forming.sheet import Sheet
from ..material.files import read_toml
from ..material.laws import Law
from ..material.metal import load_metal
from ..runtime.errors import InputError
from ..runtime.fields import check_fields, number, one_of, repeated, switch, text
from ..runtime.files import check_file
from ..runtime.rules import POSITIVE, SHARE
from ..tools.double_dome import DoubleDome
from .options import Parser
from .study import Study, options_of, parser

DIMENSIONS = tuple(each.name for each in fields(DoubleDome))
FILES = "mesh", "outline"  # fields of a sheet
AREA = 13568 / 20268  # of metal over that of fabric, from the paper's numbers of elements
ROUNDED = 0.01  # share of the thickness by which a stroke may differ from the punch's height
# entry of a press -> the option for it
OPTIONS = {
    # the study's own press file, and of a stack file what it does not say
    rf"^{re.escape(str(EXAMPLES))}\S*\.toml: ": "",
    r"^\S*\.toml: (?=(?:blank|contact|tools|holders|stage)\b)": "",
    r"tools\.die\.clearance": "`clearance`",
    r"tools\.punch: (?=\w+ \+|\w+ is )": "`dome` NAME=VALUE: ",
    r"tools\.punch(?=[,: ]|\.file)(\.file)?": "`punch`",
    r"holders\.blank holder\.(pressure|force|gap)": r"`holder_\1`",
    r"holders\.blank holder\.tension": "`gripper_tension`",
    r"(?:blank|contact)\.(\w+)": r"`\1`",
    r"take the whole (?:ply|blank)(?: \(`quarter = false`\))?$": "take the whole ply (`full`)",
    r" \(`quarter = true`\)$": " (without `full`)",
    r"(allowed is|or) the whole blank(?=, or a quarter|$)": r"\1 `full`",
    r"(`(?:punch|mesh|outline)` is .*, no file); .*": r"\1; allowed is a file that exists",
}


@dataclass(frozen=True, kw_only=True)
class DomeTest:
    """The options of the double dome besides those of sheet and interface."""

    NAME: ClassVar[str] = "double_dome"
    PRESS: ClassVar[str] = "double_dome"  # of studies/presses
    HEADLINES: ClassVar[tuple[str, ...]] = (
        *("punch_force_N", "shear_angle_max_deg", "shear_angle_99_percent_deg"),
        "draw_in.largest_mm",
    )
    FULL: ClassVar[Mapping[str, Any]] = {"nx": 47, "steps": 20, "balance": 0.02}
    # few steps must not become many
    QUICK: ClassVar[Mapping[str, Any]] = {"nx": 12, "steps": 12, "balance": None}
    SOLVER: ClassVar[Mapping[str, Any]] = {"path_tolerance": 1e-5, "every": 5}
    CHEAP_FROM: ClassVar[int] = 0

    full: bool = switch("model the whole ply, not a quarter", "sheet")
    stack: str | None = text(
        None,
        "TOML file of several plies, from the punch to the die; examples: studies/stacks",
        "FILE",
        "sheet",
    )
    stroke: float | None = number(
        None, POSITIVE, "travel of the punch (by default its height) [mm]", "tools"
    )
    dome: Sequence[str] = repeated(
        f"dimension of the double dome: {', '.join(DIMENSIONS)}", "NAME=VALUE", "tools"
    )
    punch: str | None = text(
        None, "punch from a file (STL, VTP, MSH, STEP, IGES) [mm]", "FILE", "tools"
    )
    chord: float = number(
        0.1, POSITIVE, "largest distance of triangles from faces of STEP and IGES [mm]", "tools"
    )
    clearance: float | None = number(
        None, POSITIVE, "of punch and die when closed (by default 1.2 thicknesses) [mm]", "tools"
    )
    holder: Holder = one_of(PressureHolder(), HOLDERS, "what holds the rim of the ply", GROUP)

    def __post_init__(self) -> None:
        check_fields(self)
        if self.dome and self.punch:
            raise InputError("`dome` is not allowed beside `punch`")

    def press(self, fabric: Law, sheet: Mapping[str, Any], interface: Interface) -> Press:
        """The press of the options; sheet: fields of `Sheet` that are given. Raises InputError that
        names options."""
        file = EXAMPLES / f"{self.PRESS}.toml"
        document = self.document(read_document(file), fabric, sheet, interface)
        return self.read(document, Path(self.stack or file))

    def read(self, document: dict[str, Any], file: Path) -> Press:
        """The press of the tables of a file; it closes to the clearance of the options."""
        try:
            press = Press.from_document(document, file)
        except InputError as error:
            raise InputError(in_options(str(error))) from None
        if not (self.clearance and press.stages[0].close):
            return press
        close = self.clearance / press.thickness()
        return press.replace(stages=[replace(press.stages[0], close=close)])

    def document(
        self, document: dict[str, Any], fabric: Law, sheet: Mapping[str, Any], interface: Interface
    ) -> dict[str, Any]:
        """The tables of the press file, with the values of the options."""
        blank = document["blank"]
        folder = Path(self.stack or EXAMPLES / "none").parent
        if sheet.get("mesh") or sheet.get("outline"):
            blank = {}
        sheet = {k: _from_here(v, folder) if k in FILES else v for k, v in sheet.items()}
        blank = blank | sheet | {"fabric": fabric, "quarter": not self.full}
        if self.full and blank.get("nx") == self.FULL["nx"] and not blank.get("mesh"):
            blank["nx"] += blank["nx"] % 2  # a node at the centre
        document["blank"] = blank
        document["contact"] = {f.name: getattr(interface, f.name) for f in fields(interface)}
        document["holders"] = {"blank holder": self.holder}
        if self.stack:
            document["ply"] = read_plies(self.stack)
        punch = document["tools"]["punch"]
        if self.punch:
            file = _from_here(self.punch, folder)
            document["tools"]["punch"] = {"file": file, "chord": self.chord}
            document["title"] = f"Forming over {Path(self.punch).name}"
        else:
            punch |= dimensions(self.dome, punch)
        if self.clearance:
            document["tools"]["die"]["clearance"] = self.clearance
        self._set_stroke(document["stage"][0], punch)
        return document

    def _set_stroke(self, stage, punch):
        depth = None if self.punch else punch.get("depth", DoubleDome().depth)
        if not self.stroke or self.stroke == depth:
            return
        if depth and self.stroke > depth:
            raise self._too_far(depth)
        del stage["close"]
        stage["moves"] = {"punch": self.stroke}

    def _too_far(self, depth):
        allowed = f"up to {depth:.6g} mm, the punch's height"
        return InputError(f"`stroke` is {self.stroke:g}; allowed is {allowed}")

    def build(
        self, fabric: Law, sheet: Mapping[str, Any], interface: Interface, comm: MPI.Comm
    ) -> FormingScene:
        """The scene of the `press`. How deep a punch from a file goes is known once it is placed;
        InputError for more."""
        if not (self.punch and self.stroke):
            return self.press(fabric, sheet, interface).build(comm)
        closed = replace(self, stroke=None).press(fabric, sheet, interface).build(comm)
        depth = closed.schedule.travel(1.0)
        if abs(self.stroke - depth) < ROUNDED * closed.thickness:
            return closed
        if self.stroke > depth:
            raise self._too_far(depth)
        return self.press(fabric, sheet, interface).build(comm)


@dataclass(frozen=True, kw_only=True)
class LaminateTest(DomeTest):
    """The options of the paper's laminate: those of the double dome, and those of its metal."""

    NAME: ClassVar[str] = "laminate"
    PRESS: ClassVar[str] = "laminate"
    FULL: ClassVar[Mapping[str, Any]] = {"nx": 24, "steps": 40, "balance": 0.02}
    QUICK: ClassVar[Mapping[str, Any]] = {"nx": 5, "steps": 2, "balance": None, "stroke": 2}

    metal: str = text(
        "dc04", "metal of the outer sheets: preset or material file", "FILE", "laminate"
    )
    metal_thickness: float | None = number(
        None, POSITIVE, "of each sheet of metal, in place of the material's [mm]", "laminate"
    )
    metal_area: float = number(
        AREA, SHARE, "area of a sheet of metal, as a share of a ply's", "laminate"
    )

    def document(
        self, document: dict[str, Any], fabric: Law, sheet: Mapping[str, Any], interface: Interface
    ) -> dict[str, Any]:
        """As in `DomeTest`."""
        if given := [name for name in FILES if sheet.get(name) and not self.stack]:
            flaw = f"`{given[0]}` is not allowed, as a laminate's plies are rectangles"
            raise InputError(f"{flaw}; allowed is `stack`, whose plies may each have {given[0]}")
        document = super().document(document, fabric, sheet, interface)
        share, blank = self.metal_area**0.5, document["blank"]
        metal = load_metal(self.metal)
        for ply in document["ply"] if not self.stack else ():
            if "metal" in ply:
                ply |= {"metal": metal, "length": share * blank["length"]}
                # cells as large as the plies'
                ply |= {"width": share * blank["width"], "nx": max(1, round(share * blank["nx"]))}
                ply |= {"thickness": self.metal_thickness} if self.metal_thickness else {}
        return document


def _from_here(path, folder):
    """The path of an option, whose place no file in the `folder` of a press or stack takes."""
    return os.path.abspath(path) if (folder / path).is_file() else path


def read_plies(path: str) -> list[dict[str, Any]]:
    """The tables [[ply]] of a stack file. Raises InputError that names the file."""
    check_file(Path(path), "stack file", "a TOML file with a table [[ply]] for each ply")

    def plies(document):
        if document.get("unit") != "mm":
            raise InputError('unit is missing or another; allowed is a line `unit = "mm"`')
        if others := [key for key in document if key not in ("unit", "ply")]:
            raise InputError(f"entry {others[0]} is unknown; allowed are unit and ply")
        if not isinstance(document.get("ply"), list):
            raise InputError("ply is missing; allowed is a table [[ply]] for each")
        return document["ply"]

    return read_toml(path, plies)


def dimensions(pairs: Sequence[str], others: Mapping[str, Any]) -> dict[str, Any]:
    """Dimensions of a double dome {name: value} from texts NAME=VALUE, and `others` beside them.
    Raises InputError for a wrong name or value."""
    given = {name: value for name, value in others.items() if name in DIMENSIONS}
    for pair in pairs:
        name, _, value = pair.partition("=")
        try:
            given[name] = float(value)
        except ValueError:
            given[name] = value
    try:
        DoubleDome(**given)
    except InputError as error:
        raise InputError(f"`dome` NAME=VALUE: {error}") from None
    return given


def dome_parser(
    test: type[DomeTest], description: str | None, name: str = "", **defaults: Any
) -> Parser:
    """The parser of the study of a `test`: its options, and those of sheet and interface."""
    p = parser(test, description, name, parts=(Sheet, Interface), **defaults)
    blank = read_document(EXAMPLES / f"{test.PRESS}.toml")["blank"]
    for side, axis in (("length", "x"), ("width", "y")):
        words = f"of the whole sheet, along {axis} ({blank[side]}, or the mesh's) [mm]"
        p.change(f"--{side}", help=words)
    return p


def build(study: Study, test: type[DomeTest], fabric: Law | None = None) -> FormingScene:
    """The press of a study's options, built, with the fabric of the options or another one."""
    given, interface = options_of(test, study.args), Interface(**options_of(Interface, study.args))
    try:
        setup = test(**given).build(
            fabric or study.fabric, sheet_fields(study.args), interface, study.comm
        )
    except InputError as error:
        raise InputError(in_options(str(error))) from None
    setup.warnings[:] = map(in_options, setup.warnings)
    return study.take(setup)


def of_quarter(setup: FormingScene, quantities: Mapping[str, Any]) -> str:
    """What to say behind the punch force of a quarter, "" for a whole blank."""
    whole = setup.of_whole(quantities)
    return f" on the quarter{whole}" if whole else ""


def sheet_fields(args: Any) -> dict[str, Any]:
    """The fields of a `Sheet` that options give."""
    names = [each.name for each in fields(Sheet) if each.metadata.get("group") in ("mesh", "sheet")]
    found = {name: getattr(args, name, None) for name in (*names, "yarn_angle", "weave_angle")}
    return {name: v for name, v in found.items() if v is not None and v is not False}


def in_options(words: str) -> str:
    """A message about a press, with options in place of entries of its file."""
    for path, option in OPTIONS.items():
        words = re.sub(path, option, words)
    return words
