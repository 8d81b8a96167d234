"""Rules for the source: imports go one way."""

import ast
import importlib.resources
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "fabric_fenicsx"
# a room imports what stands before it, and itself
ORDER = (
    "runtime dolfinx_compat readers material identification tools meshes sheets mechanics scene "
    "solve postprocess plot results job verification coupons forming sweep command_line studies"
).split()
DOORS = "__init__", "__main__"  # of the package: they lead into all rooms
FILES = {p.relative_to(PACKAGE): p for room in PACKAGE.iterdir() for p in room.rglob("*.py")}
FILES |= {p.relative_to(PACKAGE): p for p in PACKAGE.glob("*.py")}
MODULES = {
    ".".join(p.with_suffix("").parts).removesuffix(".__init__"): path for p, path in FILES.items()
}


@cache
def trees():
    """{module: its syntax tree}."""
    return {name: ast.parse(path.read_text()) for name, path in MODULES.items()}


def imported(name, at_once=False):
    """Modules of the package that `name` imports, but for types; `at_once`: without those that its
    functions import when they are called."""
    here = MODULES[name].relative_to(PACKAGE).with_suffix("").parts
    skipped = {
        id(inner)
        for node in ast.walk(trees()[name])
        if (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
        or (at_once and isinstance(node, ast.FunctionDef))
        for inner in ast.walk(node)
    }
    for node in ast.walk(trees()[name]):
        if not isinstance(node, ast.ImportFrom) or id(node) in skipped:
            continue
        words = tuple(node.module.split(".")) if node.module else ()
        if node.level:
            home = (*here[: len(here) - node.level], *words)
        elif words[0] == PACKAGE.name:
            home = words[1:]
        else:
            continue
        for alias in node.names:
            inside = ".".join((*home, alias.name))
            yield inside if inside in MODULES else ".".join(home) or "__init__"


def test_the_list_of_rooms_leaves_out_none():
    found = {path.stem for path in PACKAGE.iterdir()} - {"__pycache__", "py"}
    assert found == {*ORDER, *DOORS}


def test_imports_go_down():
    """The package's own doors and the studies are outermost."""
    rank = {room: place for place, room in enumerate(ORDER)}
    wrong = []
    for name in MODULES:
        own = name.split(".")[0]
        if own in (*DOORS, "studies"):
            continue
        found = ((module, module.split(".")[0]) for module in imported(name))
        wrong += [(name, module) for module, room in found if rank.get(room, 99) > rank[own]]
    assert not wrong


def test_no_module_leads_back_to_itself():
    """Data (a press, a coupon) import what builds them when they are built."""
    graph = {name: {*imported(name, at_once=True)} for name in MODULES}
    TopologicalSorter(graph).prepare()  # its CycleError names the circle


@pytest.mark.versions
def test_the_package_says_that_it_has_types():
    assert importlib.resources.files("fabric_fenicsx").joinpath("py.typed").is_file()
