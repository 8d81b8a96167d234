"""Each name of the facade has an example in its docstring, and the examples print what they say."""

import doctest
import inspect
import pkgutil
from importlib import import_module

import numpy as np
import pytest

import fabric_fenicsx as ff

pytestmark = pytest.mark.versions

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.REPORT_ONLY_FIRST_FAILURE


def examples(name):
    """Doctests of a name and of its methods that have one, the name's own first."""
    found = doctest.DocTestFinder().find(
        getattr(ff, name), f"ff.{name}", module=False, globs={"ff": ff, "np": np}
    )
    return sorted((test for test in found if test.examples), key=lambda test: test.name)


def test_each_name_has_an_example():
    lacking = [n for n in ff.__all__ if f"ff.{n}" not in [test.name for test in examples(n)]]
    assert not lacking, ", ".join(lacking)


def test_examples_print_what_they_say(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runner, wrong = doctest.DocTestRunner(verbose=False, optionflags=FLAGS), []
    for test in (test for name in ff.__all__ for test in examples(name)):
        runner.run(test, out=wrong.append)
    assert not wrong, "".join(wrong)
    assert not list(tmp_path.iterdir()), "examples write no files"


def test_public_methods_have_a_docstring_or_inherit_one():
    lacking = []
    for found in pkgutil.walk_packages(ff.__path__, "fabric_fenicsx."):
        if "__main__" in found.name or ".studies" in found.name:
            continue
        for kind in vars(import_module(found.name)).values():
            if not inspect.isclass(kind) or kind.__name__[0] == "_":
                continue
            if kind.__module__ == found.name:
                fields = inspect.get_annotations(kind)
                names = [name for name in vars(kind) if name[0] != "_" and name not in fields]
                each = {name: inspect.getattr_static(kind, name) for name in names}
                lacking += [
                    f"{found.name}.{kind.__name__}.{name}"
                    for name, own in each.items()
                    if (inspect.isroutine(own) or isinstance(own, property))
                    and not inspect.getdoc(getattr(kind, name))
                ]
    assert not lacking
