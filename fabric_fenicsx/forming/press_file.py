"""A press in a TOML file; `docs/howto/press.md` tells all of its entries."""

import dataclasses
import os
import tomllib
from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any

from ..material.files import read_toml
from ..material.presets import load
from ..runtime.errors import InputError
from ..runtime.rules import check_complete, shown, unknown_key
from ..tools.double_dome import DoubleDome
from ..tools.primitives import Block, Cylinder, Plane, Plate, Sphere, Torus
from ..tools.surfaces import Surface, Turned
from .holding import ForceHolder, GapHolder, Grippers, Holder, PressureHolder, SpringHolder
from .plies import plies_of
from .press_tools import DieOf, PressTool
from .regions import EDGES, region
from .stages import Stage

TABLES = "blank", "contact", "tools", "holders"
LISTS = "ply", "stage"
BLANK = (
    *("fabric", "length", "width", "mesh", "outline", "layer", "centred", "size", "nx", "ny"),
    *("pattern", "element", "integration", "fibre_angle", "yarn_angle", "weave_angle", "quarter"),
    *("bending_modulus", "twist_modulus", "in_plane_bending"),
)
FILES = "mesh", "outline"  # of a blank
OF_PLIES = *FILES, "layer", "centred", "size", "fibre_angle", "yarn_angle"  # said of each
CONTACT = "friction", "metal_friction", "slip", "lag", "penalty", "permitted"
TOOL = tuple(each.name for each in dataclasses.fields(PressTool) if each.name != "surface")
# shape -> what makes it of its numbers, and their names; face up, its origin as `PressTool.at` says
SHAPES: dict[str, tuple[Callable[..., Surface], tuple[str, ...]]] = {
    "sphere": (Sphere, ("radius",)),
    "cylinder": (
        lambda radius, axis=(0.0, 1.0, 0.0): Cylinder((0.0, 0.0, 0.0), axis, radius),
        ("radius", "axis"),
    ),
    "plane": (lambda: Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), ()),
    "torus": (
        lambda ring, tube: Torus((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), ring, tube),
        ("ring", "tube"),
    ),
    "plate": (Plate, ("length", "width", "corner", "entry")),
    "block": (Block, ("length", "width", "height", "radius", "corner")),
    "double_dome": (DoubleDome, tuple(each.name for each in dataclasses.fields(DoubleDome))),
}
# entry that tells the kind of a holder -> that kind, and the entries that it has besides
HOLDERS: dict[str, tuple[type, tuple[str, ...]]] = {
    "pressure": (PressureHolder, ("against", "where")),
    "force": (ForceHolder, ("against", "where")),
    "gap": (GapHolder, ("against", "where")),
    "tension": (Grippers, ("edges", "where")),
    "stiffness": (SpringHolder, ("edges", "at", "preload", "length")),
}
STAGE = tuple(each.name for each in dataclasses.fields(Stage))


def read_press(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> dict[str, Any]:
    """The fields of a `Press` from a TOML file. changes: of its entries, texts "KEY=VALUE" with a
    dotted key, as "tools.punch.radius=40". Raises InputError that names file, table and key."""
    if not os.path.isfile(path):
        raise InputError(
            f"press file {shown(path)} does not exist or is not a file; allowed is a TOML file of "
            "a press"
        )
    folder = Path(path).parent

    def made(document):
        for change in changes:
            _change(document, change)
        return _fields(deepcopy(document), folder) | {"document": document}

    return read_toml(path, made)


def _change(document, change):
    """Make a change "KEY=VALUE" in a document."""
    key, equals, text = change.partition("=")
    names = key.strip().split(".")
    if names[0] == "holder" and len(document.get("holders", ())) == 1:
        names[:1] = ["holders", next(iter(document["holders"]))]
    if not equals or not all(names):
        raise InputError(f"change {shown(change)} is no KEY=VALUE; allowed is a dotted key")
    if names[0] in TABLES:
        document.setdefault(names[0], {})
    table: Any = document
    for depth, name in enumerate(names[:-1]):
        if isinstance(table, list):
            by_name = {str(k + 1): each for k, each in enumerate(table)}
            by_name |= {each["name"]: each for each in table if "name" in each}
            found = by_name.get(name)
        else:
            by_name, found = table, table.get(name)
        if not isinstance(found, (dict, list)):
            before = ".".join(names[:depth])
            raise unknown_key(name, by_name, f"{'.'.join(names)}: {name} of {before or 'the file'}")
        table = found
    if not isinstance(table, dict):
        raise InputError(f"change {shown(change)} has no name of its table; allowed is one")
    table[names[-1]] = _value(text.strip())


def _value(text):
    """A number, list or word as TOML has them, or else the text itself."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _fields(document, folder):
    known = ("unit", "title", *TABLES, *LISTS)
    for key in document:
        if key not in known:
            raise unknown_key(key, known, f"entry {key}")
    if document.get("unit") != "mm":
        found = shown(document["unit"]) if "unit" in document else "missing"
        raise InputError(f'unit is {found}; allowed is a line `unit = "mm"`, as all lengths are')
    tables = {name: _table(document.get(name, {}), name, f"[{name}]") for name in TABLES}
    if "ply" in document:
        _hand_down(tables["blank"], document["ply"])
    fields = _blank(tables["blank"], folder, "ply" in document)
    fields |= _known(tables["contact"], CONTACT, "contact")
    if "ply" in document:
        fields["stack"] = plies_of({"unit": "mm", "ply": document["ply"]}, folder)
    fields["tools"] = {
        name: _tool(_table(table, f"tools.{name}", f"[tools.{name}]"), name, folder)
        for name, table in tables["tools"].items()
    }
    fields["holders"] = {
        name: _holder(_table(table, f"holders.{name}", f"[holders.{name}]"), f"holders.{name}")
        for name, table in tables["holders"].items()
    }
    stages = document.get("stage", [])
    if not isinstance(stages, list) or not all(isinstance(each, dict) for each in stages):
        raise InputError("stage is no list; allowed is a table [[stage]] for each")
    fields["stages"] = [
        Stage(**{"name": f"stage {k}"} | _known(each, STAGE, f"stage {k}"))
        for k, each in enumerate(stages, 1)
    ]
    if "title" in document:
        fields["title"] = document["title"]
        if not isinstance(document["title"], str):
            raise InputError(f"title is {shown(document['title'])}; allowed is a text")
    return fields


def _hand_down(blank, plies):
    """Give plies what the blank says and they do not."""
    for key in [key for key in OF_PLIES if key in blank]:
        value = blank.pop(key)
        for ply in plies if isinstance(plies, list) else ():
            if isinstance(ply, dict):
                ply.setdefault(key, value)


def _table(value, name, label):
    if not isinstance(value, Mapping):
        raise InputError(f"{name} is {shown(value)}; allowed is a table, {label}")
    return dict(value)


def _known(table, keys, name):
    """The table, if it has no other keys than these."""
    for key in table:
        if key not in keys:
            raise unknown_key(key, keys, f"{name}.{key}")
    return table


def _file(value, name, folder):
    """The path of a file that lies beside the press file, or where it says."""
    if not isinstance(value, str):
        raise InputError(f"{name} is {shown(value)}; allowed is a file's name")
    beside = folder / value
    if not (beside.is_file() or os.path.isfile(value)):
        raise InputError(f"{name} is {shown(value)}, no file; allowed is one beside the press file")
    return str(beside) if beside.is_file() else value


def _blank(table, folder, has_plies):
    _known(table, BLANK, "blank")
    for key in FILES:
        if key in table:
            table[key] = _file(table[key], f"blank.{key}", folder)
    for key in ("quarter", "centred"):
        if not isinstance(table.get(key, False), bool):
            raise InputError(f"blank.{key} is {shown(table[key])}; allowed is true or false")
    fabric = table.pop("fabric", None)
    if fabric is None and not has_plies:
        raise InputError(
            "blank.fabric is missing; allowed is a preset, as komeili, or a material file"
        )
    if fabric is not None:
        if not isinstance(fabric, str):
            raise InputError(
                f"blank.fabric is {shown(fabric)}; allowed is a preset or a material file"
            )
        beside = folder / fabric
        table["fabric"] = load(str(beside) if beside.is_file() else fabric)
    if not (has_plies or table.keys() & {"length", "mesh", "outline"}):
        raise InputError(
            "blank has no size; allowed are length and width, an outline or a mesh, in [blank]"
        )
    return table | {"full": not table.pop("quarter", False)}


def _tool(table, name, folder):
    ways = [key for key in ("shape", "file", "die_of") if key in table]
    if len(ways) != 1:
        raise InputError(
            f"tools.{name} has {' and '.join(ways) or 'no surface'}; allowed is one of shape "
            f"({', '.join(SHAPES)}), file and die_of"
        )
    (way,) = ways
    given, label = table.pop(way), f"tools.{name}"
    own = {key: table.pop(key) for key in TOOL if key in table}
    if way == "file":
        _known(table, TOOL, label)
        surface: Surface | str | DieOf = _file(given, f"{label}.file", folder)
    elif way == "shape":
        shape = _shape(given, table, label)
        surface = Turned(shape, (180.0, 0.0, 0.0)) if own.get("side") == "above" else shape
    else:
        _known(table, ("clearance", *TOOL), label)
        surface, own = DieOf(given, table.get("clearance")), {"side": "above"} | own
    try:
        return PressTool(surface, **own)
    except InputError as error:
        raise InputError(f"[{label}] {error}") from None


def _shape(shape: str, table: Mapping[str, Any], label: str) -> Surface:
    if shape not in SHAPES:
        raise unknown_key(shape, SHAPES, f"{label}.shape {shape}")
    make, keys = SHAPES[shape]
    _known(table, (*keys, *TOOL), label)
    try:
        return make(**table)
    except TypeError:
        check_complete(table, [k for k in keys if k != "width"], f"{label}.", f"in [{label}]")
        raise
    except InputError as error:
        raise InputError(f"{label}: {error}") from None


def _holder(table: Mapping[str, Any], label: str) -> Holder:
    kinds = [key for key in HOLDERS if key in table]
    if len(kinds) != 1:
        raise InputError(
            f"{label} has {' and '.join(kinds) or 'nothing that holds'}; allowed is one of "
            f"{', '.join(HOLDERS)}"
        )
    (kind,) = kinds
    make, keys = HOLDERS[kind]
    _known(table, (kind, *keys), label)
    given = {key: value for key, value in table.items() if key not in ("where", "edges")}
    if "where" in table:
        given["where"] = region(table["where"], f"{label}.where")
    if "edges" in table:
        if not isinstance(table["edges"], list) or not set(table["edges"]) <= set(EDGES):
            raise InputError(
                f"{label}.edges is {shown(table['edges'])}; allowed is a list of some of "
                f"{', '.join(EDGES)}"
            )
        given["edges"] = tuple(table["edges"])
    return make(**given)
