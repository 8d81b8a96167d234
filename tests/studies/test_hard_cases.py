"""The cheaper hard cases hold on one and on two ranks; the whole set is the study itself."""

import csv

import pytest


@pytest.mark.parametrize("ranks, cases", [(1, "cfgilmn"), (2, "acfgijklmn")])
def test_hard_cases(launch, ranks, cases):
    done = launch("hard_cases", "--quick", "--only", cases, ranks=ranks)
    assert done.status == 0, done.out + done.err
    with open(done.folder / "cases.csv") as file:
        rows = list(csv.DictReader(file))
    assert [row["case"] for row in rows] == list(cases)
    assert all(row["holds"] == "True" and row["faults"] == "[]" for row in rows)


def test_an_unknown_case_is_named(launch):
    done = launch("hard_cases", "--only", "az")
    assert done.status == 2 and "names case z" in done.err
