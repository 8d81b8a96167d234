"""What a result may have at most to be believed."""

from collections.abc import Mapping
from dataclasses import dataclass, field

EDGES = 1e-2  # of the area, in which yarns at singular points may be stretched further


def _limit(default: float, text: str) -> float:
    return field(default=default, metadata={"help": text})


@dataclass(frozen=True)
class Limits:
    """Largest values of a result that is believed."""

    imbalance: float = _limit(0.05, "difference between external work and energies, over these")
    viscous: float = _limit(0.05, "energy that regularisation took, over the strain energy")
    penetration: float = _limit(0.1, "penetration of tools into the sheet, over its thickness")
    strain: float = _limit(
        0.1, "nominal strain of yarns in tension, singular points at edges left out"
    )

    def exceeded(self, found: Mapping[str, float]) -> list[str]:
        """What is wrong with a result, one sentence for each limit that is exceeded; found: values
        under the names above, without strain."""
        words = {
            "imbalance": "work of supports and tools differs from the energies "
            "by {:.3g} % of these",
            "viscous": "regularisation took {:.3g} % of the strain energy",
            "penetration": "the sheet is penetrated by {:.3g} % of its thickness",
        }
        return [
            f"{words[name].format(100 * value)}; allowed is "
            f"{100 * getattr(self, name):.3g} % (`Limits.{name}`)"
            for name, value in found.items()
            if not value <= getattr(self, name)
        ]
