"""Materials by name or by file."""

import os
from collections.abc import Mapping
from pathlib import Path
from runpy import run_path
from types import MappingProxyType

from ..core.errors import InputError
from ..core.rules import repr_short, unknown_key
from .files import preset_or_file, read_toml
from .laws import LAWS, Law
from .laws.coupled import WovenFabric, Yarn

# Table 1
_YARN = Yarn(a=4130.0, b=667.5, d=0.65, p_min=0.75, c=23.67, s_T=1467.6, s_C=100.0)
_KOMEILI = WovenFabric(_YARN, _YARN, s1=25.06e-3, s2=-186.79e-3, s3=562.39e-3).replace(
    thickness=1.0, density=0.75, name="komeili", assumed=("d", "p_min", "s_C")
)
PRESETS: Mapping[str, WovenFabric] = MappingProxyType(
    {"komeili": _KOMEILI, "fabric": _KOMEILI.decoupled().replace(name="fabric")}
)


def load(source: str | os.PathLike[str]) -> Law:
    """Load a fabric by the name of a preset or from a material file.

    Raises InputError if there is neither a preset nor a file, and for errors in the file, by
    field.

    Parameters
    ----------
    source : str or path
        `komeili`, the fabric of the paper's Table 1; `fabric`, the same without couplings; or the
        path of a TOML file. That names its law, `law = "NAME"`, by default `coupled`;
        `model = "fabric"` is the same as `law = "tabulated"`.

    Returns
    -------
    Law

    Examples
    --------
    >>> fabric = ff.load("komeili")
    >>> fabric.thickness, fabric.warp.b  # [mm], [MPa]
    (1.0, 667.5)
    """
    return preset_or_file("material", source, PRESETS, _read)


def read_laws(path: str | os.PathLike[str]) -> None:
    """Run a Python file, so that `load` knows the laws whose classes are in it. Raises InputError
    if it cannot be run."""
    try:
        run_path(os.fspath(path), run_name=Path(path).stem)
    except Exception as error:
        raise InputError(
            f"law file {path} fails ({type(error).__name__}: {error}); expected one that runs"
        ) from error


def checked_fabric(name: str, fabric: object) -> Law:
    """`fabric` if it is one; InputError, which calls it `name`, for all else, as a preset's
    name."""
    if not isinstance(fabric, Law):
        raise InputError(
            f'{name} is {repr_short(fabric)}; expected a fabric, as of `load("komeili")`'
        )
    return fabric


def _read(path):
    def fabric(document):
        name = document.get("law", "tabulated" if document.get("model") == "fabric" else "coupled")
        if not isinstance(name, str) or name not in LAWS:
            known = unknown_key(name, LAWS, f"law {repr_short(name)}")
            raise InputError(f"{known}, and your own laws if imported, or by `--law-file`")
        return LAWS[name].from_document(document, Path(path).parent)

    return read_toml(path, fabric)
