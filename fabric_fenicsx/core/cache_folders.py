"""The folder of compiled code and of files that are reread only if they changed."""

import hashlib
import io
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar
from zipfile import BadZipFile

from .files import replace_file

T = TypeVar("T", bound=tuple)
RANK = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK", "SLURM_PROCID")  # known without MPI


def is_first() -> bool:
    """Whether this is the first rank or the only one, as far as that is known without MPI."""
    return all(os.getenv(name, "0") == "0" for name in RANK)


def cache() -> Path:
    """The folder of caches: XDG_CACHE_HOME, or .cache in the home."""
    return Path(os.getenv("XDG_CACHE_HOME") or Path.home() / ".cache")


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
