"""Folders for caches of compiled code and of plotting, also where the home can't be written."""

import hashlib
import io
import os
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar
from zipfile import BadZipFile

from .files import replace_file

T = TypeVar("T", bound=tuple)
RANK = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID")  # known without MPI
moved: Path | None = None  # the folder in place of the home's


def is_first() -> bool:
    """Whether this is the first rank or the only one, as far as that is known without MPI."""
    return all(os.getenv(name, "0") == "0" for name in RANK)


def cache() -> Path:
    """The folder of caches: XDG_CACHE_HOME, or .cache in the home."""
    return Path(os.getenv("XDG_CACHE_HOME") or Path.home() / ".cache")


def ensure_cache() -> None:
    """Let XDG_CACHE_HOME be a temporary folder of this user from here on if nothing can be written
    in `cache`; rank 0 warns."""
    global moved
    try:
        _make(cache() / "fenics")
        return
    except RuntimeError:  # a user without an entry in the system, as in a container
        wrong, home = "this user has no home", None
    except OSError as error:
        wrong, home = f"{error.filename} can't be written ({error.strerror})", Path.home()
    try:
        folder = Path(tempfile.gettempdir()) / f"fabric_fenicsx_{os.getuid()}"
        _make(folder / "fenics")
        if folder.stat().st_uid != os.getuid():  # code is loaded from it
            raise PermissionError
        kept, moved = f"compiled code is kept in {folder}", folder
        os.environ |= {"XDG_CACHE_HOME": str(folder), "MPLCONFIGDIR": str(folder)}
        if home is None:  # DOLFINx needs one
            os.environ["HOME"] = str(folder)
        elif _is_closed(Path(os.getenv("XDG_CONFIG_HOME") or home / ".config")):
            os.environ["XDG_CONFIG_HOME"] = str(folder)
    except OSError:
        kept = "nor is there a temporary folder for compiled code"
    if is_first():
        text = f"warning: {wrong}; {kept}; XDG_CACHE_HOME=FOLDER chooses another folder"
        print(text, file=sys.stderr, flush=True)


def kept_arrays(file: Path, how: object, make: Callable[[], T]) -> T:
    """The arrays that make() makes of a file. They are kept in the cache for a file of the same
    content and the same text of `how`, which says all else that they depend on."""
    import numpy as np  # the start of the package does without

    key = hashlib.sha256(file.read_bytes() + str(how).encode()).hexdigest()
    place = cache() / "fabric_fenicsx" / "arrays" / f"{key}.npz"
    with suppress(OSError, ValueError, BadZipFile), np.load(place) as known:
        return tuple(known[name] for name in known.files)  # type: ignore[return-value]
    arrays, content = make(), io.BytesIO()
    np.savez(content, *arrays)
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        replace_file(place, content.getvalue())
    return arrays


def _make(folder):
    """Make a folder; PermissionError if nothing can be written in it."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(13, "Permission denied", str(folder))


def _is_closed(folder):
    """True where DOLFINx fails when it looks for its options; it copes with missing ones."""
    try:
        (folder / "dolfinx").stat()
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False
