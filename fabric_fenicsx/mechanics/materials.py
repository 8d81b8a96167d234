"""Materials of a scene's sheets, as their terms know them."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..material.laws import Law
from ..material.laws.base import Material
from ..runtime.collective_errors import on_all
from ..sheets.blank import Part
from .term import SceneFacts


def materials_of(scene: SceneFacts, part: Part) -> Iterator[Material]:
    """Fabrics and metals that terms on a part, or on all of the blank, know; of the whole blank
    those of all terms."""
    here = part, scene.blank.whole
    for term in scene.terms:
        on_it = part.is_whole or scene.blank.part(term.part_name) in here
        if on_it and term.material is not None:
            yield term.material


def material_of(scene: SceneFacts, part: Part) -> Material | None:
    """The first of these, None if no term knows."""
    return next(materials_of(scene, part), None)


def fabric_of(scene: SceneFacts, part: Part) -> Law | None:
    """The first fabric among these, None if no term knows."""
    return next((each for each in materials_of(scene, part) if isinstance(each, Law)), None)


def thickness_shares(scene: SceneFacts, part: Part, x: np.ndarray) -> np.ndarray:
    """Thickness at places x (n, 3) of the undeformed part over that of its material, (n,); on all
    ranks together."""
    here = part, scene.blank.whole
    for term in scene.terms:
        if (field := term.thickness_field) and scene.blank.part(term.part_name) in here:
            material: Any = term.material
            return on_all(scene.blank.mesh.comm, lambda: field.at(x)) / material.thickness
    return np.ones(len(x))


def thickness_shares_at_nodes(scene: SceneFacts) -> np.ndarray:
    """As `thickness_shares`, at the owned nodes (nodes,)."""
    count = scene.blank.V.dofmap.index_map.size_local
    shares, x = np.ones(count), scene.blank.coordinates()[:count]
    for part in list(scene.blank.parts.values()) or [scene.blank.whole]:
        shares[part.nodes] = thickness_shares(scene, part, x[part.nodes])
    return shares


def materials_at_nodes(scene: SceneFacts) -> tuple[list[Material], np.ndarray] | None:
    """The materials of the blank's parts, and which of them each owned node has (nodes,); None if
    one is not known."""
    parts = list(scene.blank.parts.values()) or [scene.blank.whole]
    materials = [each for part in parts if (each := material_of(scene, part))]
    if len(materials) < len(parts):
        return None
    different = list(dict.fromkeys(map(id, materials)))
    which = np.zeros(scene.blank.V.dofmap.index_map.size_local, dtype=int)
    for part, each in zip(parts, materials):
        which[part.nodes] = different.index(id(each))
    return [next(m for m in materials if id(m) == each) for each in different], which
