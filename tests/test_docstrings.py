"""Each name of the facade has an example in its docstring, and the examples print what they say."""

import doctest

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
