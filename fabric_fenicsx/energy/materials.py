"""Materials of a scene's sheets, as their terms know them, and their stiffness."""

from collections.abc import Iterator

import numpy as np
from dolfinx import fem

from .. import dolfinx_compat as compat
from ..core.collective_errors import on_all
from ..material.laws import Law
from ..material.laws.base import Material
from ..material.metal import Metal
from ..sheet.blank import Blank, Part
from .term import SceneFacts, bind


def sheets_of(blank: Blank) -> list[Part]:
    """The parts of a blank, or all of it."""
    return list(blank.parts.values()) or [blank.whole]


def _terms_on(scene, part):
    """Terms on a part or on all of the blank."""
    here = part, scene.blank.whole
    return (term for term in scene.terms if scene.blank.part(term.part_name) in here)


def materials_of(scene: SceneFacts, part: Part) -> Iterator[Material]:
    """Fabrics and metals of terms on a part or all of the blank; of the whole, of all terms."""
    terms = scene.terms if part.is_whole else _terms_on(scene, part)
    return (term.material for term in terms if term.material is not None)


def fabric_of(scene: SceneFacts, part: Part) -> Law | None:
    """The first fabric among these, None if no term knows."""
    return next((fabric for fabric in materials_of(scene, part) if isinstance(fabric, Law)), None)


def thickness_shares(scene: SceneFacts, part: Part, x: np.ndarray) -> np.ndarray:
    """Thickness (n,) at flat places x (n, 3) over that of the material; on all ranks together."""
    for term in _terms_on(scene, part):
        if (field := term.thickness_field) and (material := term.material):
            return on_all(scene.blank.mesh.comm, lambda: field.at(x)) / material.thickness
    return np.ones(len(x))


def thickness_shares_at_nodes(scene: SceneFacts) -> np.ndarray:
    """As `thickness_shares`, at the owned nodes (nodes,)."""
    x = scene.blank.coordinates()[: scene.blank.whole.nodes.size]
    shares = np.ones(len(x))
    for part in sheets_of(scene.blank):
        shares[part.nodes] = thickness_shares(scene, part, x[part.nodes])
    return shares


def stretching_stiffness(scene: SceneFacts, part: Part) -> float:
    """Tension over the strain of a part that is stretched, or shortened, by 1e-4 along all
    directions, 0 without a strain energy [N/mm]: of an isotropic sheet E t / (1 - nu)."""
    blank, u, total, strain = scene.blank, scene.blank.u.x.array, 0.0, 1e-4
    kept, grown = u.copy(), strain * blank.coordinates().ravel()
    for term in _terms_on(scene, part):
        if isinstance(metal := term.material, Metal):
            total += metal.E * metal.thickness / (1 - metal.nu)
        elif term.energy_kind == "strain":
            bind(term, scene)
            if term.energy is None:
                continue
            form, gained, sums = compat.form(term.energy), 0.0, blank.mesh.comm.allreduce
            for sign, share in ((1.0, 0.5), (-1.0, 0.5), (0.0, -1.0)):
                u[:] = sign * grown
                gained += share * sums(fem.assemble_scalar(form))
            u[:] = kept
            total += gained / (strain**2 * sums(float(blank.areas()[term.part.cells].sum())))
    return total
