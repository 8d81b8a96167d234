"""What draws tools is no number that the net compares, and takes half of a small run."""

import logging

import pytest
import pyvista

from fabric_fenicsx.press import placement
from fabric_fenicsx.results import fields


@pytest.fixture(autouse=True)
def undrawn(monkeypatch):
    monkeypatch.setattr(logging.getLogger("fabric_fenicsx"), "disabled", True)
    monkeypatch.setattr(fields, "triangulated", lambda tool, *_: pyvista.Plane())
    monkeypatch.setattr(placement, "POINTS_ACROSS", 12)
