"""What is said of a sheet whose yarns compression shortens."""

import dataclasses
import re

import numpy as np
import pytest
from builders import said, sheet

import fabric_fenicsx as ff
from fabric_fenicsx.solve import step_criteria


def pressed(fabric, pattern="crossed", angle=0.0, stroke=-2.4):
    """A sheet in space, pressed together by 2.4 mm along x, which is kept from buckling."""
    options = {"pattern": pattern, "fibre_angle": angle, "spatial": True}
    blank = ff.Blank.rectangle(40, 20, nx=8, ny=4, **options)
    flat = ff.Support("flat", lambda x: np.full(x.shape[1], True), (1, 2))
    supports = [*ff.clamped_ends(stroke)(blank), flat]
    terms = [ff.Membrane(fabric), ff.Bending(modulus=100.0)]
    return ff.Job(ff.Scene(blank, terms, supports), steps=4)


def test_without_a_limit_shortened_yarns_are_the_first_warning():
    """With the shortest wave: 2 pi sqrt(D / (2 d t eps)), D = E t^3 / 12."""
    job = dataclasses.replace(pressed(ff.load("komeili")), limits=ff.Limits(shortening=1.0))
    result = job.run()
    assert result.summary["converged"] and result.summary["verdict"] == "doubtful"
    first = said(result.summary)[0]
    assert first.startswith("compression shortens yarns of blank by up to 6")
    length = 2 * np.pi * np.sqrt(100 / 12 / (2 * 0.65 * 0.02))
    found = float(re.search(r"At 2 % no wave shorter than ([\d.]+) mm forms", first)[1])
    assert found == pytest.approx(length, rel=0.02)
    assert first.endswith("and no test has determined d")


@pytest.mark.mpi
def test_yarns_that_compression_shortens_are_not_believed():
    with pytest.raises(ff.SolverFailure) as failure:
        pressed(ff.load("komeili")).run()
    words = str(failure.value)
    assert words.startswith("the result is not to be believed: compression shortens yarns by more")
    assert "100 % of the area, where a real ply folds; allowed is 5 % (`Limits.short" in words
    summary = failure.value.result.summary
    assert summary["verdict"] == summary["reasons"][0]["verdict"] == "invalid"
    assert "may help, and it rests on d, which no test has determined" in words
    row = failure.value.result.rows[-1]
    assert row["shortened_by_2_percent_share"] == pytest.approx(1)
    assert row["shortening_max"] == pytest.approx(0.06, rel=0.2)


@pytest.mark.mpi
def test_where_cells_lock_that_is_the_first_thing_to_mend():
    with pytest.raises(ff.SolverFailure, match="cells lock, which shortens yarns, too: take anoth"):
        pressed(ff.load("komeili").replace(assumed=()), "left", 30.0, -4.0).run()


def test_a_run_ends_at_the_step_where_a_ply_cannot_be_formed_if_asked_for():
    """The shortening is 3, 6, 9 and 12 % at the ends of the steps; from 5 % on it is too much."""
    job = pressed(ff.load("komeili"), stroke=-4.8)
    with pytest.raises(ff.SolverFailure, match="the run ends at load factor 0.5") as failure:
        dataclasses.replace(job, stop_when_invalid=True).run()
    summary = failure.value.result.summary
    assert summary["stroke_reached"] == 0.5 and summary["verdict"] == "invalid"
    first = summary["reasons"][0]["text"]
    assert re.search(r"most is at \([\d.]+, [\d.]+\) mm of the flat sheet", first)


def test_a_run_ends_where_steps_fail_as_a_ply_cannot_be_formed(monkeypatch):
    """From 9 % of shortening on no step passes; the third would be a quarter of the first."""
    criterion = step_criteria.negative_bending
    fails = lambda energies: "too hard" if energies["strain"] > 4.5 else criterion(energies)  # noqa: E731
    monkeypatch.setattr(step_criteria, "negative_bending", fails)
    with pytest.raises(ff.SolverFailure, match="shortens yarns by more than 5 %") as failure:
        pressed(ff.load("komeili"), stroke=-4.8).run()
    summary = failure.value.result.summary
    assert (summary["steps_accepted"], summary["steps_rejected"]) == (3, 2)


def test_what_yarns_contract_by_beside_stretched_ones_does_not_count():
    """A strip in space, pulled along x: yarns across are shorter and free of stress."""
    blank = sheet(100, 20, 20, 4, spatial=True)
    terms = [ff.Membrane(ff.load("komeili")), ff.Bending(modulus=100.0)]
    result = ff.Job(ff.Scene(blank, terms, ff.rolling_ends(1.5)), steps=4).run()
    middle = abs(blank.midpoints()[0] - 50) < 20
    assert result.fields["eps_b"][middle].max() < -0.02
    assert result.rows[-1]["shortened_by_2_percent_share"] < 0.02
