"""Criteria that a converged step must meet: each returns the reason for a rejection, or ""."""

from ..core.formatting import percent, share

UNBALANCED = 0.02  # of the energies, above which a run warns that its work does not match


def off_path(deviation: float, accuracy: float | None) -> str:
    """Criterion of a straight path. deviation: distance of the state from the linear extrapolation,
    over the displacement's norm; twice the `accuracy` is allowed, None: any."""
    if accuracy and deviation > 2 * accuracy:
        return f"the step deviates from the path by more than the accuracy of {accuracy:g}"
    return ""


def missing_work(work: float, rise: float, stored: float, contact: float) -> float:
    """The share of a step's `work` that is missing from the `rise` of the energies. They are
    compared with the largest of both, of a tenth of the energies `stored` before, and of contact's:
    what contact lags may be off by a hundredth before and after the step. All in N mm."""
    scale = max(abs(work), abs(rise), 0.1 * abs(stored), abs(contact))
    return share(abs(work - rise), scale)


def imbalance(missing: float, allowed: float | None) -> str:
    """Criterion of the energy balance: `missing_work` is at most `allowed` (None: any)."""
    if not allowed or missing <= allowed:
        return ""
    lost = f"{percent(missing, 3)} of the step's work is missing from the energies"
    return f"{lost}; expected {percent(allowed, 6)}"
