"""The cheaper hard cases, some of them on ranks; the benchmark itself runs all."""

import csv

import numpy as np
import pytest
from bench.hard_cases import noise


@pytest.mark.parametrize(
    "cases",
    [
        pytest.param("a", marks=[pytest.mark.mpi, pytest.mark.versions]),
        *("cl", "h", "fk", "i"),
        pytest.param("j", marks=pytest.mark.long),
    ],
)
def test_hard_cases(launch, cases):
    done = launch("hard_cases", "--quick", "--only", cases)
    assert done.status == 0, done.out + done.err
    with open(done.folder / "cases.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["case"] for row in rows] == list(cases)
    for row in rows:
        assert row["holds"] == "True"
        assert row["faults"] == "[]"


def test_an_unknown_case_is_named(launch):
    done = launch("hard_cases", "--only", "az")
    assert done.status == 2, done.err
    assert "names case z" in done.err


def test_noise_depends_on_places_alone():
    """The start of a hard case is random, but the same on any number of ranks."""
    x = np.random.default_rng(2).uniform(-200, 200, (500, 3)).round(3)
    found = noise(x)
    assert np.abs(found).max() <= 0.5 and np.abs(found.mean(0)).max() < 0.05
    assert np.abs(np.corrcoef(found.T)[0, 1]) < 0.1 and found.std(0).min() > 0.25
    assert np.abs(noise(x[::-1] + 1e-13)[::-1] - found).max() < 1e-6
