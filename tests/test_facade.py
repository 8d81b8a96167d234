"""The facade `fabric_fenicsx`: its names, and their examples."""

import doctest
import subprocess
import sys

import numpy as np
import pytest

import fabric_fenicsx as ff

pytestmark = pytest.mark.versions


def test_each_name_is_there():
    assert {*ff.__all__} <= {*dir(ff)} and ff.__version__ and not hasattr(ff, "tensile")
    elsewhere = [n for n in ff.__all__ if not getattr(ff, n).__module__.startswith(ff.__name__)]
    assert not elsewhere


def test_fits_need_no_dolfinx():
    code = "import sys, fabric_fenicsx.identification as fit; fit.identify; print([*sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "identification.problem" in done.stdout and "petsc4py" not in done.stdout, done.stderr


def test_what_takes_long_to_import_is_left_out(tmp_path):
    """PyVista, asyncio, and on Debian 12 setuptools' pkg_resources, which then does as usual."""
    code = """
import sys, fabric_fenicsx as ff
ff.Tensile(nx=2).job(steps=1).run("out", pictures=False, overwrite=True)
print({"pyvista.core", "asyncio", "pkg_resources.extern"} & {*sys.modules})
if "pkg_resources" in sys.modules:
    import pkg_resources
    assert pkg_resources.parse_version("10.0") > pkg_resources.parse_version("9.0")
"""
    how = {"capture_output": True, "text": True, "cwd": tmp_path}
    for _ in range(2):  # the first may compile, which imports it
        done = subprocess.run([sys.executable, "-c", code], **how)
    assert done.stdout.splitlines()[-1:] == ["set()"], done.stdout + done.stderr


FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.REPORT_ONLY_FIRST_FAILURE


def examples(name):
    """Doctests of a name and of its methods that have one, the name's own first."""
    how = {"module": False, "globs": {"ff": ff, "np": np}}
    found = doctest.DocTestFinder().find(getattr(ff, name), f"ff.{name}", **how)
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
