"""What a scene's terms and tools tell, how it is held, and its memory."""

from types import SimpleNamespace

import numpy as np
import pytest
from builders import KOMEILI, Elastic, near, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.energy import output as values
from fabric_fenicsx.scene import output, tool_warnings
from fabric_fenicsx.scene.scene import rescale_loads


def test_what_is_merged_of_several_terms():
    """The largest by size, of vectors by their length, and whatever its sign; NaN has none."""
    numbers = values.largest(np.array([1.0, -3.0, np.nan]))
    assert numbers.merge(np.array([-2.0, 0.5, 4.0]), numbers.value).tolist() == [-2.0, -3.0, 4.0]
    assert values.largest(1.0).merge(2.0, 1.0) == 2.0
    vectors = values.largest(np.array([[1.0, 2, 2], [3, 0, 0]]))
    kept = vectors.merge(np.array([[2.0, 0, 0], [1, 4, 0]]), vectors.value)
    assert kept.tolist() == [[1, 2, 2], [1, 4, 0]]
    few = values.least(np.array([1.0, 5.0]))
    assert few.merge(np.array([3.0, 2.0]), few.value).tolist() == [1.0, 2.0]


def test_the_worst_of_several_terms_and_the_force_of_a_tool():
    deep = [(0.1, "a"), (0.4, "b"), (0.2, "c")]
    terms = [
        SimpleNamespace(penetration_of_thickness=lambda d=d: d, where_deepest=lambda n=n: n)
        for d, n in deep
    ]
    assert output.deepest(SimpleNamespace(terms=terms)) == (0.4, "b")
    pushes = [
        SimpleNamespace(tool=tool, tool_force=lambda f=f: np.array(f))
        for tool, f in (("punch", (1, 2, 3)), ("die", (9, 9, 9)), ("punch", (0, 1, -1)))
    ]
    assert output.tool_force(SimpleNamespace(terms=pushes), "punch").tolist() == [1, 3, 2]


@pytest.mark.parametrize("first", [0, 1])
def test_the_worst_of_several_sheets(first):
    """Of two fabrics and two metals, one of each stretched or shorter, whichever comes first."""
    names = "abcd"
    stack = ff.Stack([(sheet(20, 10, 2, 2, "left", spatial=True), 1.0, name) for name in names])
    fabrics = [ff.Membrane(KOMEILI).on(name) for name in names[:2]]
    metals = [ff.SheetMetal(ff.load_metal("dc04")).on(name) for name in names[2:]]
    made = ff.Scene(stack, [*fabrics, *metals])
    x = stack.coordinates()
    moves = np.isin(np.round(x[:, 2]), (first, 2 + first))
    stack.u.x.array[::3] = np.where(moves, 0.03 * x[:, 0], 0)
    assert output.overstretched(made, 0.029) == pytest.approx(1)
    assert output.overstretched(made, 0.031) == 0
    row = output.history(made)
    assert row["max_plastic_strain"] > 0.02 and row["min_metal_thickness_mm"] < 0.99
    alone = fabrics[first].history()["min_stability"].value
    assert row["min_stability"] == min(alone, fabrics[1 - first].history()["min_stability"].value)
    stack.u.x.array[::3] = np.where(moves, -0.03 * x[:, 0], 0)
    row = output.history(made)
    assert row["shortening_max"] == pytest.approx(0.03)
    assert row["shortened_by_2_percent_share"] == pytest.approx(1.0)


def test_loads_of_a_memory_are_scaled_and_nothing_else():
    """Of each state 1 if it is known, load, force and place."""
    rows = np.arange(24.0)  # of a node with two components, three states each
    memory = {"supports": rows[None].copy(), "3 work": rows[None, :12].copy(), "slip": rows.copy()}
    rescale_loads(memory, 0.5)
    halved = np.where(np.arange(24) % 4 == 1, 0.5, 1) * rows
    assert memory["supports"][0] == pytest.approx(halved)
    assert memory["3 work"][0] == pytest.approx(halved[:12])
    assert np.array_equal(memory["slip"], rows)


def test_numbers_that_a_checkpoint_compares():
    """To 12 digits."""
    facts = ff.Scene(sheet(20, 10, 2, 2), [Elastic(1e3 / 3)], ff.clamped_ends(0.1)).fingerprint()
    assert facts["stiffness of term 1, elastic"] == 333.333333333
    assert facts["largest displacement of supports [mm]"] == 0.1


BALLS = [ff.Tool(ff.Sphere(8.0, (10, 5, side * 9.0)), name="ball") for side in (-1, 1)]
ASIDE = ff.Tool(ff.Sphere(8.0, (4, 5, 9.0)), name="ball aside")
PLATES = [ff.Tool(ff.Plane((0, 0, -side), (0, 0, side)), name="plate") for side in (-1, 1)]
WEDGE = ff.Tool(ff.Plane((0, 0, 9), (-0.6, 0, -0.8)), [0, 0, -3], name="wedge")
LEFT = "left", lambda x: x[0] < 1e-6


@pytest.mark.mpi
@pytest.mark.parametrize(
    "more, supports, height, words",
    [
        ([], [ff.Support(*LEFT, (0,))], 0, "free to move along its width, which contact w"),
        ([], [ff.Support(*LEFT, (1,))], 0.98, r"\(left\) leave blank free to (move|turn)"),
        ([], [ff.Support(*LEFT, (0, 1))], 0, ""),
        ([(PLATES[0], 0.2)], [], 0, ""),
        ([], [], 3, "free to turn about its normal, which contact"),
        ([], [ff.Support(*LEFT, (1,))], 1.02, ""),
        ([(ASIDE, 0.0)], [], 3, ""),
    ],
)
def test_a_smooth_tool_holds_no_flat_sheet_within_its_plane(more, supports, height, words):
    """While friction, a second tool or the sheet's shape may, but for turning about a ball."""

    def shape(x):
        return x + x[:, :1] ** 2 * [0, 0, height / 400]

    blank = sheet(20, 10, 4, 2, shape=shape, spatial=True)
    terms = [ff.Membrane(KOMEILI), ff.Bending(8.33), ff.Contact(BALLS[0])]
    terms += [ff.Contact(tool, friction=mu) for tool, mu in more]
    scene = ff.Scene(blank, terms, supports)
    if not words:
        return scene.check_start()
    with pytest.raises(ff.InputError, match=words):
        scene.check_start()


@pytest.mark.parametrize(
    "tools, words",
    [
        (PLATES, r"leave blank free to move along its \w+, which contact"),
        ([PLATES[0], WEDGE], "free to move along its width, which cont"),
        ([*PLATES, BALLS[0]], "free to turn about its normal, which"),
        ([PLATES[0], BALLS[0], ASIDE], ""),
    ],
)
def test_smooth_tools_hold_a_flat_sheet_by_their_shapes_or_not_at_all(tools, words):
    """Planes and what turns about one axis never do; where others may, that is said."""

    def scene(mu):
        terms = [ff.Membrane(KOMEILI), ff.Bending(8.33)]
        terms += [ff.Contact(tool, friction=mu) for tool in tools]
        return ff.Scene(sheet(20, 10, 4, 2, spatial=True), terms)

    made, other = scene(0.0), scene(0.2)
    if words:
        with pytest.raises(ff.InputError, match=words):
            made.check_start()
    else:
        assert "holds blank, which may move along" in made.check_held()
    assert other.check_held() == ""


@pytest.mark.mpi
@pytest.mark.parametrize(
    "radius, mu, words",
    [
        (30, 1.99, []),
        (30, 2.01, ["friction on tip has a coefficient of 2.01, which"]),
        (0.81, 0.25, []),  # cells of 1.25 mm span 88 deg of it, or 92 deg
        (0.78, 0.25, ["cells are 1.25 mm long where the tip has a radius"]),
    ],
)
def test_what_is_doubted_of_tools(radius, mu, words):
    surface = ff.Sphere(radius, (10, 10, -radius - 0.5))
    blank = sheet(20, 20, 16, 16, "crossed", spatial=True)
    tool = ff.Tool(surface, lambda load: (0, 0, -1), name="tip")
    terms = [ff.Membrane(KOMEILI), ff.Contact(tool, friction=mu)]
    told = tool_warnings.tool_warnings(ff.Scene(blank, terms, ff.clamped_ends()))
    assert len(told) == len(words) and all(map(str.startswith, told, words))


def over_balls(n, degree=1, held=()):
    """A sheet of n columns of crossed cells over 20 mm, and contacts of two balls at rest."""
    blank = sheet(20, 20, n, n, "crossed", spatial=True, degree=degree)
    balls = [ff.Tool(ff.Sphere(r, (10, 10, -r - 0.5)), name=f"ball {r}") for r in (30, 4)]
    contacts = [ff.Contact(ball, 1.0, penalty=9.0) for ball in balls]
    return ff.Scene(blank, [ff.Membrane(KOMEILI), *contacts], held)


QUARTER = [ff.Support(name, near(axis, 0.0), (axis,)) for axis, name in enumerate("xy")]


@pytest.mark.parametrize(
    "n, degree, held, cells",
    [(5, 1, [], ""), (4, 1, [], "4 cells"), (3, 2, [], ""), (2, 2, [], "4 cells")]
    + [(3, 1, QUARTER, ""), (2, 1, QUARTER[1:], "4 cells"), (2, 1, [], "2 cells")],
)
def test_few_cells_along_a_sheet_on_tools(n, degree, held, cells):
    """Halves of quadratic ones, and of a quarter twice as many, count."""
    told = tool_warnings.few_cells_warning(over_balls(n, degree, held))
    assert told.startswith(cells) and bool(told) == bool(cells)


def test_radii_and_gaps_of_tools_that_touch_and_that_do_not():
    """A cell over the least radius of those touched; the least distance of one that has moved."""
    scene = over_balls(5)
    scene.blank.u.x.array[2::3] = -0.2
    scene.accept()
    assert tool_warnings.cells_over_radius(scene) == pytest.approx(4 / 4)
    aside = ff.Tool(ff.Sphere(4, (10, 10, -9)), lambda load: (0, 0, 3.0 * load - 1), name="ball")
    scene = ff.Scene(scene.blank, [ff.Membrane(KOMEILI), ff.Contact(aside, 1.0, penalty=9.0)])
    scene.set_load(1.0)
    scene.accept()
    words = "a tool never touched the sheet: ball moved by 3 mm, and is still 2.3 mm away;"
    assert tool_warnings.untouched_warning(scene).startswith(words)
