"""What `import fabric_fenicsx as ff` offers."""

import subprocess
import sys

import pytest

import fabric_fenicsx as ff


@pytest.mark.parametrize("name", ff.__all__)
def test_each_name_is_there(name):
    assert getattr(ff, name).__module__.startswith("fabric_fenicsx")
    assert name in dir(ff)


def test_another_name_is_not():
    with pytest.raises(AttributeError, match="no attribute Membrain"):
        ff.Membrain  # noqa: B018


def test_nothing_is_imported_before_it_is_used():
    code = (
        "import sys, fabric_fenicsx; print([m for m in ('dolfinx', 'numpy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr
