"""The cheaper hard cases hold on any number of ranks; the whole set is the study itself."""

import csv

import pytest

BOTH = [pytest.mark.mpi, pytest.mark.versions]


# k: twelve strips that differ from those of other cases in parameters alone, so not on ranks
@pytest.mark.parametrize(
    "cases",
    [
        pytest.param("a", marks=BOTH),
        *(pytest.param(c, marks=pytest.mark.mpi) for c in ("cm", "fi", "gln", "j")),
        "k",
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


@pytest.mark.mpi
def test_an_unknown_case_is_named(launch):
    done = launch("hard_cases", "--only", "az")
    assert done.status == 2, done.err
    assert "names case z" in done.err
