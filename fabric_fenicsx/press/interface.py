"""How sheets and tools touch: friction, and how stiff the faces are."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..contact.coulomb import Coulomb
from ..core.fields import KnowsItsFields, documented, flag, quantity
from ..core.rules import FROM_ZERO, POSITIVE
from ..io.field import Field, of_place
from ..sheet.sheet import Sheet


@documented
@dataclass(frozen=True, kw_only=True)
class Interface(KnowsItsFields):
    """Contact of sheets with tools and with one another.

    Coefficients may be a `Field` of the place x, y, z where a tool is touched, as it stands at
    first; of sheets on sheets see `Sheet.friction`. Forces between sheets may lag more. `penalty`
    makes faces of fabric rigid.

    Examples
    --------
    >>> ff.Interface(friction=0.2).metal_friction
    0.1
    """

    friction: float | Field = quantity(
        0.25, of_place(FROM_ZERO, "xyz"), "coefficient between fabric and tools"
    )
    metal_friction: float | Field = quantity(
        0.1, of_place(FROM_ZERO, "xyz"), "coefficient between metal and tools", "tools"
    )
    slip: float | None = quantity(
        None, POSITIVE, "elastic slip while a sheet sticks, by default of each pair [mm]"
    )
    lag: float = quantity(
        0.0005,
        POSITIVE,
        "share of normal forces, and of areas under the holder, that may lag behind the state",
    )
    penalty: float | None = quantity(
        None,
        POSITIVE,
        "stiffness of contact with rigid faces (by default fabric is compacted) [N/mm^3]",
    )
    self: bool = flag("let each sheet touch itself where a fold closes")

    @property
    def is_rigid(self) -> bool:
        """Whether fabric keeps its thickness under pressure."""
        return bool(self.penalty)

    @property
    def lag_of_faces(self) -> float:
        """Share of the forces between sheets by which those of their faces may differ: laminates
        do not settle with as little as friction allows."""
        return 20 * self.lag

    def coulomb(self, coefficient: float | Field | Mapping[str, float | Field]) -> Coulomb:
        """Friction with this coefficient, or with one for each sheet {name: coefficient}."""
        return Coulomb(coefficient, self.slip, self.lag)

    def on_tools(self, sheets: Sequence[Sheet]) -> Coulomb:
        """Friction of the sheets on tools; for each sheet separately if one is of metal."""
        if not any(sheet.metal for sheet in sheets):
            return self.coulomb(self.friction)
        if len(sheets) == 1:
            return self.coulomb(self.metal_friction)
        by_kind = {True: self.metal_friction, False: self.friction}
        return self.coulomb({sheet.name: by_kind[bool(sheet.metal)] for sheet in sheets})
