"""What a result may have at most to be believed."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..material.strains import SHORTENED
from ..runtime.fields import check_fields, number
from ..runtime.formatting import percent
from ..runtime.rules import POSITIVE

GROUP = "limits, beyond which a result is not believed (exit status 3)"  # of options
EDGES = 1e-2  # of the area, in which yarns at singular points may be stretched further


@dataclass(frozen=True)
class Limits:
    """Largest values of a result that is believed, all as shares: 0.05 is 5 %.

    - imbalance: difference between external work and energies, over these
    - viscous: energy that regularisation took, over the strain energy
    - penetration: of tools into the sheet in any state in equilibrium, over its thickness
    - strain: nominal strain of yarns in tension, in all but `EDGES` of the area
    - shortening: area of a sheet in space in which compression shortens yarns by more than
      `SHORTENED`, over all of it: a membrane does so where a real ply wrinkles
    - located: forces of supports that only locate the sheet, over all forces from outside

    Raises InputError for a limit that is not above 0.
    """

    imbalance: float = number(
        0.05, POSITIVE, "difference between external work and energies, over these", GROUP
    )
    viscous: float = number(
        0.05, POSITIVE, "energy that regularisation took, over the strain energy", GROUP
    )
    penetration: float = number(
        0.1, POSITIVE, "penetration of tools into the sheet, over its thickness", GROUP
    )
    strain: float = number(
        0.1,
        POSITIVE,
        "nominal strain of yarns in tension, singular points at edges left out",
        GROUP,
    )
    shortening: float = number(
        0.05,
        POSITIVE,
        "area in which compression shortens yarns by more than 2 %, over the sheet's: a real ply "
        "wrinkles there",
        GROUP,
    )
    located: float = number(
        0.05, POSITIVE, "forces of supports that only locate, over all from outside", GROUP
    )

    def __post_init__(self) -> None:
        check_fields(self, "`Limits.{}`".format)

    def exceeded(self, found: Mapping[str, float]) -> list[str]:
        """What is wrong with a result, one sentence for each limit that is exceeded; found: values
        under the names above, without strain."""
        words = {
            "imbalance": "work of supports and tools differs from the energies by {} of these",
            "viscous": "regularisation took {} of the strain energy",
            "penetration": "the sheet is penetrated by {} of its thickness",
            "shortening": "compression shortens yarns by more than "
            f"{percent(SHORTENED)} in {{}} of the area, where a real ply wrinkles",
            "located": "supports that only locate the sheet bear {} of the forces on it",
        }

        def told(name, value):
            limit = getattr(self, name)
            # as many digits as tell the two apart
            texts = [(percent(value, n), percent(limit, n)) for n in (3, 6, 17)]
            mine, allowed = next((pair for pair in texts if pair[0] != pair[1]), texts[-1])
            return f"{words[name].format(mine)}; allowed is {allowed} (`Limits.{name}`)"

        return [
            told(name, value) for name, value in found.items() if not value <= getattr(self, name)
        ]
