"""Identification is a room of its own: it needs no DOLFINx."""

import subprocess
import sys


def test_identification_needs_no_dolfinx():
    code = (
        "import sys, fabric_fenicsx.identification\n"
        "print([m for m in ('dolfinx', 'mpi4py', 'petsc4py', 'ufl') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stdout + done.stderr
