"""studies/identify.py as a user runs it."""

import json
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from fabric_fenicsx.identification import problem
from fabric_fenicsx.material.presets import load

DATA = Path(__file__).parents[2] / "studies" / "data"


@pytest.mark.versions
def test_from_curves_to_a_material(launch, tmp_path):
    options = "--data", DATA / "glass_pp_115x230", "--out", tmp_path / "new/glass.toml"
    done = launch("identify", *options, out=False)
    assert done.status == 0, done.err
    assert "3 of 10 parameters determined, 7 assumed" in done.out
    assert "bias.csv: simulating its specimen with s1 0.04" in done.out
    assert "bias.csv: the simulated force is 1.5 % of its peak off r.m.s., and 1.8 %" in done.out
    report = json.loads((tmp_path / "new/glass.json").read_text())
    assert list(report["determined"]) == ["s1", "s2", "s3"]
    assert report["simulated"]["homogeneous"]["s1"] != report["determined"]["s1"]["value"]
    assert report["assumed"]["d"]["source"].startswith("Table 1")
    assert load(tmp_path / "new/glass.toml").s1 == report["determined"]["s1"]["value"]
    ends = ".toml", ".json", ".html", "_fit.png", "_residuals.png", "_correlation.png"
    files = {p.name for p in (tmp_path / "new").iterdir()}
    assert files == {f"glass{end}" for end in ends}


@pytest.mark.mpi
@pytest.mark.parametrize("how", [(), ("--homogeneous",)])
def test_bias_tests_by_simulation_or_formula(launch, shared_path, how):
    options = "--data", DATA / "glass_pp_115x230", "--out", shared_path / "x.toml", "--no-pictures"
    done = launch("identify", *options, *how, out=False)
    assert done.status == 0, done.err
    assert done.out.count("3 of 10 parameters determined") == 1
    assert ("simulating" in done.out) == (not how)
    assert ("above 30 deg by the displacement" in done.out) == bool(how)


def test_a_material_is_not_lost(launch, tmp_path):
    (tmp_path / "x.toml").touch()
    done = launch(
        "identify", "--data", DATA / "komeili_paper", "--out", tmp_path / "x.toml", out=False
    )
    assert done.status == 2
    assert "x.toml is there already; allowed is another file, or --overwrite" in done.err


def test_a_fit_that_gives_up(monkeypatch, tmp_path, capsys):
    def failed(_, x, **__):
        return SimpleNamespace(status=0, nfev=300, x=x)

    monkeypatch.setattr(problem, "least_squares", failed)
    options = ["--data", str(DATA / "glass_pp_115x230"), "--out", str(tmp_path / "x.toml")]
    monkeypatch.setattr(sys, "argv", ["identify.py", *options])
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(DATA.parent / "identify.py"), run_name="__main__")
    assert left.value.code == 3 and not list(tmp_path.iterdir())
    said = capsys.readouterr().err
    assert said == (
        "studies/identify.py: stopped: the fit of s1, s2, s3 did not converge in 300 evaluations\n"
    )
