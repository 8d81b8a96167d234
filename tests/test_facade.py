"""What `import fabric_fenicsx as ff` offers."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import fabric_fenicsx as ff

pytestmark = pytest.mark.versions


def test_each_name_is_there():
    assert {*ff.__all__} <= {*dir(ff)}
    elsewhere = [n for n in ff.__all__ if not getattr(ff, n).__module__.startswith(ff.__name__)]
    assert not elsewhere


def test_fits_need_no_dolfinx():
    code = "import sys, fabric_fenicsx.identification as fit; fit.identify; print([*sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "scipy.optimize" in done.stdout and "petsc4py" not in done.stdout, done.stderr


def test_types_are_known_of_each_name():
    """What is imported for type checkers alone is all that the facade offers."""
    tree = ast.parse(Path(ff.__file__).read_text())
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    assert sorted(alias.name for line in typed.body for alias in line.names) == ff.__all__
