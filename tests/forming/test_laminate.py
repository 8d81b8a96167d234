"""Which plies a laminate has, and of which dome."""

import numpy as np
import pytest
from builders import dome

from fabric_fenicsx.command_line.forming_study import AREA, LaminateTest
from fabric_fenicsx.mechanics.contact.sheet_contact import SheetContact

COARSE = {"nx": 6, "stroke": 2.0, "kind": LaminateTest}


@pytest.fixture(scope="module")
def laid():
    return dome(**COARSE)


def test_metal_covers_two_thirds_of_the_fabric(laid):
    """13 568 against 20 268 elements in the paper, with cells as large as the plies'."""
    areas = {name: laid.blank.areas()[part.cells] for name, part in laid.blank.parts.items()}
    covered = areas["lower metal"].sum() / areas["middle"].sum()
    assert covered == pytest.approx(AREA) == pytest.approx(0.669, abs=1e-3)
    assert areas["lower metal"].mean() == pytest.approx(areas["middle"].mean(), rel=0.3)


def test_friction_is_that_of_table_2(laid):
    between = [term for term in laid.scene.terms if isinstance(term, SheetContact)]
    found = [term.coulomb.largest for term in between if term.coulomb]
    assert found == [0.25, 0.334, 0.334, 0.25]


def test_the_die_is_not_sharper_than_the_metal_bears(laid):
    assert min(laid.tools["die"].surface.radii) > 10
    # 45 mm would be too low with the steeper walls of the double dome's own press
    own = dome(**COARSE, dome=["entry_radius=20", "depth=45"]).tools["punch"].surface
    assert (own.entry_radius, own.wall_angle, own.depth) == (20.0, 20.0, 45.0)


def test_roundings_begin_and_end_where_the_dome_is_flat(laid):
    dome = laid.tools["punch"].surface
    inner, outer = dome.roundings
    assert inner < 0 < outer
    ends = ((inner - 1, True), (inner + 3, False), (outer - 3, False), (outer + 1, True))
    edge = dome.dome_distance / 2 + dome.dome_radius
    for d, flat in ends:
        near = np.array([[edge + d, 0.0, dome.depth if d < 0 else 0.0]])
        assert (dome.evaluate(near).normal[0, 2] > 1 - 1e-9) == flat


@pytest.mark.parametrize(
    "sizes, loose", [((640, 400), ""), ((470, 400), "x = 192"), ((640, 170), "y = 69.5")]
)
def test_metal_that_ends_over_the_opening_is_told_of(sizes, loose):
    made = dome(**COARSE, length=float(sizes[0]), width=float(sizes[1]))
    made.job()
    found = [words for words in made.warnings if "opening" in words]
    assert len(found) == bool(loose) and all(loose in words for words in found)
