"""The cheaper hard cases, some of them on ranks; the benchmark itself runs all."""

import csv

import pytest


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
