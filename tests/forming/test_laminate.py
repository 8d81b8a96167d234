"""Which plies a laminate has, and of which dome."""

import numpy as np
import pytest

import fabric_fenicsx as ff

AREA = 13568 / 20268  # of metal over that of fabric, from the paper's numbers of elements


def laminate(*changes):
    """The press, built."""
    return ff.Press.read("laminate", ["nx=6", "stage.1.moves.punch=2", *changes]).build()


def test_metal_covers_two_thirds_of_the_fabric():
    """13 568 against 20 268 elements in the paper, with cells as large as the plies'."""
    laid = laminate()
    areas = {name: laid.blank.areas()[part.cells] for name, part in laid.blank.parts.items()}
    covered = areas["lower metal"].sum() / areas["middle"].sum()
    assert covered == pytest.approx(AREA) == pytest.approx(0.669, abs=1e-3)
    assert areas["lower metal"].mean() == pytest.approx(areas["middle"].mean(), rel=0.3)


@pytest.mark.parametrize("sizes, loose", [((470, 400), "x = 192"), ((640, 170), "y = 69.5")])
def test_metal_that_ends_over_the_opening_is_told_of(sizes, loose):
    own = dict(zip(("length", "width"), np.multiply(sizes, AREA**0.5)))
    metal = [f"ply.{side} metal.{k}={v}" for side in ("lower", "upper") for k, v in own.items()]
    made = laminate(f"blank.length={sizes[0]}", f"blank.width={sizes[1]}", *metal)
    found = [words for words in made.warnings if "opening" in words]
    assert len(found) == 1 and loose in found[0]
