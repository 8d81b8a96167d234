"""Patches of a sheet, of fabrics of their own."""

import numpy as np
import pytest
from builders import COMM, everywhere, run

import fabric_fenicsx as ff
from fabric_fenicsx.material.laws.tabulated import Curve

LEFT, RIGHT = (lambda x: x[0] < 40), (lambda x: x[0] > 40)


def strip(**options):
    return ff.Blank.rectangle(100, 20, nx=10, element="P1", **options)


def linear(modulus, thickness):
    """A fabric whose nominal stress is `modulus` [MPa] times its yarns' strain."""
    yarn = Curve((-1.0, 0.0, 1.0), (-modulus, 0.0, modulus))
    shear = Curve((0.0, 0.5, 1.0), (0.0, 0.5, 1.0))
    return ff.TabulatedFabric(yarn, yarn, shear, thickness=thickness)


@pytest.mark.versions
@pytest.mark.mpi
def test_patches_of_two_fabrics_in_series():
    """The force is the pull over the sum of compliances l / (E t w)."""
    blank, pull = strip(spatial=True), 2.0
    blank.divide({"left": LEFT}, "rest")
    soft, stiff = linear(10.0, 0.5), linear(35.0, 0.8)
    terms = [ff.Membrane(soft).on("left"), ff.Membrane(stiff).on("rest")]
    held = [*ff.rolling_ends(pull)(blank), ff.Support("plane", everywhere, (2,))]
    scene = ff.Scene(blank, terms, held)
    run(scene, 2, 1e-11)
    compliance = 40 / (10.0 * 0.5 * 20) + 60 / (35.0 * 0.8 * 20)
    assert scene.reaction("moving grip")[0] == pytest.approx(pull / compliance, rel=1e-9)


@pytest.mark.mpi
def test_patches_share_out_the_sheet():
    blank = strip()
    blank.divide({"left": LEFT}, "rest")
    for name, area in {"left": 800.0, "rest": 1200.0}.items():
        own = blank.areas()[blank.part(name).cells].sum()
        assert COMM.allreduce(own) == pytest.approx(area)
    assert all(part.straight is not None and part.orthogonal for part in blank.parts.values())
    left, inside = blank.part("left"), blank.midpoints()[0] < 40
    assert np.array_equal(np.isfinite(left.spread(np.ones(len(left.cells)))), inside)
    assert np.array_equal(left.spread(np.ones(len(left.cells), dtype=np.int32)), inside)
    blank = strip()
    for patches, words in (
        ({"a": lambda x: x[0] > 200}, "patch a of blank has no cells"),
        ({"a": LEFT, "b": lambda x: x[0] < 50}, "patches of blank overlap"),
    ):
        with pytest.raises(ff.InputError, match=words):
            blank.divide(patches, "rest")
    blank.divide({"left": LEFT, "right": RIGHT}, "rest")
    assert list(blank.parts) == ["left", "right"]
    with pytest.raises(ff.InputError, match="has parts left, right already"):
        blank.divide({"right": RIGHT}, "rest")
