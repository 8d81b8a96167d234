"""Coulomb friction between two sheets, as an incremental potential."""

import numpy as np

from ...runtime.errors import InputError
from ..term import SceneFacts, Term, Triplets
from .sheet_contact import LAG, Facing, SheetContact
from .slipping import elastic, potential, stiffness, tangent, traction, turned


class SheetFriction(Term):
    """Friction of coefficient `mu` at the points of a `SheetContact` of the same two sheets.

    As with `Friction` on tools, relative displacement since the last accepted state, in the plane
    that was tangent then, adds to an elastic slip. Beyond `slip` [mm] it takes the energy mu P per
    length. Forces act on the `Pairs` of the last accepted state. lag: as in `Friction`.

    Raises InputError for numbers out of range, and if not exactly one term of the scene is the
    contact of these sheets.
    """

    energy_kind = "friction"

    def __init__(
        self, lower: str, upper: str, mu: float, slip: float = 0.1, lag: float | None = LAG
    ) -> None:
        self.sheets, self.mu, self.slip, self.lag = (lower, upper), mu, slip, lag
        self.name = f"friction of {lower} and {upper}"
        if not (np.isfinite(mu) and mu >= 0):
            raise InputError(f"{self.name} has coefficient {mu}; allowed is a number from 0")
        for name, value in (("slip", slip), ("lag", lag)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"{self.name} has {name} {value}; allowed is a number above 0")

    def set_up(self, scene: SceneFacts) -> None:
        """As in `Term`."""
        found = [
            term
            for term in scene.terms
            if isinstance(term, SheetContact) and set(term.sheets) == set(self.sheets)
        ]
        if len(found) != 1:
            raise InputError(
                f"{self.name} finds {len(found)} terms that are the contact of these sheets; "
                "allowed is one"
            )
        (self._contact,) = found
        self._contact.bind(scene)
        self._from: Facing = self._contact.facing()
        count = self._contact.count
        self._taken = np.zeros(count)  # of energy in accepted states
        self._z, self._limit = np.zeros((count, 3)), np.zeros(count)
        self._start()

    # -- load steps

    def at(self, load: float) -> None:
        """Go back to the normal forces of the last accepted state."""
        self._limit = self._accepted_limit

    def accept(self) -> None:
        """Keep the elastic part of the slip. Energy that changes because normal forces do counts
        as taken."""
        z = self._slipped()
        self._taken = self._taken + potential(z, self._limit, self.slip)
        self._z = elastic(z, self.slip)
        self._start()
        self._taken -= potential(self._z, self._limit, self.slip)

    def update_lagged(self) -> bool:
        """Take the present normal forces, if they differ by more than allowed; whether they did."""
        if self.lag is None:
            return False
        now = self.mu * self._contact.normal_forces()
        changed, total = self.blank.mesh.comm.allreduce(
            np.array([abs(now - self._limit).sum(), now.sum()])
        )
        if changed <= self.lag * total:
            return False
        self._limit = now
        return True

    def cell_memory(self) -> dict[str, np.ndarray]:
        """Elastic slip (cells, 3 points) [mm] and energy taken (cells, points) [N mm] when last
        accepted."""
        energy = self._taken + potential(self._z, self._limit, self.slip)
        rows = self._contact.among_cells
        return {"slip": rows(self._z), "energy": rows(energy)}

    def recall(self, memory: dict[str, np.ndarray]) -> None:
        """As in `Term`."""
        self._z, self._taken = (self._contact.of_points(memory[k]) for k in ("slip", "energy"))
        self._from = self._contact.facing()
        self._limit = np.zeros(self._contact.count)  # until `accept`

    def _start(self):
        """Take places, normals and normal forces as they are, and turn the slip with them."""
        self._contact.accept()  # before this one, in whatever order they are given
        self._from = self._contact.facing()
        self._normal = np.zeros((self._contact.count, 3))
        gradient = self._from.normal
        self._normal[self._from.points] = gradient / np.linalg.norm(gradient, axis=1)[:, None]
        self._limit = self._accepted_limit = self.mu * self._contact.normal_forces()
        self._z = turned(self._z, self._limit, self._normal)
        self.pattern += 1

    def _slipped(self):
        moved = np.zeros_like(self._z)
        moved[self._from.points] = self._from.moved()
        return self._z + tangent(moved, self._normal)

    # -- energy, forces, stiffness

    def stored(self) -> float:
        """Energy taken by this rank's points, elastic and dissipated [N mm]."""
        return float((self._taken + potential(self._slipped(), self._limit, self.slip)).sum())

    def add_forces(self, f: np.ndarray) -> None:
        """As in `Term`."""
        forces = traction(self._slipped(), self._limit, self.slip)
        self._from.flat.add(forces[self._from.points], f)

    def tangent(self) -> Triplets:
        """As in `Term`."""
        blocks = stiffness(self._slipped(), self._limit, self._normal, self.slip)
        pairs = self._from.flat
        return pairs.rows, pairs.cols, pairs.values(blocks[self._from.points])
