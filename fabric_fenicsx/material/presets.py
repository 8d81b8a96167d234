"""Materials by name or by file."""

import os
from collections.abc import Mapping
from types import MappingProxyType

from ..errors import InputError
from .baseline import Fabric, TabulatedFabric
from .parameters import WovenFabric, from_document, read_toml, shown

_KOMEILI = WovenFabric.balanced(  # Table 1
    a=4130.0, b=667.5, d=0.65, p_min=0.75, c=23.67, s_T=1467.6, s_C=100.0,
    s1=25.06e-3, s2=-186.79e-3, s3=562.39e-3, thickness=1.0, density=0.75, name="komeili",
)  # fmt: skip
PRESETS: Mapping[str, WovenFabric] = MappingProxyType(
    {"komeili": _KOMEILI, "fabric": _KOMEILI.decoupled().replace(name="fabric")}
)


def load(source: str | os.PathLike[str]) -> Fabric:
    """The preset of this name, else the material in the TOML file at this path; InputError if neither exists.

    A `WovenFabric`, or with `model = "fabric"` in the file a `TabulatedFabric`.
    """
    if isinstance(source, str) and source in PRESETS:
        return PRESETS[source]
    if isinstance(source, (str, os.PathLike)) and os.path.exists(source):
        return read_toml(
            source,
            lambda document: (
                TabulatedFabric.from_toml(source, document)
                if document.get("model") == "fabric"
                else WovenFabric(**from_document(document))
            ),
        )
    raise InputError(f"material {shown(source)} is neither a preset ({', '.join(PRESETS)}) nor a file that exists")
