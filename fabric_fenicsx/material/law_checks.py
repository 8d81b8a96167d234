"""Checks of laws as users write them, and of numbers that may be in a wrong unit."""

from collections.abc import Iterable, Mapping

import numpy as np

from ..core.errors import InputError
from ..core.formatting import rounded
from ..core.rules import repr_short, unknown_key
from .energy import Energy

COUPLINGS = ("biaxial", "tension_shear", "compression_shear")


def check_couplings(names: object, label: str = "couplings") -> frozenset[str]:
    """The named couplings as a set, each one of `COUPLINGS`, spelled with "_", "-" or an en dash;
    otherwise an InputError that calls them `label`."""
    if isinstance(names, (str, Mapping)) or not isinstance(names, Iterable):
        raise InputError(
            f"{label} is {repr_short(names)}; allowed is a list of {', '.join(COUPLINGS)}"
        )
    couplings = {str(word).replace("-", "_").replace("–", "_") for word in names}
    for name in couplings.difference(COUPLINGS):
        raise unknown_key(name, COUPLINGS, f"{label}: coupling {repr_short(name)}")
    return frozenset(couplings)


def couples(law: Energy, name: str) -> bool:
    """True if the energy depends on two strains together where this coupling acts."""
    # strains at which this coupling alone gives the energy mixed derivatives
    strains = {
        "biaxial": [(0.02, 0.03, 0.0), (-0.02, 0.03, 0.0), (0.02, -0.03, 0.0)],
        "tension_shear": [(0.02, 0.03, 0.3)],
        "compression_shear": [(-0.02, -0.03, 0.3)],
    }[name]
    second = Energy.derivatives(law, *np.transpose(strains)).second
    mixed = second[1:2] if name == "biaxial" else second[3:5]
    return bool(abs(mixed).max() > 1e-9 * abs(second).max())


def check_rest(law: Energy) -> None:
    """InputError where the fabric as it lies, without strain, has energy or stress, or a negative
    stiffness."""
    rest = Energy.derivatives(law, *np.transpose([(0.0, 0.0, 0.0), (0.01, 0.01, 0.1)]))
    beside = Energy.derivatives(law, *np.array(3 * [[-1e-9, 1e-9]])).second  # sides of a kink
    stiffness = np.nanmax(abs(rest.second[[0, 2, 5]]), 1, initial=0.0)
    names = "energy", "stress sigma_a", "stress sigma_b", "stress tau"
    values, limits = [rest.parts[0].sum(), *rest.first[:, 0]], [1e-9 * stiffness.max()]
    flaws = [
        f"{name} of law {law.law} is {value:.3g} MPa in fabric as it lies, without strain; allowed "
        "is 0: take off what it is there"
        for name, value, limit in zip(names, values, [*limits, *(1e-5 * stiffness)])
        if not abs(value) <= limit
    ]
    least = beside[[0, 2, 5]].min(1)
    flaws += [
        f"stiffness of law {law.law} along {name} is {rounded(value)} MPa in fabric as it lies, "
        "without strain; allowed is 0 or more: look at its signs"
        for name, value, scale in zip(("eps_a", "eps_b", "gamma"), least, stiffness)
        if value < -1e-6 * scale
    ]
    for flaw in flaws[:1]:
        raise InputError(f"the {flaw}")


def implausible(label: str, values: Mapping[str, float | None]) -> list[str]:
    """A sentence on each value {name: value}, of a material `label`, that fabrics hardly have."""
    # what fabrics have, widely taken; beyond it a unit is probably wrong
    plausible = {
        "thickness": (0.01, 20.0, "mm"),
        "density": (0.05, 10.0, "g/cm3"),
        "fibre_density": (0.8, 10.0, "g/cm3"),
        "fibre_share": (0.1, 1.0, "of the mass"),
        **{f"b of {yarn}": (1.0, 1e5, "MPa") for yarn in ("yarns", "warp", "weft")},
        "s1": (1e-4, 10.0, "MPa"),
        "stiffness along a": (2.0, 2e5, "MPa"),
        "stiffness along b": (2.0, 2e5, "MPa"),
        "stiffness in shear": (1e-4, 10.0, "MPa"),
    }
    doubts = []
    for name, value in values.items():
        low, high, unit = plausible[name]
        if value is not None and not low <= value <= high:
            fabrics = f"fabrics have {low:g} to {high:g}; look at its unit"
            doubts.append(f"{name} of material {label} is {value:g} {unit}, {fabrics}")
    return doubts
