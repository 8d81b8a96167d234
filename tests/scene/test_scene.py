"""Scenes with terms that are no forms."""

import math

import numpy as np
import pytest
from builders import sheet

from fabric_fenicsx.material.presets import load
from fabric_fenicsx.mechanics.contact.tool_contact import Contact
from fabric_fenicsx.mechanics.shell.bending import Bending
from fabric_fenicsx.mechanics.shell.membrane import Membrane
from fabric_fenicsx.runtime.errors import InputError
from fabric_fenicsx.scene.scene import Scene
from fabric_fenicsx.scene.supports import Support, clamped_ends
from fabric_fenicsx.tools.primitives import Plane, Sphere
from fabric_fenicsx.tools.tool import Tool

D = 8.33  # [N mm]


@pytest.mark.mpi
@pytest.mark.parametrize("held", [True, False])
def test_tangent_is_the_derivative_of_the_residual(held):
    blank = sheet(40, 20, 6, 3, a=math.pi / 4, spatial=True)
    scene = Scene(
        blank, [Membrane(load("komeili")), Bending(D, D_t=D, in_plane=0.1)], clamped_ends(1.0)
    )
    A, u, d = scene.create_matrix(), scene.u.duplicate(), scene.u.duplicate()
    x = blank.coordinates()[: len(u.array) // 3]
    u.array[:] = (np.sin(x[:, ::-1] / 7) * [1e-2, 1e-2, 1.0]).ravel() + np.tile([0.0, 0, 0], len(x))
    u.array[:] += (0.03 * x * [1, 1, 0]).ravel()  # away from the kinks at rest
    d.array[:] = np.cos(x[:, [1, 2, 0]] / 3).ravel()
    d.array[scene.fixed_dofs] = 0
    scene.set(u)
    scene.tangent(A, with_supports=held)
    forces = []
    for sign in (1, -1):
        v = u.copy()
        v.axpy(sign * 1e-6, d)
        scene.set(v)
        r = u.duplicate()
        scene.residual(r)
        forces.append(r)
    change = A * d
    change.array[scene.fixed_dofs] = 0
    difference = (forces[0] - forces[1]) * (0.5 / 1e-6)
    assert (difference - change).norm() <= 1e-7 * difference.norm()
    if held:
        assert A.getDiagonal().array[scene.fixed_dofs] == pytest.approx(1.0)


@pytest.mark.mpi
def test_what_a_scene_cannot_be_made_of_is_named():
    blank = sheet(40, 20, 6, 3)
    with pytest.raises(InputError, match="no elastic term"):
        Scene(blank, [])
    scene = Scene(blank, [Membrane(load("komeili"))], clamped_ends(0.1))
    with pytest.raises(
        InputError, match="'grip' is not of this scene; allowed are fixed grip, mov"
    ):
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
        (lambda: [], [], 0, r"\(none\) leave blank free to move along its \w+, which contact with"),
        (lambda: [], [Support(*LEFT, (0,))], 0, "free to move along its width, which contact w"),
        (lambda: [], [Support(*LEFT, (1,))], 0.98, r"\(left\) leave blank free to (move|turn)"),
        (lambda: [Contact(PLATES[0], friction=0.0)], [], 0, "or friction, as `Contact"),
        (lambda: [], [Support(*LEFT, (0, 1))], 0, ""),
        (lambda: [Contact(PLATES[0], friction=0.2)], [], 0, ""),
        (lambda: [Contact(BALLS[1])], [], 0, "free to turn about its normal, which contact"),
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

    def scene(*terms):
        elastic = Membrane(load("komeili")), Bending(D)
        return Scene(sheet(20, 10, 4, 2, spatial=True), [*elastic, *terms])

    made = scene(*terms())
    if words:
        with pytest.raises(InputError, match=words):
            made.check_start()
    else:
        assert "holds blank, which may move along" in made.check_held()
    tools = [term.tool for term in made.terms if isinstance(term, Contact)]
    rubbing = [Contact(tool, friction=0.2) for tool in tools]
    assert scene(*rubbing).check_held() == ""
    for tool in (*PLATES, WEDGE):
        assert tool.displacement.tolist() == [0, 0, 0]
