"""All values that test curves measured, and how the law predicts them."""

from collections.abc import Sequence

import numpy as np

from ..material.friction import ShearFriction
from ..material.homogeneous import lateral_strain, nominal
from ..material.laws.coupled import WovenFabric
from .curves import Curve, Response


class Points:
    """The N values `measured` by the parts [(curve, response)], and the `peak` of the column of
    each (N,), its `component` and `strains` (N, 3), and `along` (N,): the yarns 0 or 1 that are
    pulled with free sides, else -1. friction: between yarns, which they move for the first time."""

    def __init__(
        self, parts: Sequence[tuple[Curve, Response]], friction: ShearFriction | None
    ) -> None:
        def joined(value):
            """A number of each part or of each of its points, (N,)."""
            return np.concatenate([np.broadcast_to(value(c, r), r.values.shape) for c, r in parts])

        self.measured = joined(lambda _, response: response.values)
        self.peak = joined(lambda _, response: response.peak)
        self.component = joined(lambda _, response: response.component)
        self.along = joined(lambda curve, _: -1 if curve.free is None else curve.free)
        self.strains = np.concatenate([curve.strains for curve, _ in parts])
        self._gain = joined(lambda _, response: response.gain)
        self._half = joined(lambda _, response: 0.0 if response.half is None else response.half)
        # (N, 4), of 1, s1, s2, s3: friction, or all of a simulated specimen
        linear = [np.zeros((len(r.values), 4)) if r.linear is None else r.linear for _, r in parts]
        self._linear, simulated = np.concatenate(linear), joined(lambda _, r: r.linear is not None)
        self._gain = np.where(simulated, 0.0, self._gain)
        if friction:
            at = np.flatnonzero((self.component == 2) & ~simulated)
            for share, gain in ((1.0, self._gain), (0.5, self._half)):
                rubbed = friction.respond(share * self.strains[at, 2], np.zeros(1)).stress
                self._linear[at, 0] += gain[at] * rubbed
        # points under free tension, and where to start the strain across
        places = {along: np.flatnonzero(self.along == along) for along in (0, 1)}
        self.free = {along: (at, np.zeros(at.size)) for along, at in places.items() if at.size}

    @property
    def angle(self) -> float:
        """Largest shear angle under a measured shear force [rad]."""
        return float(np.abs(self.strains[self.component == 2, 2]).max(initial=0.0))

    def predict(self, fabric: WovenFabric) -> np.ndarray:
        """The law's prediction of every measured value, (N,)."""
        strains, halves = self.strains.copy(), np.flatnonzero(self._half)
        for along, (points, start) in self.free.items():
            across = lateral_strain(fabric, along, strains[points, along], start)
            strains[points, 1 - along] = start[:] = across  # near that of the next parameters
        at_half = strains[halves] * [1, 1, 0.5]
        stress, N = nominal(fabric, np.concatenate([strains, at_half])), len(strains)
        across = np.where(self.along == 0, strains[:, 1], strains[:, 0])
        value = self._gain * np.column_stack([stress[:N], across])[np.arange(N), self.component]
        value[halves] += self._half[halves] * stress[N:, 2]
        return value + self._linear @ [1.0, fabric.s1, fabric.s2, fabric.s3]
