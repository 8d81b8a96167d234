"""The changes of the net: each describes a press or a coupon in another way."""

import dataclasses
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import ezdxf
import numpy as np
import tomli_w
from maps import MIRROR, Map, about_z, moved_press, moved_sheet
from scenes import PRESSES

import fabric_fenicsx as ff

HEIGHTS = "wrinkles.height_mm", "wrinkles.height_rms_mm"


@dataclass(frozen=True)
class Change:
    """edit: function of a press and a folder to the press in other words, or `map`, where it goes.
    within: relative difference that is allowed; besides: numbers that it may change, and `why`;
    same: the press is the same data."""

    edit: Callable | None = None
    map: Map | None = None
    within: float = 1e-9
    besides: tuple[str, ...] = ()
    why: str = ""
    same: bool = False


def weft_for_warp(press, folder):
    """Yarns b are called a."""
    return press.replace(sheets=[s if s.metal else weft_for_warp_of(s) for s in press.sheets])


def weft_for_warp_of(sheet):
    law, weave = sheet.fabric, sheet.weave_angle
    angle = Map().field(sheet.fibre_angle, lambda a: (a + sheet.yarn_angle + 180) % 360 - 180)
    between = {"yarn_angle": 180 - sheet.yarn_angle}
    between["weave_angle"] = None if weave is None else 180 - weave
    swapped = law.replace(warp=law.weft, weft=law.warp)
    return dataclasses.replace(sheet, fabric=swapped, fibre_angle=angle, **between)


def renamed(press, folder):
    """Tools, holders, plies and stages have names with blanks, commas and umlauts."""

    def name(old):
        return f"Größe {old}, 2: A.1" if old else old

    def names(table):
        return {name(old): value for old, value in table.items()}

    def stage(each):
        tables = {n: names(getattr(each, n)) for n in ("moves", "forces", "pressures")}
        return dataclasses.replace(each, name=name(each.name), **tables)

    def tool(each):
        if isinstance(each.surface, ff.DieOf):
            surface = dataclasses.replace(each.surface, tool=name(each.surface.tool))
            return dataclasses.replace(each, surface=surface)
        return each

    def holder(each):
        if isinstance(each, list):
            return [holder(one) for one in each]
        against = getattr(each, "against", "")
        return dataclasses.replace(each, against=name(against)) if against else each

    return press.replace(
        sheets=[dataclasses.replace(each, name=name(each.name)) for each in press.sheets],
        tools={name(n): tool(each) for n, each in press.tools.items()},
        holders={name(n): holder(each) for n, each in press.holders.items()},
        stages=[stage(each) for each in press.stages],
        title="Ein Titel, mit Komma",
    )


def reordered(press, folder):
    """Tools, holders and moves stand in another order."""
    back = lambda table: dict(reversed(table.items()))  # noqa: E731
    stages = [dataclasses.replace(each, moves=back(each.moves)) for each in press.stages]
    return press.replace(tools=back(press.tools), holders=back(press.holders), stages=stages)


def centred(press, folder):
    """The sheet's file lies elsewhere, and `centred` puts its middle at the origin."""
    moved = moved_press(press, Map(shift=(30.0, -20.0)), folder)
    fields = "fibre_angle", "thickness", "temperature", "friction"  # of the place as it is laid
    own = ({name: getattr(here, name) for name in fields} for here in press.sheets)
    pairs = zip(moved.sheets, own)
    sheets = [dataclasses.replace(there, centred=True, **here) for there, here in pairs]
    return press.replace(sheets=sheets)


def more_points(press, folder):
    """The outline has points between its corners."""
    (sheet,) = press.sheets
    ring = np.loadtxt(sheet.outline, delimiter=",", skiprows=1)
    between = (ring + np.roll(ring, -1, 0)) / 2
    fine = np.stack([ring, between], 1).reshape(-1, 2)
    np.savetxt(folder / "fine.csv", fine, delimiter=",", header="x,y", comments="")
    return press.replace(sheets=dataclasses.replace(sheet, outline=str(folder / "fine.csv")))


def drawn_in(unit, size):
    """The outline is a drawing in this unit (number of $INSUNITS), of a size in mm."""

    def drawn(press, folder):
        (sheet,) = press.sheets
        ring = np.loadtxt(sheet.outline, delimiter=",", skiprows=1) / size
        drawing = ezdxf.new(units=unit)
        drawing.modelspace().add_lwpolyline(ring, close=True)
        drawing.saveas(folder / f"{unit}.dxf")
        return press.replace(sheets=dataclasses.replace(sheet, outline=str(folder / f"{unit}.dxf")))

    return drawn


def written(press, folder):
    """It is written to a file and read."""
    press.write(folder / "press.toml")
    return ff.Press.read(folder / "press.toml")


def set_again(press, folder):
    """A file says other numbers, and `--set` the right ones."""
    press.write(folder / "set.toml")
    document, changes = tomllib.loads((folder / "set.toml").read_text()), []

    def spoil(table, path):
        for key, value in table.items():
            if isinstance(value, dict):
                spoil(value, [*path, key])
            elif isinstance(value, list) and value and isinstance(value[0], dict):
                for k, each in enumerate(value, 1):
                    spoil(each, [*path, key, str(k)])
            elif type(value) in (int, float) and all("." not in each for each in [*path, key]):
                changes.append(f"{'.'.join([*path, key])}={value!r}")
                table[key] = value + 1

    spoil(document, [])
    (folder / "set.toml").write_text(tomli_w.dumps(document))
    return ff.Press.read(folder / "set.toml", changes)


def longer(press, folder):
    """Strokes and lengths are off by 1e-10."""
    more = 1 + 1e-10
    wider = lambda each: dataclasses.replace(each, length=each.length * more)  # noqa: E731
    moves = [{name: more * way for name, way in each.moves.items()} for each in press.stages]
    return press.replace(
        sheets=[wider(each) if each.length else each for each in press.sheets],
        stages=[dataclasses.replace(each, moves=m) for each, m in zip(press.stages, moves)],
    )


def whole(press, folder):
    """The whole blank instead of a quarter or half."""
    sheets = [sheet.mirrored(press.planes) for sheet in press.sheets]
    return press.replace(sheets=sheets, symmetry="none")


RASTER = {"besides": HEIGHTS, "why": "waves are sought along six directions from x on"}
TURNED = {"within": 1e-6} | RASTER
CHANGES = {
    "moved": Change(map=Map(shift=(50.0, 40.0))),  # its corner to the origin
    "far away": Change(map=Map(shift=(2300.0, -400.0)), within=2e-6, why="12 digits of places"),
    "turned by 30 deg": Change(map=Map(axes=about_z(30.0)), **TURNED),
    "turned by 45 deg": Change(map=Map(axes=about_z(45.0)), **TURNED),
    "turned by 90 deg": Change(map=Map(axes=about_z(90.0)), **TURNED),
    "mirrored": Change(map=Map(axes=MIRROR), **RASTER),
    "x for y": Change(map=Map(axes=np.eye(3)[[1, 0, 2]]), **RASTER),
    "turned over": Change(map=Map(axes=np.diag([1.0, -1.0, -1.0])), **RASTER),
    "cells in another order": Change(map=Map(renumbered=True), within=1e-7),
    "file at z = 5": Change(map=Map(lifted=5.0)),
    "weft for warp": Change(weft_for_warp),
    "other names": Change(renamed),
    "another order": Change(reordered),
    "centred": Change(centred),
    "written and read": Change(written, same=True),
    "set in the command": Change(set_again, same=True),
    "more points": Change(more_points, within=1e-6),
    "in inch": Change(drawn_in(1, 25.4), within=1e-6),
    "in cm": Change(drawn_in(5, 10.0), within=1e-6),
    "in m": Change(drawn_in(6, 1000.0), within=1e-6),
    "off by 1e-10": Change(longer, within=1e-6, why="forces are solved for to 1e-5"),
    "whole": Change(whole, within=1e-4, **RASTER),
}
# what is promised of a scene: forces are solved for to 1e-5, and soft numbers move with them
PROMISED = dict.fromkeys(("frame", "tension", "skewed", "inner"), 1e-5) | {"by_force": 1e-4}
PROMISED |= dict.fromkeys(("gap", "springs", "edge_springs"), 1e-3)  # what little holds them
PROMISED |= dict.fromkeys(("two_plies", "ply_and_metal"), 2e-2)  # faces of sheets lag by 1 %
# what locates the sheet along other axes, until the first state holds it, without friction always
PROMISED |= {"die_of": 2e-5, "slippery": 2e-5}
# changes that are made together, so that a run tells of several; if it differs, each is made alone.
# Of those that most scenes allow a scene has one run: about in plan, over, along, and yarns alone
IN_TURN = [
    ("moved", "turned by 45 deg", "mirrored", "cells in another order", "other names")
    + ("file at z = 5",),
    ("turned over", "far away", "cells in another order", "another order", "off by 1e-10"),
    ("far away", "cells in another order", "other names", "another order", "file at z = 5"),
    ("turned by 90 deg", "weft for warp", "centred", "other names", "another order"),
]
# of what few scenes allow they have all
RARE = [
    ("turned by 30 deg", "far away", "turned over", "weft for warp", "other names"),
    ("x for y", "cells in another order", "other names", "off by 1e-10"),
    ("whole", "weft for warp", "another order"),
    ("more points", "in inch", "other names"),
    ("in cm", "another order"),
    ("in m", "off by 1e-10"),
]
UNRUN = [("written and read",), ("set in the command",)]
EIGHT = "the end of the flange is felt at eight points around a node, 45 deg apart"
AXES = "edges of a rectangle lie along x and y"
STACK = "a pressure on a stack needs a die above it"
ONLY_HERE = "a file can't hold it"
NOT_BY_DESIGN = {
    "turned by 30 deg": {name: EIGHT for name in PRESSES if name not in ("gap", "springs")},
    "turned by 45 deg": dict.fromkeys(("tension", "edge_springs"), AXES),
    "turned over": dict.fromkeys(("two_plies", "ply_and_metal"), STACK),
    "written and read": dict.fromkeys(("own_term", "fields"), ONLY_HERE),
    "set in the command": dict.fromkeys(("own_term", "fields"), ONLY_HERE),
}
NOT_BY_DESIGN["turned by 30 deg"] |= dict.fromkeys(("tension", "edge_springs"), AXES)


def reason_against(name, scene, press):
    """Why a change is not made of a scene, or ""."""
    if name == "x for y" and len(press.planes) != 2 or name == "whole" and not press.planes:
        return "of a quarter"
    if name in ("more points", "in inch", "in cm", "in m") and scene != "outline":
        return "of an outline"
    goes = CHANGES[name].map and not (CHANGES[name].map.renumbered or CHANGES[name].map.lifted)
    if press.planes and name != "x for y" and (goes or name == "centred"):
        return "planes of symmetry are x = 0 and y = 0"
    return NOT_BY_DESIGN.get(name, {}).get(scene, "")


def runs(scene, press):
    """Changes that are made of a scene in each run."""

    def made(groups):
        can = [(n for n in group if not reason_against(n, scene, press)) for group in groups]
        return [names for names, group in zip(map(tuple, can), groups) if names[:1] == group[:1]]

    few, many = made(RARE), made(IN_TURN)
    return made(UNRUN) + (few or [many[[*PRESSES].index(scene) % len(many)]])


def changed(press, names, folder):
    """The press after these changes."""
    if maps := [CHANGES[name].map for name in names if CHANGES[name].map]:
        press = moved_press(press, reduce(Map.then, maps), folder)
    for name in names:
        if CHANGES[name].edit:
            press = CHANGES[name].edit(press, folder)
    return press


def allowed(names, scene):
    """The difference that is allowed for all of them, and the numbers that they may change."""
    of = [CHANGES[name] for name in names]
    within = max(PROMISED.get(scene, 0.0), *(each.within for each in of))
    return within, {n for each in of for n in each.besides}


COUPON_CHANGES = ("moved", "mirrored", "cells in another order"), ("weft for warp",)


def coupon_changed(coupon, names, folder):
    """A coupon after these of them."""
    if names == ("weft for warp",):
        return weft_for_warp_of(coupon)
    moved = reduce(Map.then, [CHANGES[name].map for name in names])
    return moved_sheet(coupon, coupon.build().blank, folder / "coupon.vtu", moved)
