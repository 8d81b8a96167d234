"""Criteria that a converged step must meet: each returns the reason for a rejection, or ""."""

from collections.abc import Mapping

from ..core.formatting import percent, share

UNBALANCED = 0.02  # of the energies, above which a run warns that its work does not match
MAX_MISSING = 0.1  # of all work, at full load


def off_path(deviation: float, accuracy: float | None) -> str:
    """Criterion of a straight path. deviation: distance of the state from the linear extrapolation,
    over the displacement's norm; twice the `accuracy` is allowed, None: any."""
    if accuracy and deviation > 2 * accuracy:
        return f"the step leaves the path by more than the accuracy of {accuracy:g} allows"
    return ""


def missing_work(work: float, rise: float, stored: float, contact: float) -> float:
    """The share of a step's `work` that is missing from the `rise` of the energies. They are
    compared with the largest of both, of a tenth of the energies `stored` before, and of contact's:
    what contact lags may be off by a hundredth before and after the step. All in N mm."""
    scale = max(abs(work), abs(rise), 0.1 * abs(stored), abs(contact))
    return share(abs(work - rise), scale)


def total_imbalance(work: float, energy: float, load: float) -> str:
    """Criterion of the energy balance since the start: all `work` and `energy` [N mm] differ by at
    most `MAX_MISSING` of what they are at full load, if they grow as the load does."""
    missing = share(abs(work - energy), max(abs(work), abs(energy)))
    if missing * load <= MAX_MISSING:
        return ""
    return f"{percent(missing, 3)} of all work is not in the energies"


def negative_bending(energies: Mapping[str, float]) -> str:
    """Criterion of bending, whose energy cannot be below 0. energies: by kind [N mm]."""
    bending = energies.get("bending", 0.0)
    if bending >= -1e-9 * sum(abs(each) for each in energies.values()):
        return ""
    return f"bending has an energy of {bending:.3g} N mm, below 0"


def imbalance(missing: float, allowed: float | None) -> str:
    """Criterion of the energy balance: `missing_work` is at most `allowed` (None: any)."""
    if not allowed or missing <= allowed:
        return ""
    lost = f"{percent(missing, 3)} of the step's work is not in the energies"
    return f"{lost}; allowed is {percent(allowed, 6)}"
