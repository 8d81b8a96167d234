"""Checks of sheets in space: their tools, and what passed through what."""

from ..mechanics.contact.self_contact import SelfContact
from ..mechanics.contact.self_crossing import crossing_warning, self_crossings
from ..mechanics.contact.sheet_contact import SheetContact
from ..mechanics.release_forces import ReleaseForces
from ..runtime.formatting import coordinates, rounded
from ..scene.rigid_motions import beyond_planes
from ..scene.scene import Scene
from ..scene.tool_warnings import cells_over_radius, tool_warnings, untouched_warning

__all__ = ["cells_over_radius", "tool_warnings", "untouched_warning"]  # for `validity`, too


def passed_through(scene: Scene) -> list[str]:
    """Sentences on sheets that passed through themselves or through planes of symmetry."""
    blank = scene.blank
    crossings = {part: self_crossings(part) for part in blank.parts.values() or [blank.whole]}
    wrong = [
        f"sheet {part.name or blank.name} passes through itself at {len(places)} places, as at "
        f"{coordinates(places[0])} mm; allowed is none: {_separation(scene)} may help"
        for part, places in crossings.items()
        if len(places)
    ]
    return wrong + [
        f"{blank.name} passes through its image: {count} nodes lie up to {rounded(depth)} mm "
        f"beyond the plane that support {name!r} holds; allowed is none: "
        f"{_separation(scene, planes=True)} may help"
        for name, (count, depth) in beyond_planes(blank, scene.supports).items()
    ]


def _separation(scene, planes=False):
    """What keeps a sheet from passing through itself, or through its image in `planes`."""
    own = [term for term in scene.terms if isinstance(term, SelfContact)]
    if any(term.symmetric or not planes for term in own):
        return "smaller cells or steps"
    contact = "`SelfContact(symmetric=...)`" if planes else "`SelfContact`"
    return f"{contact}, a press's `self = true`,"


def plies_crossed(scene: Scene) -> str:
    """`crossing_warning`, but of sheets that are unloaded one by one."""
    kinds = [type(term) for term in scene.terms]
    alone = any(issubclass(kind, ReleaseForces) for kind in kinds)
    touching = any(issubclass(kind, SheetContact) for kind in kinds)
    return "" if alone and not touching else crossing_warning(scene.blank)
