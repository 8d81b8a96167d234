"""A press as tables of TOML and back; `docs/howto/press.md` explains all entries."""

import logging
import os
import re
from collections.abc import Collection, Mapping, Sequence
from functools import partial
from itertools import count
from pathlib import Path
from typing import TypeVar

import numpy as np
import tomli_w

from ..core import tables
from ..core.errors import InputError
from ..core.files import check_file
from ..core.rules import repr_short, unknown_key
from ..core.tables import as_list, as_table, key_of, located, names_of
from ..io.field import Field, OfPlace, from_entry
from ..material.files import read_toml, write_whole
from ..material.laws.base import Material
from ..material.metal import METALS
from ..material.presets import PRESETS
from ..sheet.sheet import Sheet
from ..solve.limits import Limits
from .holders import HOLDERS, Region
from .interface import Interface
from .press_data import PressData
from .stages import Stage
from .tools import SHAPES, DieOf, PressTool

P = TypeVar("P", bound=PressData)
log = logging.getLogger("fabric_fenicsx")
TABLES = "blank", "contact", "limits", "tools", "holders"
# option of a study -> entry of a sheet: a change without a table, as "nx=8", is of all plies
OF_ALL_PLIES = {"material": "fabric"} | {
    name: name
    for name in ("nx", "ny", "size", "pattern", "element", "integration")
    + ("fibre_angle", "yarn_angle", "temperature")
}
SURFACES = "shape", "file", "die_of"  # keys of a tool, one of which it has


# -- reading


def read(kind: type[P], path: Path, changes: Sequence[str] = ()) -> P:
    """The press in a file. changes: of its entries, texts "KEY=VALUE", as "tools.punch.radius=40";
    one that excludes others replaces them. Raises InputError that names file, table and key."""
    check_file(path, "press file", "a TOML file of a press")

    def made(document):
        for change in changes:
            _change(document, *tables.key_and_value(change))
        return kind(**_fields(document, path))

    return read_toml(path, made)


def _fields(document, path):
    known = "unit", "title", "gravity", *TABLES, "ply", "stage"
    if other := next((key for key in document if key not in known), ""):
        raise unknown_key(other, known, f"entry {other}")
    if (unit := document.get("unit", "missing")) != "mm":
        raise InputError(f'unit is {unit}; expected a line `unit = "mm"`, the unit of lengths')
    blank, contact, limits, tools, holders = (
        as_table(document.get(name, {}), name, f"a table, [{name}]") for name in TABLES
    )
    convert = partial(_value, folder=path.parent)
    return {
        "title": document.get("title", path.stem.replace("_", " ")),
        "gravity": document.get("gravity", 0.0),
        "symmetry": blank.pop("symmetry", "none"),
        "stop_when_invalid": limits.pop("stop_when_invalid", False),
        "sheets": _sheets(document, blank, convert),
        "interface": tables.read(Interface, contact, "contact", convert),
        "limits": tables.read(Limits, limits, "limits", convert),
        "tools": {name: _tool(table, f"tools.{name}", convert) for name, table in tools.items()},
        "holders": {n: _holder(table, f"holders.{n}", convert) for n, table in holders.items()},
        "stages": [
            tables.read(Stage, each, f"stage.{each.get('name', k)}", convert)
            for k, each in enumerate(as_list(document.get("stage"), "stage"), 1)
        ],
    }


def _sheets(document, blank, convert):
    """The sheets of [[ply]], the lowest first, completed by [blank], or the one of [blank]."""
    if "ply" not in document:
        return [tables.read(Sheet, blank, "blank", convert)]
    sheets = []
    for k, ply in enumerate(as_list(document["ply"], "ply"), 1):
        barred = {other for key in ply for other in Sheet.REPLACES.get(key, ())}
        handed = {key: value for key, value in blank.items() if key not in barred}
        whole = {"name": f"ply {k}"} | handed | ply
        sheets.append(tables.read(Sheet, whole, f"ply.{ply.get('name', k)}", convert))
    return sheets


def _tool(table, path, convert):
    table, common = as_table(table, path), names_of(PressTool)
    if "off" in table:
        log.warning("%s.off was renamed to start_distance", path)
        table["start_distance"] = table.pop("off")
    kind, side = key_of(SURFACES, table, path), table.get("side", "below")
    own = {key: table.pop(key) for key in [*table] if key not in common}
    value = own.pop(kind)
    if kind == "shape":
        if not (shape := SHAPES.get(str(value))):
            raise unknown_key(value, SHAPES, f"{path}.shape {value}")
        table["surface"] = shape.read(own, path, side)
    elif kind == "die_of":
        die = tables.read(DieOf, {"tool": value} | own, path, convert)
        table = {"surface": die, "side": "above"} | table
    else:
        table |= {"surface": convert(value, {"metavar": "FILE"}, f"{path}.file")} | own
    return tables.read(PressTool, table, path, convert)


def _holder(table, path, convert):
    table = as_table(table, path, f"a table with one of {', '.join(HOLDERS)}")
    return tables.read(HOLDERS[key_of(HOLDERS, table, path)], table, path, convert)


def _value(value, meta, path, folder):
    """A value of a table in the form that a field with this metadata takes."""
    if "read" in meta:
        numbers = dict(value) if isinstance(value, Mapping) else {"material": value}
        source = numbers.pop("material", None)
        beside = folder / str(source)
        with located(path, ()):
            return meta["read"](str(beside) if beside.is_file() else source).changed(numbers)
    if isinstance(meta.get("rule"), OfPlace) and isinstance(value, (str, Mapping)):
        with located(path, ()):
            return from_entry(value, path, lambda file, at: _file(file, at, folder))
    if meta.get("metavar") == "FILE":
        return _file(value, path, folder)
    if "table" in meta:
        return meta["table"](value)
    return value


def _file(value, path, folder):
    """The path of a file: in the folder of the press file, or as it is given."""
    names = [folder / value, Path(value)] if isinstance(value, str) else []
    if file := next(filter(os.path.isfile, names), None):
        return str(file)
    raise InputError(
        f"{path} is {repr_short(value)}, no file; expected one in the folder of the press file"
    )


# -- changes


def _change(document, names, value):
    if names[0] == "holder" and len(document.get("holders", ())) == 1:
        names = ["holders", *document["holders"], *names[1:]]
    if len(names) == 1 and names[0] in OF_ALL_PLIES.values():
        _change_all_plies(document, names[0], value)
    elif names[0] in ("fabric", "metal"):
        _change_material(document, names, value)
    else:
        _put(document, names, value)


def _put(document, names, value):
    """Enter a value at a path; tables of a list have their name, or their number from 1."""
    table, begins = document, {1: TABLES, 3: ("stage",)}  # tables that need not be there
    for depth, name in enumerate(names[:-1], 1):
        if isinstance(table, list):
            named = {each["name"]: each for each in table if "name" in each}
            table = {str(k): each for k, each in enumerate(table, 1)} | named
        elif name not in table and names[0] in begins.get(depth, ()):
            _enter(table, names[:depth], {})
        elif name in ("fabric", "metal") and isinstance(table.get(name), str):
            table[name] = {"material": table[name]}
        if not isinstance(table.get(name), (dict, list)):
            of = ".".join(names[: depth - 1]) or "the file"
            raise unknown_key(name, table, f"{'.'.join(names)}: {name} of {of}")
        table = table[name]
    if isinstance(table, list):
        path = ".".join(names)
        raise InputError(f"{path} is not an entry; expected {'.'.join(names[:-1])}.NAME.KEY")
    _enter(table, names, value)


def _enter(table, names, value):
    """Set the last name of a path in its table, instead of entries that it excludes."""
    kind, key = names[0], names[-1]
    excluded: Collection[str] = {"stage.moves": ["close"], "stage.close": ["moves"]}.get(
        f"{kind}.{key}", Sheet.REPLACES.get(key, ()) if kind in ("blank", "ply") else ()
    )
    if key in {"tools": SURFACES, "holders": HOLDERS}.get(kind, ()):
        excluded = {*table} - {*names_of(PressTool if kind == "tools" else HOLDERS[key])}
    if key not in table or key == "shape":
        for each in excluded:
            table.pop(each, None)
    table[key] = value


def _change_all_plies(document, key, value):
    """Change an entry of all plies. One with `nx` or `ny` of its own keeps its share of cells."""
    blank = document.setdefault("blank", {})
    for ply in document.get("ply", ()):
        if key in ("nx", "ny") and key in ply and isinstance(value, int):
            ply[key] = max(1, round(ply[key] * value / blank.get(key, ply[key])))
            continue
        for each in (key, *Sheet.REPLACES.get(key, ())):
            ply.pop(each, None)
    _put(document, ["blank", key], value)


def _change_material(document, names, value):
    """Change a number of the one fabric, or metal, of all sheets: of "fabric.s1=0.03"."""
    kind, sheets = names[0], {"blank": document.get("blank", {})}
    sheets |= {f"ply.{k}": ply for k, ply in enumerate(document.get("ply", ()), 1)}
    named = {path: sheet[kind] for path, sheet in sheets.items() if kind in sheet}
    if len({str(each) for each in named.values()}) != 1:
        flaw = f"{'.'.join(names)} refers to one {kind} for all sheets, and the file has "
        flaw += ", ".join(f"{path}.{kind}" for path in named) or "none"
        raise InputError(f"{flaw}; expected the path of one")
    for path in named:
        _put(document, [*path.split("."), *names], value)


def short_forms(options: Mapping[str, object]) -> list[str]:
    """The changes that options of `OF_ALL_PLIES` stand for; material files are in this folder."""
    given = {OF_ALL_PLIES[n]: v for n, v in options.items() if n in OF_ALL_PLIES and v is not None}
    if os.path.isfile(str(given.get("fabric", ""))):
        given["fabric"] = os.path.abspath(str(given["fabric"]))
    return [f"{key}={value}" for key, value in given.items()]


# -- writing


def document_of(press: PressData) -> dict[str, object]:
    """The tables of a press. What a file cannot hold, as functions and surfaces of a user's own,
    stays as it is."""
    plies, limits = [tables.entries(s) for s in press.sheets], tables.entries(press.limits)
    blank = {"symmetry": press.symmetry} if press.planes else {}
    document = {
        "unit": "mm",
        "title": press.title,
        "gravity": press.gravity or "",
        "blank": blank | (plies[0] if len(plies) == 1 else {}),
        "contact": tables.entries(press.interface),
        "limits": limits | ({"stop_when_invalid": True} if press.stop_when_invalid else {}),
        "ply": plies if len(plies) > 1 else [],
        "tools": {name: _tool_table(tool) for name, tool in press.tools.items()},
        "holders": {name: _holder_table(each) for name, each in press.holders.items()},
        "stage": [tables.entries(stage) for stage in press.stages],
    }
    return {key: value for key, value in document.items() if value not in ("", {}, [])}


def _tool_table(tool):
    entries = tables.entries(tool)
    surface = entries.pop("surface")
    if isinstance(surface, DieOf):  # whose side has another default in a file
        die = tables.entries(surface)
        return {"die_of": die.pop("tool"), "side": tool.side} | die | entries
    for name, shape in SHAPES.items():
        if (numbers := shape.entries(surface, tool.side)) is not None:
            return {"shape": name} | numbers | entries
    return {"file": surface} | entries


def _holder_table(holder):
    if type(holder) not in HOLDERS.values():
        return holder
    key = names_of(type(holder))[0]
    return {key: getattr(holder, key)} | tables.entries(holder)


def write(press: PressData, path: str | os.PathLike[str]) -> None:
    """Write a press as a file that `read` reads, with files of its materials beside it. Raises
    InputError for what a file cannot hold, and for a file that can't be written."""
    path, files = Path(path), dict[Path, Material]()

    def plain(value, where):
        is_file = isinstance(value, Field) or where.endswith((".file", ".mesh", ".outline"))
        if isinstance(value, (Field, Region)):
            value = value.entry if isinstance(value, Field) else value.limits
        if isinstance(value, Mapping):
            return {key: plain(each, f"{where}.{key}".strip(".")) for key, each in value.items()}
        if isinstance(value, (list, tuple, np.ndarray)):
            return [plain(each, f"{where}.{k}".strip(".")) for k, each in enumerate(value, 1)]
        if isinstance(value, Material):
            name = getattr(value, "name", "") or "material"
            if value in (PRESETS.get(name), METALS.get(name)):
                return name
            name = re.sub(r"\W+", "_", name)  # a name may hold what no file's name can, as "a/b"
            names = (f"{path.stem}_{name}{k or ''}.toml" for k in count())
            file = next(f for f in map(path.with_name, names) if files.get(f, value) == value)
            files[file] = value
            return file.name
        if isinstance(value, str) and is_file:
            return os.path.relpath(value, path.parent)
        if isinstance(value, (str, bool, int, float)):
            return value
        flaw = f"{where} is {repr_short(value)}, which cannot be written to a file"
        raise InputError(f"{flaw}; expected numbers, names, files, shapes and regions")

    text = tomli_w.dumps(plain(document_of(press), ""))
    for file, material in files.items():
        write_whole(file, material.dumps())
    write_whole(path, text)
