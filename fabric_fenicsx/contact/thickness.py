"""Thickness of plies of fabric between the faces that press them."""

import numpy as np

from ..energy.materials import fabric_of, sheets_of, thickness_shares
from ..energy.output import Value, last, total
from ..energy.term import SceneFacts
from ..material.laws.base import Law


class PlyThickness:
    """Fields in cells of fabric, NaN in others, to which each contact of a scene adds the thickness
    lost on its own faces.

    thickness [mm]: in place of the fabrics'; rigid: whether the contact's faces are, also those of
    fabric that has a `Compaction`, which contradicts the fabric, so that there are no fields.
    """

    def __init__(
        self, scene: SceneFacts, thickness: float | None = None, rigid: bool = False
    ) -> None:
        self._blank = blank = scene.blank
        self._flat, self._fibres = np.full((2, len(blank.areas())), np.nan)
        self._thickening, self._shares = np.zeros((2, len(self._flat)))
        self._fabrics: list[tuple[np.ndarray, Law]] = []
        for part in sheets_of(blank):
            if (fabric := fabric_of(scene, part)) and not (rigid and fabric.compaction):
                shares = thickness_shares(scene, part, blank.centres()[part.cells])
                self._shares[part.cells] = 1.0 if thickness else shares
                fabric = fabric.replace(thickness=thickness or fabric.thickness)
                self._fabrics.append((part.cells, fabric))
                self._flat[part.cells] = fabric.thickness_under(0.0)
                if fabric.compaction:
                    self._thickening[part.cells] = fabric.compaction.thickening
                if fabric.fibre_density is not None:
                    self._fibres[part.cells] = fabric.fibre_volume_fraction(1.0)

    def lost_under(self, pressure: float) -> np.ndarray:
        """Thickness that one face loses under a pressure [MPa] in each cell, (cells,) [mm]."""
        lost = np.zeros(len(self._fibres))
        for cells, fabric in self._fabrics:
            lost[cells] = (fabric.thickness_under(0.0) - fabric.thickness_under(pressure)) / 2
        return lost * self._shares * self._growth()

    def fields(self, lost: np.ndarray) -> dict[str, Value]:
        """Compaction and thickness [mm] and, where fibre densities are known, fibre volume fraction
        in cells. lost (cells,): thickness lost on the faces of one term [mm]."""
        if not self._fabrics:
            return {}
        values = {
            "compaction": total(np.where(np.isnan(self._flat), np.nan, lost), "mm"),
            "thickness_under_pressure": last(self._thickness, "mm"),
        }
        if any(fabric.fibre_density is not None for _, fabric in self._fabrics):
            values["fibre_volume_fraction"] = last(self._share_of_fibres, "-")
        return values

    def _thickness(self, fields):
        return self._flat * self._shares * self._growth() - fields["compaction"]

    def _growth(self):
        return self._blank.area_ratios() ** -self._thickening

    def _share_of_fibres(self, fields):
        fibres = self._fibres * self._shares
        return fibres / (self._thickness(fields) * self._blank.area_ratios())
