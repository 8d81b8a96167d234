"""What is public has types, which those who use the package get with it."""

import ast
import importlib.resources
from pathlib import Path

import pytest

pytestmark = pytest.mark.versions

ROOT = Path(__file__).parents[1]
FILES = sorted(
    f.relative_to(ROOT).as_posix()
    for d in ("fabric_fenicsx", "meshes")
    for f in (ROOT / d).rglob("*.py")
)
CALLED = "__init__", "__call__"


def public(body, inside=""):
    """Functions of a module or class, (name, node, how many of the arguments need no type), if no
    name has an underscore."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public(node.body, f"{node.name}.")
        if isinstance(node, ast.FunctionDef) and (
            not node.name.startswith("_") or node.name in CALLED
        ):
            static = any(
                isinstance(d, ast.Name) and d.id == "staticmethod" for d in node.decorator_list
            )
            yield inside + node.name, node, int(bool(inside) and not static)


@pytest.mark.parametrize("file", FILES)
def test_public_names_are_annotated(file):
    for name, function, skipped in public(ast.parse((ROOT / file).read_text()).body):
        given = function.args
        each = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg][
            skipped:
        ]
        missing = [a.arg for a in each if a and not a.annotation] + ["what it returns"] * (
            not function.returns
        )
        assert not missing, f"{file}: {name} has no type for {', '.join(missing)}"


def test_the_package_says_that_it_has_types():
    assert importlib.resources.files("fabric_fenicsx").joinpath("py.typed").is_file()
