"""Imports go one way through the rooms of the package."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "fabric_fenicsx"
# a room imports what stands before it, and itself
ORDER = (
    "runtime",
    "dolfinx_compat",
    "meshes",
    "material",
    "sheets",
    "tools",
    "mechanics",
    "scene",
    "solve",
    "results",
    "job",
    "verification",
    "scenarios",
    "command_line",
)
MODULES = [p for p in PACKAGE.rglob("*.py") if p.parent != PACKAGE or p.stem in ORDER]


def imported(path):
    """Modules of the package that a file imports when it is imported or run, as tuples of names;
    not those for types alone."""
    here = path.relative_to(PACKAGE).with_suffix("").parts
    tree = ast.parse(path.read_text())
    for_types = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    ]
    skipped = {id(inner) for node in for_types for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level and id(node) not in skipped:
            base = here[: len(here) - node.level]
            module = (*base, *(node.module.split(".") if node.module else ()))
            yield from (module,) if module else ((alias.name,) for alias in node.names)


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_go_down(path):
    own = path.relative_to(PACKAGE).with_suffix("").parts[0]
    for module in imported(path):
        if module[0] in ORDER:
            assert ORDER.index(module[0]) <= ORDER.index(own), ".".join(module)


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_no_private_name_crosses_modules(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            names = [alias.name for alias in node.names if not alias.name.startswith("__")]
            assert not [name for name in names if name.startswith("_")]


@pytest.mark.parametrize(
    "path", sorted(PACKAGE.rglob("*.py")), ids=lambda p: str(p.relative_to(PACKAGE))
)
def test_modules_are_short(path):
    assert len(path.read_text().splitlines()) <= 400
