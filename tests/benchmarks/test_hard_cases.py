"""The cheaper hard cases, some of them on ranks; the benchmark itself runs all."""

import csv

import pytest

FIRST = pytest.param("a", marks=[pytest.mark.mpi, pytest.mark.versions])
LONG = pytest.param("j", marks=pytest.mark.long)


@pytest.mark.parametrize("cases", [FIRST, "cl", "h", "fk", "i", LONG])
def test_hard_cases(launch, cases):
    done = launch("hard_cases", "--quick", "--only", cases)
    assert done.status == 0, done.out + done.err
    with open(done.folder / "cases.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["case"] for row in rows] == list(cases)
    for row in rows:
        assert row["holds"] == "True"
        assert row["faults"] == "[]"
