"""Rules for the source: imports go one way, and no part grows beyond its bound."""

import ast
import importlib.resources
import re
import subprocess
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "fabric_fenicsx"
# a room imports what stands before it, and itself
ORDER = (
    *("core", "dolfinx_compat", "io", "material", "surfaces", "sheet", "energy", "contact"),
    *("scene", "solve", "results", "job", "verification", "coupons", "press", "identification"),
    *("sweep", "cli"),
)
DOORS = "__init__", "__main__"  # of the package: they lead into all rooms
FILES = {
    path.relative_to(PACKAGE): path.read_text()
    for path in sorted(PACKAGE.rglob("*.py"))
    if "studies" not in path.parts
}
TREES = {name: ast.parse(text) for name, text in FILES.items()}


def imported(path):
    """Files of the package that a file imports, also for types or within functions."""
    for node in ast.walk(TREES[path]):
        if isinstance(node, ast.ImportFrom) and node.level:
            home = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for target in (home, *(home / alias.name for alias in node.names)):
                if (file := Path(f"{target}.py")) in FILES:
                    yield file


def test_the_list_of_rooms_leaves_out_none():
    assert {path.with_suffix("").parts[0] for path in FILES} == {*ORDER, *DOORS}


def test_imports_go_down():
    """From room to room; the package's own doors and the studies are outermost."""
    rank = {room: place for place, room in enumerate((*ORDER, *DOORS))}
    rooms = {path: rank[path.with_suffix("").parts[0]] for path in FILES}
    wrong = [(str(a), str(b)) for a in FILES for b in imported(a) if rooms[b] > rooms[a]]
    assert not wrong


def test_no_file_leads_back_to_itself():
    TopologicalSorter({path: {*imported(path)} for path in FILES}).prepare()  # names the circle


def nodes(kind):
    every = ((path, node) for path, tree in TREES.items() for node in ast.walk(tree))
    return [(path, node) for path, node in every if isinstance(node, kind)]


def tracked(*patterns):
    command = ["git", "ls-files", *patterns]
    names = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [(ROOT / name).read_text() for name in names.split()]


def lines(texts):
    return sum(text.count("\n") for text in texts)


def input_errors():
    names = re.compile("InputError|unknown_key|WrongFormat")
    return sum(bool(names.search(ast.dump(n.exc))) for _, n in nodes(ast.Raise) if n.exc)


def constants():
    name = re.compile(r"^[A-Z][A-Z_]+(?:, [A-Z_]+)*\s*(?::[^=\n]+)?=", re.M)
    return sum(len(name.findall(text)) for text in FILES.values())


def late_imports():
    found = nodes(ast.ImportFrom)
    return sum(node.level > 0 and node not in TREES[path].body for path, node in found)


def attributes(node):
    """Names that a class stores on itself."""
    named = (n for n in ast.walk(node) if isinstance(n, ast.Attribute))
    stored = (n for n in named if isinstance(n.ctx, ast.Store) and isinstance(n.value, ast.Name))
    return {n.attr for n in stored if n.value.id == "self"}


BOUNDS = {
    "lines of the package": (32_000, lambda: lines(FILES.values())),
    "lines of tests": (19_000, lambda: lines(tracked("tests/*.py"))),
    "lines of benchmarks": (1_920, lambda: lines(tracked("benchmarks/*.py"))),
    "words of pages": (
        33_000,
        lambda: sum(len(t.split()) for t in tracked("README.md", "docs/*.md")),
    ),
    "input errors": (300, input_errors),
    "constants": (200, constants),
    "imports within functions or for types": (60, late_imports),
    "Any": (250, lambda: sum(len(re.findall(r"\bAny\b", text)) for text in FILES.values())),
    "lines of a file": (400, lambda: max(text.count("\n") for text in FILES.values())),
    "lines of a function": (
        60,
        lambda: max(n.end_lineno - n.lineno + 1 for _, n in nodes(ast.FunctionDef)),
    ),
    "attributes of a class": (15, lambda: max(len(attributes(n)) for _, n in nodes(ast.ClassDef))),
}


@pytest.mark.parametrize("what", BOUNDS)
def test_bounds(what):
    most, count = BOUNDS[what]
    assert count() <= most


@pytest.mark.versions
def test_the_package_says_that_it_has_types():
    assert importlib.resources.files("fabric_fenicsx").joinpath("py.typed").is_file()
