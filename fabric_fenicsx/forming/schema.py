"""A press as tables of TOML and back; `docs/howto/press.md` explains all entries."""

import dataclasses
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ..material.files import read_toml, write_whole
from ..material.laws.base import Material
from ..material.metal import METALS
from ..material.presets import PRESETS
from ..readers.field import Field, OfPlace, from_entry
from ..runtime.errors import InputError
from ..runtime.files import check_file
from ..runtime.rules import check_complete, shown, unknown_key
from ..sheets.sheet import Sheet
from ..solve.limits import Limits
from ..tools.double_dome import DoubleDome
from ..tools.primitives import Block, Cylinder, Plane, Plate, Sphere, Torus
from ..tools.surfaces import Surface, Turned
from .holders import KINDS, Holder, Kind, Region
from .interface import Interface
from .stages import Stage
from .tools import DieOf, PressTool

TABLES = "blank", "contact", "limits", "tools", "holders"
ENTRIES = "unit", "title", *TABLES, "ply", "stage"
MATERIALS = "fabric", "metal"  # as {material = "komeili", s1 = 0.03}
# option of a study -> entry of a sheet: a change without a table, as "nx=8", is of all plies
OF_ALL_PLIES = {"material": "fabric"} | {
    name: name
    for name in ("nx", "ny", "size", "pattern", "element", "integration")
    + ("fibre_angle", "yarn_angle", "temperature")
}
SURFACES = "shape", "file", "die_of"  # entries of a tool, one of which it has
# shape -> function of its numbers, and their names; its face is up, its origin at `PressTool.at`
SHAPES: dict[str, tuple[Callable[..., Surface], tuple[str, ...]]] = {
    "sphere": (Sphere, ("radius",)),
    "cylinder": (
        lambda radius, axis=(0.0, 1.0, 0.0): Cylinder((0, 0, 0), axis, radius),
        ("radius", "axis"),
    ),
    "plane": (lambda: Plane((0, 0, 0), (0, 0, 1)), ()),
    "torus": (lambda ring, tube: Torus((0, 0, 0), (0, 0, 1), ring, tube), ("ring", "tube")),
    "plate": (Plate, ("length", "width", "corner", "entry")),
    "block": (Block, ("length", "width", "height", "radius", "corner")),
    "double_dome": (DoubleDome, tuple(each.name for each in dataclasses.fields(DoubleDome))),
}
OVER = (180.0, 0.0, 0.0)  # angles that turn a shape's face down
# entry of a holder -> the kind of holder that has it
HOLDERS: dict[str, type[Kind]] = {kind.key(): kind for kind in KINDS}


# -- reading


def read_document(path: str | os.PathLike[str], changes: Sequence[str] = ()) -> dict[str, Any]:
    """The tables of a press file. changes: of its entries, texts "KEY=VALUE", as
    "tools.punch.radius=40"; one that excludes others replaces them. Raises InputError that names
    the file."""
    check_file(Path(path), "press file", "a TOML file of a press")

    def changed(document):
        for change in changes:
            _change(document, change)
        return document

    return read_toml(path, changed)


def fields_of(document: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The fields of a `Press` from the tables of its file. Other files that it names may be in
    `folder`. Raises InputError that names table and key."""
    for key in document:
        if key not in ENTRIES:
            raise unknown_key(key, ENTRIES, f"entry {key}")
    if document.get("unit") != "mm":
        unit = shown(document["unit"]) if "unit" in document else "missing"
        raise InputError(f'unit is {unit}; allowed is a line `unit = "mm"`, the unit of lengths')
    if not isinstance(document.get("title", ""), str):
        raise InputError(f"title is {shown(document['title'])}; allowed is a text")
    tables = {name: _table(document.get(name, {}), name) for name in TABLES}
    if "quarter" in tables["blank"]:
        raise InputError('blank.quarter is not known; allowed is symmetry = "xy" for a quarter')
    symmetry = tables["blank"].pop("symmetry", "none")
    stops = tables["limits"].pop("stop_when_invalid", False)
    if not isinstance(stops, bool):
        raise InputError(f"limits.stop_when_invalid is {shown(stops)}; allowed is true or false")
    stages = _list(document, "stage")
    return {
        "title": document.get("title", ""),
        "symmetry": symmetry,
        "stop_when_invalid": stops,
        "sheets": _sheets(document, tables["blank"], folder),
        "interface": from_table(Interface, tables["contact"], "contact", folder),
        "limits": from_table(Limits, tables["limits"], "limits", folder),
        "tools": {name: _tool(table, name, folder) for name, table in tables["tools"].items()},
        "holders": {n: _holder(table, n, folder) for n, table in tables["holders"].items()},
        "stages": [
            from_table(Stage, {"name": f"stage {k}"} | each, f"stage.{each.get('name', k)}", folder)
            for k, each in enumerate(stages, 1)
        ],
    }


def from_table(kind: type, table: Mapping[str, Any], path: str, folder: Path) -> Any:
    """The dataclass object that a table describes; path: of the table, for messages."""
    metadata = {each.name: each.metadata for each in dataclasses.fields(kind) if each.init}
    given = {}
    for key, value in table.items():
        if key not in metadata:
            raise unknown_key(key, metadata, f"{path}.{key}")
        given[key] = _value(value, metadata[key], f"{path}.{key}", folder)
    with located(path, metadata):
        return kind(**given)


@contextmanager
def located(path: str, names: Any) -> Iterator[None]:
    """Put the path of a table into messages: `x`, one of these names, becomes path.x."""
    try:
        yield
    except InputError as error:
        words = re.sub(
            r"`(\w+)`", lambda m: f"{path}.{m[1]}" if m[1] in names else m[0], str(error)
        )
        raise InputError(words if path in words else f"{path}: {words}") from None


def _value(value, meta, path, folder):
    """A value of a table in the form that a field with this metadata takes."""
    if "read" in meta:
        numbers = dict(value) if isinstance(value, Mapping) else {"material": value}
        source = numbers.pop("material", None)
        if not isinstance(source, str):
            raise InputError(f"{path} is {shown(value)}; allowed is a preset or a material file")
        beside = folder / source
        with located(path, ()):
            return meta["read"](str(beside) if beside.is_file() else source).changed(numbers)
    if isinstance(meta.get("rule"), OfPlace):
        with located(path, ()):
            return from_entry(value, path, lambda file, at: _file(file, at, folder))
    if meta.get("metavar") == "FILE":
        return _file(value, path, folder)
    if "metavar" in meta and not isinstance(value, str):
        raise InputError(f"{path} is {shown(value)}; allowed is a name")
    return value


def _file(value, path, folder):
    """The path of a file: in the folder of the press file, or as it is given."""
    if not isinstance(value, (str, os.PathLike)):
        raise InputError(f"{path} is {shown(value)}; allowed is a file's name")
    if file := next(filter(os.path.isfile, (folder / value, value)), None):
        return str(file)
    raise InputError(f"{path} is {shown(value)}, no file; allowed is one beside the press file")


def _table(value, name, allowed=""):
    if not isinstance(value, Mapping):
        raise InputError(f"{name} is {shown(value)}; allowed is a table{allowed or f', [{name}]'}")
    return dict(value)


def _list(document, name):
    tables = document.get(name, [])
    if not isinstance(tables, list) or not all(isinstance(each, dict) for each in tables):
        raise InputError(f"{name} is no list; allowed is a table [[{name}]] for each")
    return tables


def _sheets(document, blank, folder):
    """The sheets of [[ply]], the lowest first, completed by [blank], or the one of [blank]."""
    if "ply" not in document:
        return [from_table(Sheet, blank, "blank", folder)]
    plies = _list(document, "ply")
    if not plies:
        raise InputError("ply is empty; allowed is a table [[ply]] for each")
    sheets = []
    for k, ply in enumerate(plies, 1):
        name = ply.get("name", f"ply {k}")
        if not isinstance(name, str) or not name.strip():
            raise InputError(f"ply.{k}.name is {shown(name)}; allowed is a word")
        barred = {other for key in ply for other in Sheet.REPLACES.get(key, ())}
        handed = {key: value for key, value in blank.items() if key not in barred}
        path = f"ply.{ply.get('name', k)}"
        sheets.append(from_table(Sheet, handed | ply | {"name": name}, path, folder))
    names = [sheet.name for sheet in sheets]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise InputError(f"two plies are called {twice}; allowed are different names")
    return sheets


def _tool(table, name, folder):
    path = f"tools.{name}"
    table = _table(table, path)
    kinds = [key for key in SURFACES if key in table]
    if len(kinds) != 1:
        raise InputError(
            f"{path} has {' and '.join(kinds) or 'no surface'}; allowed is one of shape "
            f"({', '.join(SHAPES)}), file and die_of"
        )
    own = _names(PressTool)[1:]
    (kind,), given = kinds, {key: table.pop(key) for key in own if key in table}
    value = table.pop(kind)
    if kind == "shape":
        shape = _shape(value, table, path, own)
        over = given.get("side") == "above"
        surface: Surface | str | DieOf = Turned(shape, OVER) if over else shape
    elif kind == "die_of":
        surface = from_table(DieOf, {"tool": value} | table, path, folder)
        given = {"side": "above"} | given
    else:
        surface = _file(value, f"{path}.file", folder)
        if table:
            raise unknown_key(next(iter(table)), own, f"{path}.{next(iter(table))}")
    return from_table(PressTool, {"surface": surface} | given, path, folder)


def _shape(shape: str, table: Mapping[str, Any], path: str, own: Sequence[str]) -> Surface:
    if shape not in SHAPES:
        raise unknown_key(shape, SHAPES, f"{path}.shape {shape}")
    make, keys = SHAPES[shape]
    for key in table:
        if key not in keys:
            raise unknown_key(key, (*keys, *own), f"{path}.{key}")
    try:
        return make(**table)
    except TypeError:
        check_complete(table, [k for k in keys if k != "width"], f"{path}.", f"in [{path}]")
        raise
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _holder(table: Any, name: str, folder: Path) -> Holder:
    path, allowed = f"holders.{name}", f"one of {', '.join(HOLDERS)}"
    given = _table(table, path, f" with {allowed}")
    kinds = [key for key in HOLDERS if key in given]
    if len(kinds) != 1:
        raise InputError(
            f"{path} has {' and '.join(kinds) or 'nothing that holds'}; allowed is {allowed}"
        )
    if "where" in given:
        with located(path, ("where",)):
            given["where"] = Region(given["where"])
    return from_table(HOLDERS[kinds[0]], given, path, folder)


def _change(document, change):
    """Make a change "KEY=VALUE" in a document."""
    key, equals, text = change.partition("=")
    names = key.strip().split(".")
    if names[0] == "holder" and len(document.get("holders", ())) == 1:
        names[:1] = ["holders", next(iter(document["holders"]))]
    if not equals or not all(names):
        raise InputError(
            f"change {shown(change)} is no KEY=VALUE; allowed is for example blank.nx=8"
        )
    value: Any = text.strip()
    with suppress(tomllib.TOMLDecodeError):  # a number, list or table; else a text
        value = tomllib.loads(f"value = {value}")["value"]
    if len(names) == 1 and names[0] in OF_ALL_PLIES.values():
        _change_all_plies(document, names[0], value)
        return
    if names[0] in MATERIALS:
        _change_material(document, names, text)
        return
    if names[0] in TABLES:
        document.setdefault(names[0], {})
    table: Any = document
    for depth, name in enumerate(names[:-1]):
        if isinstance(table, list):
            by_name = {str(k + 1): each for k, each in enumerate(table)}
            by_name |= {each["name"]: each for each in table if "name" in each}
            entry = by_name.get(name)
        else:
            by_name, entry = table, table.get(name)
        if name in MATERIALS and isinstance(entry, str):
            entry = table[name] = {"material": entry}
        if names[0] == "stage" and depth == 2 and entry is None:  # moves, forces or pressures
            _make_way(table, "stage", name, entry)
            entry = table[name] = {}
        if not isinstance(entry, (dict, list)):
            before = ".".join(names[:depth])
            raise unknown_key(name, by_name, f"{'.'.join(names)}: {name} of {before or 'the file'}")
        table = entry
    if not isinstance(table, dict):
        raise InputError(
            f"change {shown(change)} names no entry of {names[-2]}; allowed is "
            f"{names[-2]}.NAME.KEY=VALUE"
        )
    if len(names) == (2 if names[0] == "blank" else 3):
        _make_way(table, names[0], names[-1], value)
    table[names[-1]] = value


def _make_way(table, kind, key, value):
    """Take out of a table of this kind the entries that a new one excludes."""
    if key in table and not (key == "shape" and table[key] != value):
        return
    out: Iterable[str] = ()
    if kind in ("blank", "ply"):
        out = Sheet.REPLACES.get(key, ())
    elif kind == "stage":
        out = {"moves": ("close",), "close": ("moves",)}.get(key, ())
    elif kind == "tools" and key in SURFACES:
        out = {*table} - {*_names(PressTool)}
    elif kind == "holders" and key in HOLDERS:
        out = {*table} - {*_names(HOLDERS[key])}
    for each in out:
        table.pop(each, None)


def _change_all_plies(document, key, value):
    """Change an entry of all plies. One with `nx` or `ny` of its own keeps its share of cells."""
    blank, plies = document.setdefault("blank", {}), document.get("ply", [])
    for ply in plies if isinstance(plies, list) else ():
        if key in ("nx", "ny") and key in ply and isinstance(value, int):
            ply[key] = max(1, round(ply[key] * value / blank.get(key, ply[key])))
            continue
        for each in (key, *Sheet.REPLACES.get(key, ())):
            ply.pop(each, None)
    _make_way(blank, "blank", key, value)
    blank[key] = value


def short_forms(options: Mapping[str, Any]) -> list[str]:
    """The changes that options of `OF_ALL_PLIES` stand for; material files are in this folder."""
    given = {OF_ALL_PLIES[n]: v for n, v in options.items() if n in OF_ALL_PLIES and v is not None}
    if os.path.isfile(given.get("fabric", "")):
        given["fabric"] = os.path.abspath(given["fabric"])
    return [f"{key}={value}" for key, value in given.items()]


def _names(kind):
    """Names of the fields of a dataclass."""
    return [each.name for each in dataclasses.fields(kind)]


def _change_material(document, names, text):
    """Change numbers of the one fabric, or metal, of all sheets: of "fabric.s1=0.03"."""
    kind = names[0]
    paths = {"blank": document.get("blank", {})}
    paths |= {f"ply.{k}": ply for k, ply in enumerate(document.get("ply", ()), 1)}
    named = {path: table[kind] for path, table in paths.items() if kind in table}
    if len({str(each) for each in named.values()}) != 1 or len(names) != 2:
        keys = " and ".join(f"{path}.{kind}" for path in named) or "none"
        raise InputError(
            f"change {'.'.join(names)}={text} is of one {kind} of all sheets, and the file has "
            f"{keys}; allowed is {kind}.NUMBER=VALUE for one material, or with the path of a ply"
        )
    for path in named:
        _change(document, f"{path}.{'.'.join(names)}={text}")


# -- writing


def document_of(press: Any) -> dict[str, Any]:
    """The tables of a `Press`. What a file cannot hold, as functions and surfaces of a user's own,
    stays as it is."""
    plies = [_entries(sheet) for sheet in press.sheets]
    document: dict[str, Any] = {"unit": "mm"}
    document |= {"title": press.title} if press.title else {}
    blank: dict[str, Any] = {"symmetry": press.symmetry} if press.planes else {}
    document["blank"] = blank | (plies[0] if len(plies) == 1 else {})
    document["contact"] = _entries(press.interface)
    stops = {"stop_when_invalid": True} if press.stop_when_invalid else {}
    document["limits"] = _entries(press.limits) | stops
    if len(plies) > 1:
        document["ply"] = plies
    document["tools"] = {name: _tool_table(tool) for name, tool in press.tools.items()}
    document["holders"] = {name: _holder_table(each) for name, each in press.holders.items()}
    document["stage"] = [_entries(stage) for stage in press.stages]
    return {key: value for key, value in document.items() if value not in ({}, [])}


def write(press: Any, path: str | os.PathLike[str]) -> None:
    """Write a `Press` as a file that `Press.read` reads, with files of its materials beside it.
    Raises InputError for what a file cannot hold, and for a file that can't be written."""
    path, files = Path(path), dict[Path, Any]()

    def plain(value, where):
        if isinstance(value, Field):
            value = value.entry
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
        if isinstance(value, (str, bool, int, float)):
            return value
        raise InputError(
            f"{where} is {shown(value)}, which a file cannot hold; allowed are numbers, names, "
            "files, shapes and regions"
        )

    text = tomli_w.dumps(plain(document_of(press), ""))
    for file, material in files.items():
        write_whole(file, material.dumps())
    write_whole(path, text)


def _entries(owner):
    """The fields of a dataclass object that differ from their defaults and from None."""
    entries = {}
    for each in dataclasses.fields(owner):
        value, usual = getattr(owner, each.name), each.default
        if each.default_factory is not dataclasses.MISSING:
            usual = each.default_factory()
        same = value is usual or (isinstance(value, type(usual)) and value == usual)
        if not (same or value is None):
            entries[each.name] = value
    return entries


def _tool_table(tool):
    entries = _entries(tool)
    surface = entries.pop("surface")
    if isinstance(surface, DieOf):
        of = {"die_of": surface.tool, "side": tool.side}  # whose default is another in a file
        return of | ({"clearance": surface.clearance} if surface.clearance else {}) | entries
    if isinstance(surface, (str, os.PathLike)):
        return {"file": str(surface)} | entries
    if tool.side == "above":  # a shape in a file has its face up, and was turned over when read
        turned = isinstance(surface, Turned) and surface == Turned(surface.surface, OVER)
        surface = surface.surface if turned else None
    for shape, (make, keys) in SHAPES.items():
        numbers = {key: getattr(surface, key, None) for key in keys}
        if shape == "plate" and numbers["width"] == numbers["length"] == 2 * (
            numbers["corner"] or 0
        ):
            numbers = {key: numbers[key] for key in ("length", "entry")}  # a round opening
        if not any(value is None for value in numbers.values()):
            with suppress(InputError):
                if make(**numbers) == surface:
                    plain = {k: np.asarray(v).tolist() for k, v in numbers.items()}
                    return {"shape": shape} | plain | entries
    return {"file": tool.surface} | entries


def _holder_table(holder):
    kind = next((key for key, kind in HOLDERS.items() if type(holder) is kind), "")
    if not kind:
        return holder
    entries = {kind: getattr(holder, kind)} | _entries(holder)
    if isinstance(entries.get("where"), Region):
        entries["where"] = dict(entries["where"].limits)
    return entries
