"""Units in files: powers of ten to the package's own, mm, MPa, g/cm3, rad."""

import math

# kind -> unit -> power of ten to the first one of its kind, which is the package's own
UNITS = {
    "stress": {"MPa": 0, "kPa": -3, "Pa": -6, "GPa": 3},
    "length": {"mm": 0, "cm": 1, "m": 3, "um": -3},
    "density": {"g/cm3": 0, "kg/m3": -3},
    "areal_weight": {"g/m2": 0, "kg/m2": 3},
    "bending_stiffness": {"Nmm": 0, "Nm": 3},
    "curvature": {"1/mm": 0, "1/m": -3},
    "line_moment": {"N": 0, "mN": -3, "Nmm/mm": 0},
}
OWN = {kind: next(iter(known)) for kind, known in UNITS.items()}  # the package's own units
DEG = math.pi / 180
ANGLE = {"rad": 1.0, "deg": DEG}
STRAIN = {"-": 1.0, "%": 0.01}
# what tests reach, [-] or [rad]: outside, fractions were taken for percent or radians for degrees
REACH = {"eps": (5e-4, 0.5), "gamma": (1.6 * DEG, 85 * DEG)}
PER_WIDTH = {"N/mm": 1.0, "N/m": 1e-3, "kN/m": 1.0}


def factors(kind: str) -> dict[str, float]:
    """Factor from each unit of a kind to the package's own."""
    return {unit: float(f"1e{power}") for unit, power in UNITS[kind].items()}


def stresses(thickness: float) -> dict[str, float]:
    """Factor to MPa from each unit of a stress, and of a force per width of a sheet of `thickness`
    [mm]."""
    per_width = {unit: factor / thickness for unit, factor in PER_WIDTH.items()}
    return factors("stress") | {"N/mm2": 1.0} | per_width


def suffixes(kind: str) -> dict[str, int]:
    """Powers of ten of a kind's units, as they stand at the end of a key: g_per_cm3 for g/cm3."""
    return {unit.replace("/", "_per_"): power for unit, power in UNITS.get(kind, {}).items()}
