"""What is said of a sheet whose yarns compression shortens."""

import numpy as np
import pytest
from builders import sheet

import fabric_fenicsx as ff


def pressed(fabric, pattern="crossed", angle=0.0):
    """A sheet in space, pressed together by 5 % along x, which is kept from buckling."""
    options = {"pattern": pattern, "fibre_angle": angle, "spatial": True}
    blank = ff.Blank.rectangle(40, 20, nx=8, ny=4, **options)
    flat = ff.Support("flat", lambda x: np.full(x.shape[1], True), (1, 2))
    supports = [*ff.clamped_ends(-2.0)(blank), flat]
    limits = ff.Limits(shortening=0.05)
    return ff.Job(ff.Scene(blank, [ff.Membrane(fabric)], supports), steps=4, limits=limits)


@pytest.mark.mpi
def test_yarns_that_compression_shortens_are_not_believed():
    with pytest.raises(ff.SolverFailure) as failure:
        pressed(ff.load("komeili")).run()
    words = str(failure.value)
    assert words.startswith("the result is not to be believed: compression shortens yarns by more")
    assert "100 % of the area, where a real ply wrinkles; allowed is 5 % (`Limits.short" in words
    assert words.endswith("may help, and it rests on d, which no test has determined")
    row = failure.value.result.rows[-1]
    assert row["shortened_by_2_percent_share"] == pytest.approx(1)
    assert row["shortening_max"] == pytest.approx(0.05, rel=0.2)


@pytest.mark.mpi
def test_where_cells_lock_that_is_the_first_thing_to_mend():
    with pytest.raises(ff.SolverFailure, match="cells lock, which shortens yarns, too: take anoth"):
        pressed(ff.load("komeili").replace(assumed=()), "left", 30.0).run()


@pytest.mark.mpi
def test_what_yarns_contract_by_beside_stretched_ones_does_not_count():
    """A strip in space, pulled along x: yarns across are shorter and free of stress."""
    blank = sheet(100, 20, 20, 4, spatial=True)
    terms = [ff.Membrane(ff.load("komeili")), ff.Bending(modulus=100.0)]
    result = ff.Job(ff.Scene(blank, terms, ff.rolling_ends(1.5)), steps=4).run()
    middle = abs(blank.midpoints()[0] - 50) < 20
    assert result.fields["eps_b"][middle].max() < -0.02
    assert result.rows[-1]["shortened_by_2_percent_share"] < 0.02
