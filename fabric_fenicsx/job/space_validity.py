"""Checks of sheets in space: their tools, and what passed through what."""

from ..contact.self_contact import crossing_warning, self_crossings
from ..contact.sheet_contact import SheetContact
from ..contact.tool_contact import Contact
from ..core.formatting import coordinates, rounded
from ..energy.load import ReleaseForces
from ..scene.rigid_motions import beyond_planes
from ..scene.scene import Scene
from ..scene.tool_warnings import cells_over_radius, tool_warnings, untouched_warning

__all__ = ["cells_over_radius", "tool_warnings", "untouched_warning"]  # for `validity`, too


def passed_through(scene: Scene) -> list[str]:
    """Sentences on sheets that passed through themselves, tools or planes of symmetry."""
    blank = scene.blank
    crossings = {part: self_crossings(part) for part in blank.parts.values() or [blank.whole]}
    wrong = [
        f"sheet {part.name or blank.name} passes through itself at {len(places)} places, e.g. at "
        f"{coordinates(places[0])} mm; smaller cells or steps, or `SelfContact` (a press's "
        "`self = true`), may help"
        for part, places in crossings.items()
        if len(places)
    ]
    contacts = [term for term in scene.terms if isinstance(term, Contact)]
    behind = [(term.tool.name, *term.behind_walls()) for term in contacts]
    wrong += [
        f"{count} nodes of {blank.name} passed through a wall of {tool} and are up to "
        f"{rounded(depth)} mm behind the face where they entered; smaller steps "
        "(`max_step`) or cells may help"
        for tool, count, depth in behind
        if count
    ]
    return wrong + [
        f"{blank.name} passes through its image: {count} nodes lie up to {rounded(depth)} mm "
        f"beyond the plane of support {name!r}; smaller cells or steps, or "
        "`SelfContact(symmetric=...)` (a press's `self = true`), may help"
        for name, (count, depth) in beyond_planes(blank, scene.supports).items()
    ]


def plies_crossed(scene: Scene) -> str:
    """`crossing_warning`, but of sheets that are unloaded one by one."""
    alone = any(isinstance(term, ReleaseForces) for term in scene.terms)
    touching = any(isinstance(term, SheetContact) for term in scene.terms)
    return "" if alone and not touching else crossing_warning(scene.blank)
