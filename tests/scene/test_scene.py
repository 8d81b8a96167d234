"""Scenes with terms that are no forms."""

import pytest
from builders import sheet

from fabric_fenicsx import (
    Bending,
    Contact,
    InputError,
    Membrane,
    Plane,
    Scene,
    Sphere,
    Support,
    Tool,
    clamped_ends,
    load,
)

D = 8.33  # [N mm]


@pytest.mark.mpi
def test_what_a_scene_cannot_be_made_of_is_named():
    blank = sheet(40, 20, 6, 3)
    with pytest.raises(InputError, match="no elastic term"):
        Scene(blank, [])
    scene = Scene(blank, [Membrane(load("komeili"))], clamped_ends(0.1))
    with pytest.raises(InputError, match="'grip' is not of this scene; allowed are fixed grip, m"):
        scene.reaction("grip")
    normal = [Support("rest", lambda x: x[0] < 1, (2,))]
    with pytest.raises(InputError, match=r"rest holds the components \(2,\) of .*`spatial=True`"):
        Scene(blank, [Membrane(load("komeili"))], normal)


BALLS = [Tool(Sphere(8.0, (10, 5, side * 9.0)), name="ball") for side in (-1, 1)]
ASIDE = Tool(Sphere(8.0, (4, 5, 9.0)), name="ball aside")
PLATES = [Tool(Plane((0, 0, -side), (0, 0, side)), name="plate") for side in (-1, 1)]
WEDGE = Tool(Plane((0, 0, 9), (-0.6, 0, -0.8)), [0, 0, -3], name="wedge")
LEFT = "left", lambda x: x[0] < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize(
    "terms, supports, height, words",
    [
        (lambda: [], [Support(*LEFT, (0,))], 0, "free to move along its width, which contact w"),
        (lambda: [], [Support(*LEFT, (1,))], 0.98, r"\(left\) leave blank free to (move|turn)"),
        (lambda: [], [Support(*LEFT, (0, 1))], 0, ""),
        (lambda: [Contact(PLATES[0], friction=0.2)], [], 0, ""),
        (lambda: [], [], 3, "free to turn about its normal, which contact"),
        (lambda: [], [Support(*LEFT, (1,))], 1.02, ""),
        (lambda: [Contact(ASIDE)], [], 3, ""),
    ],
)
def test_a_smooth_tool_holds_no_flat_sheet_within_its_plane(terms, supports, height, words):
    """While friction, a second tool or the sheet's shape may, but for turning about a ball."""

    def shape(x):
        return x + x[:, :1] ** 2 * [0, 0, height / 400]

    blank = sheet(20, 10, 4, 2, shape=shape, spatial=True)
    terms = [Membrane(load("komeili")), Bending(D), Contact(BALLS[0]), *terms()]
    scene = Scene(blank, terms, supports)
    if not words:
        return scene.check_start()
    with pytest.raises(InputError, match=words):
        scene.check_start()


@pytest.mark.parametrize(
    "terms, words",
    [
        (lambda: [*map(Contact, PLATES)], r"leave blank free to move along its \w+, which contact"),
        (lambda: [Contact(PLATES[0]), Contact(WEDGE)], "free to move along its width, which cont"),
        (lambda: [*map(Contact, [*PLATES, BALLS[0]])], "free to turn about its normal, which"),
        (lambda: [*map(Contact, [PLATES[0], BALLS[0], ASIDE])], ""),
    ],
)
def test_smooth_tools_hold_a_flat_sheet_by_their_shapes_or_not_at_all(terms, words):
    """Planes and what turns about one axis never do; where others may, that is said."""
    contacts = terms()
    rubbing = [Contact(term.tool, friction=0.2) for term in contacts]
    made, other = (
        Scene(sheet(20, 10, 4, 2, spatial=True), [Membrane(load("komeili")), Bending(D), *given])
        for given in (contacts, rubbing)
    )
    if words:
        with pytest.raises(InputError, match=words):
            made.check_start()
    else:
        assert "holds blank, which may move along" in made.check_held()
    assert other.check_held() == ""
