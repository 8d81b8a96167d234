"""What README and the documentation tell a reader to type works, and is as they say."""

import ast
import hashlib
import json
import logging
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

import ezdxf
import pytest
from builders import dome

import fabric_fenicsx as ff
from fabric_fenicsx.forming.build import FormingScene
from fabric_fenicsx.identification import curves, identify, result_lines
from fabric_fenicsx.identification.curves.model import COLUMNS, KEYS
from fabric_fenicsx.identification.curves.model import units as units_of
from fabric_fenicsx.material.laws.base import LAWS
from fabric_fenicsx.material.presets import load
from fabric_fenicsx.meshes.specimen import specimen, write
from fabric_fenicsx.readers.units import UNITS
from fabric_fenicsx.runtime.ranks import RANKS_ENVIRONMENT

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = [README, *sorted(p for p in DOCS.rglob("*.md") if "generated" not in p.parts)]
EXAMPLES = sorted((DOCS / "examples").glob("*.py"))
ENVIRONMENT = os.environ | RANKS_ENVIRONMENT | {"PYTHONPATH": str(ROOT)}


def name(path):
    return str(path.relative_to(ROOT))


def material_file():
    (text,) = re.findall(r"```toml\n(.*?)```", (DOCS / "howto/material_file.md").read_text(), re.S)
    return text


def write_data_set(folder, *more):
    """The data set `mine` of the page on own data and of `more`, written into a folder."""
    text = "\n".join((DOCS / "howto" / page).read_text() for page in ("own_data.md", *more))
    files = re.findall(r"^`(mine/\w+\.(?:toml|csv))`:\n\n```\w+\n(.*?)^```", text, re.S | re.M)
    (folder / "mine").mkdir()
    for file, content in files:
        (folder / file).write_text(content)
    return folder / "mine"


def blocks(text):
    """(kind, text) of the blocks of a page in their order: programs, included files, output."""
    found = re.findall(r"^```(\{[\w-]+\} ?)?(\S*)\n(.*?)^```", text, re.S | re.M)
    for directive, word, body in found:
        if "literalinclude" in directive:
            yield "included", Path(word).stem
        elif word in ("python", "text"):
            yield word, body


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a program in this process, in a folder of the test; what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["program"])
    # those of a study that another test ran in this process
    monkeypatch.setattr(logging.getLogger("fabric_fenicsx"), "handlers", [])
    # which a run leaves in its folder unasked; tests of studies look at them
    monkeypatch.setattr(FormingScene, "pictures", lambda *_: None)

    def run_here(program):
        with patch.dict(LAWS):  # which own laws enter
            exec(compile(program, "program", "exec"), {"__name__": "program"})
        return capsys.readouterr().out

    return run_here


def compare(printed, told):
    """Words are the same, numbers to 1 % or to what rounding hides."""
    assert len(printed.split()) == len(told.split()), printed
    for mine, theirs in zip(printed.split(), told.split()):
        try:
            value = float(theirs)
        except ValueError:
            assert mine == theirs
        else:
            assert float(mine) == pytest.approx(value, rel=0.01, abs=1e-4)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_pages_are_short(page):
    assert len(page.read_text().split()) <= (800 if page == README else 1500)


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page):
    text = page.read_text()
    text = re.sub(r"\$\$.*?\$\$|\$[^$\n]+\$", "", re.sub(r"```python.*?```", "", text, flags=re.S))
    targets = re.findall(r"\]\(([^)\s]+)\)|src=\"([^\"]+)\"|:img-top: (\S+)", text)
    for target in (next(filter(None, each)) for each in targets):
        if not target.startswith("http"):
            assert (page.parent / target.split("#")[0]).exists(), target
    for target in re.findall(r"^:link: (\S+)", text, re.M):
        assert (page.parent / f"{target}.md").exists(), target


def test_the_material_file(tmp_path):
    (tmp_path / "fabric.toml").write_text(material_file())
    fabric = load(str(tmp_path / "fabric.toml"))
    assert fabric.thickness == 0.4
    assert fabric.density == 0.75
    assert fabric.warp == fabric.weft == load("komeili").warp


def test_the_data_set(tmp_path):
    text = (DOCS / "howto/own_data.md").read_text()
    found = identify(*curves.read(write_data_set(tmp_path)))
    assert sorted(found.assumed) == ["d", "s_C", "s_T"]
    assert "In the example d, s_T and s_C are assumed" in text
    for curve in found.report()["curves"]:
        assert curve["rms_error_of_peak"] < 0.01
    (reaction,) = re.findall(r"the simulated reaction is (\d+) N", text)
    strip = ff.Tensile(found.fabric, length=300, width=100, strain=0.03, nx=16)
    assert strip.job(steps=5).run().summary["reaction_N"] == pytest.approx(float(reaction), 0.01)


def test_the_compaction_test(tmp_path):
    found = identify(*curves.read(write_data_set(tmp_path, "compaction_test.md")))
    told = re.findall(r"^compaction\.\w+ .*", (DOCS / "howto/compaction_test.md").read_text(), re.M)
    assert len(told) == 3
    assert set(told) <= set(result_lines(found))


def test_the_format_of_data_names_every_test_column_key_and_unit():
    text = (DOCS / "howto/own_data.md").read_text()
    keys = set(KEYS) - {"test"}
    units = {unit for column in COLUMNS for unit in units_of(column)} | set(UNITS["length"])
    for word in (*curves.TESTS, *COLUMNS, *keys):
        assert f"`{word}`" in text, word
    table = text.split("## Units")[1]
    for unit in units:
        assert re.search(rf"(?<![\w/]){re.escape(unit)}(?![\w/])", table), unit


@pytest.mark.parametrize(
    "script",
    [pytest.param(p, marks=pytest.mark.versions) if p.stem == "ball" else p for p in EXAMPLES],
    ids=lambda p: p.stem,
)
def test_an_example_prints_what_its_page_says(run, tmp_path, script, caplog):
    """And ends without a warning that its work is not in the energies."""
    text = script.read_text()
    assert len(text.splitlines()) <= 40
    told = []
    for page in PAGES:
        found = [*blocks(page.read_text()), ("", "")]
        told += [
            after[1]
            for before, after in zip(found, found[1:])
            if before == ("included", script.stem) and after[0] == "text"
        ]
    (told,) = told or [output_of_readme()] if script.stem == "ball" else told
    compare(run(text), told)
    assert "take smaller steps" not in caplog.text
    picture = tmp_path / f"{script.stem}.png"
    assert picture.exists() == (DOCS / "pictures" / picture.name).exists()


def output_of_readme():
    (told,) = (body for kind, body in blocks(README.read_text()) if kind == "text")
    return told


def test_readmes_program_is_an_example():
    (program,) = (body for kind, body in blocks(README.read_text()) if kind == "python")
    script = (DOCS / "examples/ball.py").read_text()
    assert script.endswith(f'"""\n\n{program}')
    assert ast.get_docstring(ast.parse(script))


WITH_PROGRAMS = [p for p in PAGES[1:] if "```python" in p.read_text()]


@pytest.mark.parametrize("page", WITH_PROGRAMS, ids=name)
def test_programs_print_what_their_page_says(run, tmp_path, page):
    if page.stem == "own_tool":
        import pyvista

        ball = pyvista.Sphere(radius=30, theta_resolution=60, phi_resolution=60)
        ball.save(tmp_path / "ball.stl")
    found = [b for b in blocks(page.read_text()) if b[0] != "included"]
    for (kind, program), (after, output) in zip(found, [*found[1:], ("", "")]):
        if kind == "python":
            printed = run(program)
            if after == "text":
                compare(printed, output)


# run in the same way, or longer, by tests of their own, as the benchmarks are
ELSEWHERE = "laminate", "double_dome", "compression_parameters", "stability_map"
COMMANDS = {
    line: None
    for page in PAGES
    for line in page.read_text().replace("`", "\n").splitlines()
    if line.startswith(".venv/bin/python ")
    and not any(f"studies/{study}.py" in line for study in ELSEWHERE)
    and "benchmarks/" not in line
}


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands(run_script, tmp_path, command, hang):
    _, script, *options = shlex.split(command)
    write(tmp_path / "blank.msh", *specimen(nx=20, ny=5))
    drawing = ezdxf.new()
    drawing.modelspace().add_circle((0, 0), 0.1)  # m
    drawing.saveas(tmp_path / "ply.dxf")
    for file in ("fabric.toml", "glass_pp.toml"):
        if f"--out {file}" not in command:
            (tmp_path / file).write_text(material_file())
    write_data_set(tmp_path)
    quick = ["--quick"] if script.startswith("studies/") and "identify" not in script else []
    (tmp_path / "studies").symlink_to(ROOT / "studies")
    if script.startswith("studies/"):
        status, _, err = run_script(tmp_path, ROOT / script, *options, *quick)
        assert status == 0, err
        assert len([p for p in tmp_path.rglob("*.html") if "studies" not in p.parts]) == 1
        return
    done = subprocess.run(
        [sys.executable, ROOT / script if script.endswith(".py") else script, *options],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=hang,
        env=ENVIRONMENT,
    )
    assert done.returncode == 0, done.stderr


def test_columns_and_quantities_are_those_that_the_page_on_python_lists():
    text = (DOCS / "howto/python.md").read_text()
    columns, quantities = (
        text.split(f"### {title}")[1].split("\n##")[0]
        for title in ("Columns of the history", "Quantities")
    )
    size = {"length": 300.0, "width": 200.0, "nx": 6, "stroke": 1.0}
    runs = {
        "Tensile": ff.Tensile(nx=4, strain=1e-3),
        "BiasExtension": ff.BiasExtension(
            nx=8, strain=0.15, measured=str(ROOT / "studies/data/glass_pp_115x230")
        ),
        "PictureFrame": ff.PictureFrame(nx=2, angle=5),
        "Press": dome(**size),
    }
    for name, scenario in runs.items():
        result = scenario.job(steps=8, balance=None).run(pictures=False)
        (line,) = re.findall(rf"^\| `{name}`.*? \|(.*)\|$", quantities, re.M)
        told = re.findall(r"`(\w+)`", line)
        assert told and set(told) <= set(result.summary["quantities"]), name
        for column in result.rows[-1]:
            short = re.sub(r"_energy_Nmm$", "_...", column)
            assert f"`{column}`" in columns or f"`{short}`" in columns, column


def test_every_study_is_told_and_only_those():
    told = re.findall(r"python (\w+/\w+\.py)", (DOCS / "studies.md").read_text())
    scripts = [*ROOT.glob("studies/*.py"), *ROOT.glob("benchmarks/*.py")]
    assert set(told) == {name(path) for path in scripts}


def test_every_public_name_is_in_the_reference():
    told = re.findall(r"^   (\w+)$", (DOCS / "api/index.md").read_text(), re.M)
    assert sorted(told) == ff.__all__


def test_every_test_that_the_verification_names_is_there():
    text = (DOCS / "verification.md").read_text()
    files = {
        file: (ROOT / "tests" / file).read_text()
        for file in re.findall(r"`(\w+/[\w/]+\.py)`", text)
    }
    for test in re.findall(r"`(test_\w+)`", text):
        assert any(f"def {test}(" in source for source in files.values()), test


def test_pictures_are_small_and_of_the_scripts_as_they_are():
    for picture in (DOCS / "pictures").glob("*.png"):
        assert picture.stat().st_size < 150_000, picture.name
    known = json.loads((DOCS / "pictures/made_from.json").read_text())
    for script in EXAMPLES:
        state = hashlib.sha256(script.read_bytes()).hexdigest()[:16]
        assert known[script.name] == state, f"{script.name} was changed; run `make pictures`"
