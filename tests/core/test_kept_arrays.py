"""What is kept on the disk: of files, and of compiled forms."""

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI

from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.core.cache_folders import kept_arrays
from fabric_fenicsx.core.jit_cache import compiled


def test_what_was_made_of_a_file_is_kept_until_it_changes(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file, calls = tmp_path / "model", []

    def make():
        calls.append(file.read_text())
        return np.arange(3.0), np.array([[len(calls)]])

    file.write_text("a")
    first, again = kept_arrays(file, 0.1, make), kept_arrays(file, 0.1, make)
    assert calls == ["a"]
    assert [each.tolist() for each in again] == [each.tolist() for each in first]
    kept_arrays(file, 0.2, make)
    file.write_text("b")
    changed = kept_arrays(file, 0.1, make)
    assert calls == ["a", "a", "b"] and changed[1] == 3
    files = [*tmp_path.rglob("*.npz")]  # a damaged or closed cache is made do without
    for damaged in (b"", b"no arrays", files[0].read_bytes()[:60]):
        for kept in files:
            kept.write_bytes(damaged)
        assert kept_arrays(file, 0.1, lambda: (np.zeros(2),))[0].tolist() == [0, 0]
    (tmp_path / "no folder").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "no folder"))
    assert kept_arrays(file, 1, lambda: (np.zeros(2),))[0].tolist() == [0, 0]


@pytest.mark.versions
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
