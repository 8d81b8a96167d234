"""What `import fabric_fenicsx as ff` offers."""

import subprocess
import sys
from importlib import import_module

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


def test_rooms_are_found_by_earlier_names():
    with pytest.warns(DeprecationWarning, match="mechanics.shell.bending is .*energy.bending now"):
        from fabric_fenicsx.mechanics.shell.bending import Bending  # type: ignore
    assert Bending is ff.Bending
    with pytest.raises(ModuleNotFoundError, match="core.nothing"):
        import_module("fabric_fenicsx.runtime.nothing")


def test_another_name_is_an_attribute_error():
    assert not hasattr(ff, "tensile") and ff.__version__
