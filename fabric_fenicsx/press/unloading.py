"""Unloading of formed sheets: their springback without the tools."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from mpi4py import MPI

from ..contact.contact_term import PlyThickness
from ..contact.sheet_contact import FaceContact, SheetContact
from ..core.errors import InputError
from ..core.formatting import rounded
from ..energy.fabric_states import KIND
from ..energy.load import RELEASED, Gravity, ReleaseForces
from ..energy.materials import fabric_of, materials_of
from ..energy.output import Value
from ..energy.term import SceneFacts, overrides
from ..job.job import Job, Result
from ..job.setup import Setup
from ..scene.rigid_motions import isostatic, planes_of_symmetry
from ..scene.scene import OF_CELLS, Scene, memory_of
from ..scene.supports import Support
from ..sheet.blank import Part

# displacement (dofs,) of formed sheets, as they lie elsewhere once they were unloaded
_formed: WeakKeyDictionary[Scene, np.ndarray] = WeakKeyDictionary()


def unloading(
    result: Result, *, together: bool = False, keep: Sequence[str] = (), **changes: Any
) -> Job:
    """Job that unloads the sheets of a result, without tools, holders and loads except gravity.

    The forces that these, and supports, exerted on the nodes in the formed state are released in
    proportion to the load, see `ReleaseForces`. The sheets keep their history, i.e. plastic strains
    and the sliding of yarns, and planes of symmetry remain. Remaining rigid motions are fixed at
    a few nodes of each sheet, see `isostatic`, where forces are 0 at the end, or its weight. The
    run moves the sheets of `result.scene`, so its output is then that of the unloaded state.

    - result: of any run that reached full load
    - together: contact and friction between the sheets of a stack remain, and the sheets are pinned
      together at their fixed nodes. For deeply drawn stacks contact may not converge as it opens.
      By default each sheet is unloaded separately, and forces of its neighbours are also released
    - keep: names of supports to keep
    - changes: of fields of the `Job`

    Its quantities are the largest `springback` [mm], for a stack also of each sheet; the energies
    left in the sheets and released [N mm]; the sum of the forces on fixed nodes [N].
    Raises InputError for a result that did not reach full load, and for names that no support has.

    Examples
    --------
    >>> strip = ff.Tensile(nx=2, element="P1", strain=0.01).job(steps=1).run()
    >>> ff.unloading(strip, keep=["fixed grip"]).name
    'unloaded'
    """
    before, reached = result.scene, result.summary.get("stroke_reached")
    if reached != 1:
        raise InputError(f"unloading needs a run that reached full load, not {reached} of it")
    blank, kept = before.blank, _kept(before, keep)
    blank.u.x.array[:] = _formed.setdefault(before, blank.u.x.array.copy())
    held = isostatic(blank, kept)
    thicknesses = [material.thickness for material in materials_of(before, blank.whole)]
    forces = _Release(min(thicknesses, default=1e-3 * float(np.ptp(blank.extent(), 0).max())))
    own = [term for term in before.terms if _stays(term, together)]
    scene = _formed_scene(blank, own, forces, [*map(_at_full_load, kept), *held])
    scene.residual(scene.u.duplicate())
    outside = scene.forces.array.copy()
    for support in kept:  # what they bear stays
        outside[scene.supports.dofs_of[support.name][:, list(support.components)]] = 0.0
    forces.take(outside)
    return Job(Unloading(scene, forces, held), **{"path_tolerance": 1e-6} | changes)


def _kept(scene, keep):
    """Supports of a scene that stay: planes of symmetry, and those of the names in `keep`."""
    names = [support.name for support in scene.supports]
    if lost := [name for name in keep if name not in names]:
        raise InputError(
            f"`keep` contains {lost[0]!r}; expected supports of the scene: {', '.join(names)}"
        )
    planes = [*planes_of_symmetry(scene.blank, scene.supports).values()]
    return [each for each in scene.supports if each in planes or each.name in keep]


def _stays(term, together):
    """Whether a term belongs to the sheets, not to what forms them."""
    if isinstance(term, SheetContact):
        return together
    if overrides(term, "applied_forces"):
        return isinstance(term, Gravity)
    return term.energy_kind is not None or term.energy is None


def _at_full_load(support):
    """The same support, with the displacements at full load at any load."""
    return replace(support, value=lambda x, load: support.at(x, 1.0), locates=False)


def _formed_scene(blank, own, forces, supports):
    """The scene of formed sheets, of copies of their `own` terms, which remember what those do."""
    memory, formed = memory_of(own), blank.u.x.array.copy()
    for i, term in enumerate(own):
        if isinstance(term, FaceContact) and term.friction_state:
            # elastic slip: when the pressure goes, its energy would be lost without being counted
            for name in ("slip", "energy"):
                memory[f"{OF_CELLS}{i} {name}"] *= 0.0
    blank.u.x.array[:] = 0.0  # as terms are made for a sheet that lies as it was laid
    scene = Scene(blank, [*(copy(term.unbound) for term in own), forces], supports)
    blank.u.x.array[:] = formed
    scene.recall(scene.memory() | memory)
    scene.set_load(0.0)
    scene.accept()
    return scene


class _Release(ReleaseForces):
    """Release forces that tell what becomes of the fabric."""

    def set_up(self, scene: SceneFacts) -> None:
        super().set_up(scene)
        self._scene, self.parts = scene, [*scene.blank.parts.values()] or [scene.blank.whole]

    def largest(self, part: Part) -> float:
        """The largest springback of a node of a part, of all ranks [mm]."""
        size = np.linalg.norm(self.springback(), axis=1)[part.nodes]
        return self.blank.mesh.comm.allreduce(float(size.max(initial=0.0)), MPI.MAX)

    def warnings(self) -> list[str]:
        """Of each sheet of fabric that keeps no shape, as its shear has no friction."""
        return [
            f"{part.name or self.blank.name} springs back by up to {rounded(self.largest(part))} "
            "mm and keeps no shape: fabric is elastic here and gives back all that it stored. Real "
            "fabric keeps most of its shape; do not take this for its springback, but give its "
            "material a `shear_friction`"
            for part in self.parts
            if (fabric := fabric_of(self._scene, part)) and not fabric.shear_friction
        ]

    def cell_fields(self) -> dict[str, Value]:
        return PlyThickness(self._scene).fields(0 * self.blank.areas())


class Unloading(Setup):
    """A scene of formed sheets that are `held` at a few nodes, and the forces that go."""

    # energies that are no longer in the sheets, or that they can't give back
    SPENT = "plastic", "friction", KIND, "viscous", "external_work", RELEASED
    force_name = "forces that are left"

    def __init__(self, scene: Scene, forces: _Release, held: Sequence[Support]) -> None:
        super().__init__(scene)
        self.name, self._forces, self._held = "unloaded", forces, held

    def measure(self, scene: Scene, load: float) -> tuple[float, float]:
        """The largest springback [mm], and the forces that are left [N]."""
        return max(map(self._forces.largest, self._forces.parts)), self._forces.remaining()

    def quantities(self, result: Result) -> dict[str, object]:
        """Springback, energies and the forces on fixed nodes."""
        scene, energy = self.scene, result.summary.get("energy") or self.scene.energies()
        dofs = [scene.supports.dofs_of[s.name][:, list(s.components)] for s in self._held]
        borne = sum(float(abs(scene.forces.array[each]).sum()) for each in dofs)
        largest = {part.name: self._forces.largest(part) for part in self._forces.parts}
        sheets = {name: {"springback_largest_mm": most} for name, most in largest.items()}
        return {
            "springback_largest_mm": max(largest.values()),
            "energy_left_Nmm": sum(energy[kind] for kind in energy if kind not in self.SPENT),
            "energy_released_Nmm": energy[RELEASED],
            "supports_bear_N": scene.comm.allreduce(borne, MPI.SUM),
        } | ({"sheets": sheets} if len(sheets) > 1 else {})

    def pictures(self, result: Result, folder: Path) -> None:
        """A map of the springback on the unloaded sheets."""
        from ..results import pictures

        name, grids = "springback", {}
        for title, grid in result.grids.items():
            grid.point_data[name] = np.linalg.norm(grid.point_data[name], axis=1)
            grids[title or self.name] = grid.point_data_to_cell_data(pass_point_data=True)
        pictures.maps(folder / f"{name}.png", grids, (name,), 0.0, {name: "mm"})
