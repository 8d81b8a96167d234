"""Caches go where something can be written."""

import os
import subprocess
import sys

import pytest

from fabric_fenicsx.runtime import cache_folders

PLACES = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR", *cache_folders.RANK)


@pytest.fixture
def places(tmp_path, monkeypatch):
    """Sets where home and temporary files are; what was set before is back after the test."""
    monkeypatch.setattr(cache_folders, "moved", None)
    monkeypatch.setattr(os, "environ", {k: v for k, v in os.environ.items() if k not in PLACES})
    monkeypatch.setattr(cache_folders.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(
        cache_folders.os, "getenv", lambda name, other=None: os.environ.get(name, other)
    )
    return lambda **given: os.environ.update(given)


def test_a_home_that_can_be_written_has_the_cache(places, tmp_path, capsys):
    places(HOME=str(tmp_path))
    cache_folders.ensure_cache()
    assert cache_folders.cache() == tmp_path / ".cache"
    assert (tmp_path / ".cache/fenics").is_dir()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", ["HOME", "XDG_CACHE_HOME"])
def test_a_home_that_cannot_be_written_is_told_with_the_place_used(places, tmp_path, capsys, name):
    (tmp_path / "file").touch()
    places(**{"HOME": str(tmp_path), name: str(tmp_path / "file")})
    cache_folders.ensure_cache()
    folder = tmp_path / f"fabric_fenicsx_{os.getuid()}"
    assert cache_folders.cache() == folder
    told = capsys.readouterr().err
    assert told.startswith(f"warning: {tmp_path / 'file'}")
    assert f"compiled code is kept in {folder}; XDG_CACHE_HOME=FOLDER chooses" in told


def test_a_user_without_a_home_gets_one(places, tmp_path, capsys, monkeypatch):
    def no_home():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(cache_folders.Path, "home", no_home)
    cache_folders.ensure_cache()
    assert os.environ["HOME"] == str(cache_folders.cache())
    assert "this user has no home" in capsys.readouterr().err


def test_other_ranks_are_silent(places, tmp_path, capsys):
    places(HOME=os.devnull, OMPI_COMM_WORLD_RANK="1")
    cache_folders.ensure_cache()
    assert capsys.readouterr().err == ""


@pytest.mark.versions
# mpi4py comes first: pip's DOLFINx finds MPI through it.
@pytest.mark.parametrize(
    "before", ["", "import mpi4py.MPI, os, dolfinx; os.environ['HOME'] = os.devnull; "]
)
def test_forms_are_compiled_without_a_home(tmp_path, hang, before):
    words = before + "import fabric_fenicsx as ff; b = ff.Blank.rectangle(2, 1, nx=1); "
    words += "ff.Scene(b, [ff.Membrane(ff.load('komeili'))], ff.clamped_ends(1.0))"
    places = os.environ | {"HOME": str(tmp_path) if before else os.devnull, "TMPDIR": str(tmp_path)}
    for name in PLACES[1:]:
        places.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-c", words], env=places, capture_output=True, text=True, timeout=hang
    )
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.glob("fabric_fenicsx_*/fenics/*.so"))
