"""studies/identify.py as a user runs it."""

import json
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from fabric_fenicsx.material import identify
from fabric_fenicsx.material.presets import load

DATA = Path(__file__).parents[2] / "studies" / "data"


def test_from_curves_to_a_material(launch, tmp_path):
    done = launch("identify", "--data", DATA / "glass_pp_115x230", "--out", tmp_path / "new/glass.toml", out=False)
    assert done.status == 0, done.err
    assert "3 of 10 parameters determined, 7 assumed" in done.out and "r.m.s. error of F_sh 0.0025" in done.out
    report = json.loads((tmp_path / "new/glass.json").read_text())
    assert list(report["determined"]) == ["s1", "s2", "s3"] and report["assumed"]["d"]["source"].startswith("Table 1")
    assert load(tmp_path / "new/glass.toml").s1 == report["determined"]["s1"]["value"]
    assert {p.name for p in (tmp_path / "new").iterdir()} == {
        "glass.toml",
        "glass.json",
        "glass.html",
        "glass_fit.png",
        "glass_residuals.png",
        "glass_correlation.png",
    }


def test_synthetic_data_and_coverage(launch, tmp_path):
    options = ("--synthesize", "komeili", "--tests", "paper", "--no-pictures", "--out", tmp_path / "x.toml")
    done = launch("identify", *options, "--data", tmp_path / "data", out=False)
    assert done.status == 0, done.err
    report = json.loads((tmp_path / "x.json").read_text())
    assert sorted(report["assumed"]) == ["d", "p_min", "s_C"] and report["determined"]["a"]["value"] == pytest.approx(
        4130, rel=1e-6
    )
    assert not list(tmp_path.glob("*.png"))
    there = launch("identify", *options, "--data", tmp_path / "data", out=False)
    assert there.status == 2 and "x.toml is there already; allowed is another file, or --overwrite" in there.err
    options += ("--overwrite",)
    again = launch("identify", *options, "--data", tmp_path / "data", out=False)
    assert (
        again.status == 2
        and "data is not empty; allowed with --synthesize is a folder that is new or empty" in again.err
    )
    done = launch("identify", *options, "--noise", 0.02, "--coverage", 3, out=False)
    assert done.status == 0 and "of 3 times, 3 seeds" in done.out
    assert json.loads((tmp_path / "x_coverage.json").read_text())["determined"]["s_T"] == 3


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ((), "--data is missing; allowed is a folder with test curves"),
        (("--data", "none"), "none is not a folder; allowed is one with a sheet.toml"),
        (("--data", ".", "--out", "x.json"), "--out is x.json; allowed is a file that ends in .toml"),
        (("--data", ".", "--nose", "1"), "unrecognized arguments: --nose 1"),
        (("--data", "x", "--synthesize", "nylon"), "material 'nylon' is neither a preset"),
        (
            ("--synthesize", "komeili", "--coverage", "3"),
            "--coverage needs 1 seed or more, --synthesize and a --noise above 0",
        ),
        (("--data", DATA / "glass_pp_115x230", "--out", "/proc/none/x.toml"), "can't be written to"),
    ],
)
def test_bad_input(launch, options, sentence):
    done = launch("identify", *options, out=False)
    assert done.status == 2 and sentence in done.err and done.err.count("\n") == 1


def test_a_fit_that_gives_up(monkeypatch, tmp_path, capsys):
    failed = SimpleNamespace(status=0, nfev=300)
    monkeypatch.setattr(identify, "least_squares", lambda *a, **k: failed)
    options = ["--data", str(DATA / "glass_pp_115x230"), "--out", str(tmp_path / "x.toml")]
    monkeypatch.setattr(sys, "argv", ["identify.py", *options])
    with pytest.raises(SystemExit) as left:
        runpy.run_path(str(DATA.parent / "identify.py"), run_name="__main__")
    assert left.value.code == 3 and not list(tmp_path.iterdir())
    said = capsys.readouterr().err
    assert said == "studies/identify.py: stopped: the fit of s1, s2, s3 did not converge in 300 evaluations\n"
