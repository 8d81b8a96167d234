"""What a scene's sheets are made of, as their terms know it."""

from collections.abc import Callable, Iterator

import numpy as np

from ..material.laws import Law
from ..material.laws.base import Material
from ..sheets.blank import Part
from .roles import MadeOf
from .term import SceneFacts


def materials_of(scene: SceneFacts, part: Part) -> Iterator[Material]:
    """Fabrics and metals that terms on a part, or on all of the blank, know; of the whole blank
    those of all terms."""
    here = part, scene.blank.whole
    for term in scene.terms:
        on_it = part.is_whole or scene.blank.part(term.part_name) in here
        if on_it and isinstance(term, MadeOf):
            yield term.made_of


def material_of(scene: SceneFacts, part: Part) -> Material | None:
    """The first of these, None if no term knows."""
    return next(materials_of(scene, part), None)


def fabric_of(scene: SceneFacts, part: Part) -> Law | None:
    """The first fabric among these, None if no term knows."""
    return next((each for each in materials_of(scene, part) if isinstance(each, Law)), None)


def number_at_nodes(
    scene: SceneFacts, number: Callable[[Material], float]
) -> float | np.ndarray | None:
    """A `number` of the material: one, or where parts differ one for each owned node (nodes,);
    None if it is not known of each part."""
    parts = list(scene.blank.parts.values()) or [scene.blank.whole]
    materials = [material_of(scene, part) for part in parts]
    if not all(materials):
        return None
    numbers = [number(material) for material in materials if material]
    if len(set(numbers)) == 1:
        return numbers[0]
    found = np.zeros(scene.blank.V.dofmap.index_map.size_local)
    for part, each in zip(parts, numbers):
        found[part.nodes] = each
    return found
