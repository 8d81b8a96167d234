"""Declared fields of dataclasses, and the end of a run by its summary."""

import json
from dataclasses import dataclass

import pytest

from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.core.fields import check_fields, choice, flag, quantity
from fabric_fenicsx.core.files import failure_reason
from fabric_fenicsx.core.rules import COUNT, POSITIVE


@dataclass
class Made:
    size: float = quantity(2, POSITIVE, "of it [mm]", doubt=(5.0, "is it in um?"))
    nx: int = quantity(None, COUNT, "cells")
    kind: str = choice("a", ("a", "b"), "which")
    fast: bool = flag("quickly")


def test_fields_are_checked_and_doubted_above_their_bound():
    made = Made(size=5, nx=2.0)
    assert check_fields(made) == [] and (made.nx, type(made.size)) == (2, float)
    assert check_fields(Made(5.1)) == ["`size` is 5.1, which is much: is it in um?"]
    for wrong in ({"size": None}, {"nx": 0}, {"kind": "c"}, {"fast": 1}):
        with pytest.raises(InputError, match=f"`{[*wrong][0]}` is .*; allowed is"):
            check_fields(Made(**wrong))


def test_the_reason_of_a_run_that_failed(tmp_path):
    file = tmp_path / "summary.json"
    assert failure_reason(file) == ""
    for summary, reason in (
        ({}, ""),
        ({"converged": True, "reason": "full load"}, ""),
        ({"converged": False, "reason": "gave up"}, "gave up"),
        ({"converged": False}, "no reason given"),
    ):
        file.write_text(json.dumps(summary))
        assert failure_reason(file) == reason
