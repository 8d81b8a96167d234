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


LIGHT = {  # program -> modules that it does not load, as they take a second or need DOLFINx
    "import fabric_fenicsx.identification": "dolfinx mpi4py petsc4py ufl",
    "ff.Press.read('double_dome', ['blank.nx=4'])": "dolfinx mpi4py.MPI petsc4py",
    # Numba itself can't be asked for: dolfinx 0.9 imports it where it is installed
    "ff.BiasExtension(nx=4, element='P1', strain=0.01).job(steps=4).run(pictures=False)": (
        "fabric_fenicsx.runtime.compiled matplotlib gmsh scipy.signal"
    ),
}


@pytest.mark.parametrize("program", LIGHT)
def test_nothing_is_imported_before_it_is_used(program):
    code = (
        "import sys, fabric_fenicsx as ff\n"
        "before = {m for m in sys.modules if 'mpi4py' in m}  # which pip's DOLFINx wants first\n"
        f"{program}\nprint({{*{LIGHT[program].split()}}} & {{*sys.modules}} - before)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.endswith("set()\n"), done.stdout + done.stderr


def test_types_are_known_of_each_name():
    """What is imported for type checkers alone is all that the facade offers."""
    tree = ast.parse(Path(ff.__file__).read_text())
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    assert sorted(alias.name for line in typed.body for alias in line.names) == ff.__all__
