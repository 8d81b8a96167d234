"""studies/identify.py as a user runs it."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from fabric_fenicsx.material.presets import load

DATA = Path(__file__).parents[2] / "studies" / "data"
GLASS = "--data", DATA / "glass_pp_115x230", "--out"


@pytest.mark.versions
@pytest.mark.mpi
def test_from_curves_to_a_material(launch, shared_path):
    """By simulation of the bias specimen."""
    folder = shared_path / "new"
    done = launch("identify", *GLASS, folder / "glass.toml", out=False)
    assert done.status == 0, done.err
    assert done.out.count("3 of 10 parameters determined, 7 assumed") == 1
    assert "bias.csv: simulating its specimen with s1 0.04" in done.out
    assert "bias.csv: the simulated force is 1.5 % of its peak off r.m.s., and 1.8 %" in done.out
    report = json.loads((folder / "glass.json").read_text())
    assert list(report["determined"]) == ["s1", "s2", "s3"]
    assert report["simulated"]["homogeneous"]["s1"] != report["determined"]["s1"]["value"]
    assert report["assumed"]["d"]["source"].startswith("Table 1")
    assert load(folder / "glass.toml").s1 == report["determined"]["s1"]["value"]
    ends = ".toml", ".json", ".html", "_fit.png", "_residuals.png", "_correlation.png"
    assert {p.name for p in folder.iterdir()} == {f"glass{end}" for end in ends}


def test_by_formula_and_a_material_is_not_lost(launch, tmp_path):
    words = "identify", *GLASS, tmp_path / "x.toml", "--no-pictures", "--homogeneous"
    done = launch(*words, out=False)
    assert done.status == 0, done.err
    assert "simulating" not in done.out and "above 30 deg by the displacement" in done.out
    again = launch(*words, out=False)
    assert again.status == 2
    assert "x.toml exists already; use another file, or --overwrite" in again.err


def test_a_fit_that_gives_up(launch, monkeypatch, tmp_path):
    failed = lambda _, x, **__: SimpleNamespace(status=0, nfev=300, x=x)  # noqa: E731
    monkeypatch.setattr("scipy.optimize.least_squares", failed)
    done = launch("identify", *GLASS, tmp_path / "x.toml", out=False)
    words = "stopped: the fit of s1, s2, s3 did not converge in 300 evaluations"
    assert done.status == 3 and not list(tmp_path.iterdir())
    assert done.err == f"studies/identify.py: {words}\n"
