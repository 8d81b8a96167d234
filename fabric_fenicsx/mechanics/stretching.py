"""Stiffness of the sheets of a scene in their planes."""

from dolfinx import fem

from .. import dolfinx_compat as compat
from ..material.metal import Metal
from ..sheets.blank import Part
from .term import SceneFacts
from .term_checks import bind


def stretching_stiffness(scene: SceneFacts, part: Part) -> float:
    """Tension over the strain of a part that is stretched, or shortened, by 1e-4 along all
    directions, 0 without a strain energy [N/mm]: of an isotropic sheet E t / (1 - nu)."""
    blank, total, strain = scene.blank, 0.0, 1e-4
    u = blank.u.x.array
    kept, grown = u.copy(), strain * blank.coordinates().ravel()
    for term in scene.terms:
        if isinstance(term.material, Metal):
            bind(term, scene)
            if term.part in (part, blank.whole):
                total += term.material.E * term.material.thickness / (1 - term.material.nu)
        elif term.energy_kind == "strain":
            bind(term, scene)
            if term.part not in (part, blank.whole) or term.energy is None:
                continue
            form, energies = compat.form(term.energy), []
            for way in (1.0, -1.0, 0.0):
                u[:] = way * grown
                energies.append(blank.mesh.comm.allreduce(fem.assemble_scalar(form)))
            u[:] = kept
            gained = sum(energies[:2]) / 2 - energies[2]
            area = blank.mesh.comm.allreduce(float(blank.areas()[term.part.cells].sum()))
            total += gained / (strain**2 * area)
    return total
