"""Compiled forms where other processes died while they compiled them."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.core.jit_cache import compiled

pytestmark = pytest.mark.versions


def test_a_form_whose_compilation_was_killed(tmp_path):
    """FFCx's own words and files."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    cells = np.array([[0, 1, 2]], dtype=np.int64)
    mesh = compat.create_mesh(MPI.COMM_SELF, cells, corners, "triangle", 1)
    asked = compat.jit(cache_dir=tmp_path, timeout=1)

    def area():
        form = compiled(mesh.comm, lambda: fem.form(1.0 * ufl.dx(mesh), **asked))
        return fem.assemble_scalar(form)

    assert np.isclose(area(), 0.5)
    (file,) = tmp_path.glob("*forms*.c")
    for other in tmp_path.glob(f"{file.stem}*"):
        if other != file:
            other.unlink()
    assert np.isclose(area(), 0.5)
