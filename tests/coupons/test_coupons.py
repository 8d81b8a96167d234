"""Tests as dataclasses: their fields are checked."""

import dataclasses

import pytest

import fabric_fenicsx as ff


@pytest.mark.parametrize(
    "kind, fields, words",
    [
        (ff.Tensile, {"nx": 0}, "`nx` is 0; allowed is a whole number of 1 or more"),
        (ff.Tensile, {"fiber_angle": 1}, "(did you mean fibre_angle?); allowed are fabric, mesh"),
        (ff.BiasExtension, {"length": 80}, "allowed is a length of 2 widths or more"),
        (ff.PictureFrame, {"fibre_angle": 30}, "allowed is 0 and 90, along its arms"),
    ],
)
def test_a_field_that_is_not_allowed(kind, fields, words):
    with pytest.raises(ff.InputError) as error:
        kind(**fields).build()
    assert words in str(error.value)


@pytest.mark.parametrize("kind", [ff.Tensile, ff.BiasExtension, ff.PictureFrame])
def test_a_coupon_is_data(kind):
    """It compares, is replaced field by field, and stays as it was given when it is built."""
    test = kind(nx=4)
    assert test == kind(nx=4) == dataclasses.replace(kind(nx=5), nx=4) != kind(nx=5)
    built = test.build()
    assert test == kind(nx=4) and test.integration is None
    assert (built.data.nx, built.data.integration) == (4, "full")
    assert built.data.build().data == built.data
    with pytest.raises(dataclasses.FrozenInstanceError):
        test.nx = 5
