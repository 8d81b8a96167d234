"""What a scene's terms tell, merged, and its memory."""

from types import SimpleNamespace

import numpy as np
import pytest
from builders import Elastic, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.energy import output as values
from fabric_fenicsx.scene import output
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
    size = values.size_of("slip")
    assert size.value({"slip": np.array([[2.0, 3, 6], [0, 0, 1]])}).tolist() == [7, 1]


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
    fabrics = [ff.Membrane(ff.load("komeili")).on(name) for name in names[:2]]
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
