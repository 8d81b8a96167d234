"""What a converged step must pass to be accepted: each judge gives a reason against it, or ""."""

from dataclasses import dataclass

from ..runtime.formatting import percent

SMALL_WORK = 0.1  # of the energies, below which a step's work is not what its balance is of
FINEST = 8  # of these make the largest step; smaller ones are not judged by their balance


@dataclass(frozen=True)
class StraightPath:
    """A state lies near the straight continuation of the path: at most twice `accuracy` off, over
    its displacement. None: anywhere."""

    accuracy: float | None

    def objection(self, deviation: float) -> str:
        """deviation: distance from the continuation over the displacement's norm."""
        if self.accuracy and deviation > 2 * self.accuracy:
            return f"the step leaves the path by more than the accuracy of {self.accuracy:g} allows"
        return ""


@dataclass(frozen=True)
class EnergyBalance:
    """At most the share `allowed` of a step's work is missing from the energies. None: any.

    Steps below 1/`FINEST` of the `largest` are not judged: what is lost in a snap is missing with
    any step.
    """

    allowed: float | None
    largest: float

    def objection(
        self, taken: float, work: float, rise: float, stored: float, contact: float
    ) -> str:
        """taken: the step's load factor; work done in it, rise of the energies, what these were
        before, and contact's energy [N mm]: as much may do, as what contact holds during a solve
        may be off by a hundredth before and after the step."""
        if not self.allowed or taken <= 1.5 * self.largest / FINEST:
            return ""
        scale = max(abs(work), abs(rise), SMALL_WORK * abs(stored), abs(contact), 1e-300)
        missing = abs(work - rise) / scale
        if missing <= self.allowed:
            return ""
        return (
            f"{percent(missing, 3)} of the step's work is not in the energies; allowed is "
            f"{percent(self.allowed, 6)}"
        )
