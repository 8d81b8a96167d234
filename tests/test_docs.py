"""What README and the documentation tell a reader to type works, and is as they say."""

import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import ezdxf
import meshio
import page_numbers
import pytest
from builders import dome
from page_numbers import PAGES, START, renewed, with_output, write_files

import fabric_fenicsx as ff
from fabric_fenicsx.core.processes import RANKS_ENVIRONMENT
from fabric_fenicsx.identification import curves, identify
from fabric_fenicsx.identification.curves.model import COLUMNS, KEYS
from fabric_fenicsx.identification.curves.model import units as units_of
from fabric_fenicsx.io.units import UNITS
from fabric_fenicsx.sheet.specimen import specimen
from fabric_fenicsx.studies.lib.identified import result_lines

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
README, OWN_DATA = ROOT / "README.md", DOCS / "howto/own_data.md"
EXAMPLES = sorted((DOCS / "examples").glob("*.py"))
# of examples and pages: what takes more than 10 s, whose mechanisms have tests
LONG = (
    "hemisphere net_shape own_data own_holder public_bias stack studies sweeps unloading wrinkles"
)
MARKS = {"ball": pytest.mark.versions} | dict.fromkeys(LONG.split(), pytest.mark.long)
ENVIRONMENT = os.environ | RANKS_ENVIRONMENT | {"PYTHONPATH": str(ROOT)}
KNOWN = json.loads(page_numbers.DATA.read_text())


def name(path):
    return str(path.relative_to(ROOT))


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Run a program in this process, in a folder of the test; what it prints."""
    monkeypatch.chdir(tmp_path)
    return page_numbers.printed_by


def compare(printed, name, whole=True):
    """What a program prints is what pages have under this name, numbers to 1e-4."""
    told = KNOWN["outputs"][name]
    assert renewed(told, printed, whole) == told


def links(page):
    """Files that a page leads to."""
    text = page.read_text()
    yield from (page.parent / f"{each}.md" for each in re.findall(r"^:link: (\S+)", text, re.M))
    text = re.sub(r"\$\$.*?\$\$|\$[^$\n]+\$", "", re.sub(r"```python.*?```", "", text, flags=re.S))
    for found in re.findall(r"\]\(([^)\s]+)\)|src=\"([^\"]+)\"|:img-top: (\S+)", text):
        target = "".join(found)
        if not target.startswith("http"):
            yield page.parent / target.split("#")[0]


def test_the_data_set_and_its_compaction_test(tmp_path):
    page = DOCS / "howto/compaction_test.md"
    found = identify(*curves.read(write_files(tmp_path, OWN_DATA, page)))
    assert sorted(found.assumed) == ["s_C", "s_T"]
    assert "In the example s_T and s_C are assumed" in OWN_DATA.read_text()
    for curve in found.report()["curves"]:  # of eps_b with its 2 % of noise
        assert curve["rms_error_of_peak"] < (0.02 if curve["column"] == "eps_b" else 0.01)
    told = re.findall(r"^compaction\.\w+ .*", page.read_text(), re.M)
    assert len(told) == 3 and set(told) <= set(result_lines(found))


def test_the_format_of_data_names_every_test_column_key_and_unit():
    text = OWN_DATA.read_text()
    units = {unit for column in COLUMNS for unit in units_of(column)} | set(UNITS["length"])
    for word in (*curves.TESTS, *COLUMNS, *(set(KEYS) - {"test"})):
        assert f"`{word}`" in text, word
    table = text.split("## Units")[1]
    for unit in units:
        assert re.search(rf"(?<![\w/]){re.escape(unit)}(?![\w/])", table), unit


def each(argument, paths):
    """One test for each of these files."""
    params = [pytest.param(p, marks=MARKS.get(p.stem, ()), id=name(p)) for p in paths]
    return pytest.mark.parametrize(argument, params)


@each("script", EXAMPLES)
def test_an_example_prints_what_its_page_says(run, tmp_path, script, caplog):
    """And ends without a warning that its work is not in the energies."""
    text = script.read_text()
    assert len(text.splitlines()) <= 40
    compare(run(text), script.stem)
    assert "use smaller steps" not in caplog.text
    picture = tmp_path / f"{script.stem}.png"
    assert picture.exists() == (DOCS / "pictures" / picture.name).exists()


def test_readmes_program_is_an_example_and_its_numbers_are_those_of_the_pages():
    (program,) = (body for kind, body, _ in with_output(README.read_text()) if kind == "python")
    assert program == (DOCS / "examples/ball.py").read_text().split('"""\n\n', 1)[1]
    assert README.read_text() == page_numbers.readme(README.read_text())


def test_pages_state_numbers_by_their_names():
    """No output of a program stands in a page, no number of a run with four digits."""
    assert KNOWN["values"] == page_numbers.values(KNOWN["runs"])
    long = {
        text for text in KNOWN["values"].values() if len(re.sub(r"\D", "", text).lstrip("0")) > 3
    }
    known = page_numbers.texts()
    for page in PAGES[1:]:
        text = page.read_text()
        assert {*page_numbers.NAMED.findall(text)} <= {*known}, page
        assert not [each for each in long if each in text], page
        found = [*page_numbers.blocks(text)]
        for (before, *_), (kind, body, between) in zip(found, found[1:]):
            if kind == "text" != before and between < 2:
                assert page_numbers.NAMED.fullmatch(body.strip()), f"{page}: {body}"


@pytest.mark.parametrize("name", ["strip", "strip_64"])
def test_a_run_has_the_numbers_that_pages_state(name):
    found = page_numbers.run(page_numbers.PLAN["runs"][name])
    assert found == pytest.approx(KNOWN["runs"][name], rel=1e-4)


@each("page", [p for p in PAGES[1:] if "```python" in p.read_text()])
def test_programs_print_what_their_page_says(run, tmp_path, page):
    write_files(tmp_path, page)
    for kind, program, output in with_output(page.read_text()):
        if kind == "sh" and " -c " in program:
            kind, program = "python", shlex.split(program)[2]
        if kind == "python":
            printed = run(program)
            if output:
                compare(printed, output)


# run in the same way, or longer, by tests of their own
ELSEWHERE = (
    r"studies/(laminate|double_dome|compression_parameters|stability_map|single_element|"
    r"picture_frame|tensile\.py --compare)|benchmarks/|fabric_fenicsx info| -c "
)
IN_BLOCKS = {
    line
    for page in PAGES
    for kind, body, _ in page_numbers.blocks(page.read_text())
    for line in body.splitlines()
    if kind == "sh" and line.startswith(START)
}


def commands(text):
    """(commands, output) of each block of a page, then of its tables if no block has them. A
    command without output that tests elsewhere run is left out."""
    for kind, body, output in with_output(text):
        if kind == "sh":
            body = body.replace("make study", START + "studies/tensile.py") if output else body
            yield [x for x in body.splitlines() if output or is_ours(x)], output
    found = re.findall(rf"`({re.escape(START)}[^`\n]+)`", text)
    yield [x for x in found if x not in IN_BLOCKS and is_ours(x)], None


def is_ours(line):
    return line.startswith(START) and not re.search(ELSEWHERE, line)


@each("page", [p for p in PAGES if any(lines for lines, _ in commands(p.read_text()))])
def test_commands_print_what_their_page_says(run_command, tmp_path, page):
    """A command whose output no page has is run quickly."""
    points, cells, kind = specimen(nx=20, ny=5)
    meshio.write_points_cells(tmp_path / "blank.msh", points, [(kind, cells)])
    drawing = ezdxf.new()
    drawing.modelspace().add_circle((0, 0), 0.1)  # m
    drawing.saveas(tmp_path / "ply.dxf")
    (tmp_path / "studies").symlink_to(ROOT / "studies")
    write_files(tmp_path, OWN_DATA, page)
    if "--out fabric.toml" not in page.read_text():
        material = (DOCS / "howto/material_file.md").read_text().split("```toml\n")[1]
        (tmp_path / "fabric.toml").write_text(material.split("```")[0])
    for lines, output in commands(page.read_text()):
        printed = [run_command(line, quick=not output) for line in lines]
        if output:
            compare(printed[-1], output, whole=False)


@pytest.fixture
def run_command(run_script, tmp_path, hang):
    """Function that runs a command of a page, in this process if it is a script; what it prints."""

    def run(command, quick):
        _, script, *options = shlex.split(command)
        if study := script.startswith("studies/"):
            options.append("--no-pictures")
            options += [] if "identify" in script else ["--overwrite"]
            options += ["--quick", "--steps", "2"] if quick and "identify" not in script else []
        if script.endswith(".py"):
            status, out, err = run_script(tmp_path, ROOT / script, *options)
        else:
            how = {"cwd": tmp_path, "capture_output": True, "text": True, "env": ENVIRONMENT}
            done = subprocess.run([sys.executable, script, *options], timeout=hang, **how)
            status, out, err = done.returncode, done.stdout, done.stderr
        assert status == 0, err
        assert not study or any(tmp_path.rglob("*.html"))
        return out

    return run


def test_columns_and_quantities_are_those_that_the_page_on_python_lists():
    text = (DOCS / "howto/python.md").read_text()
    titles = "Columns of the history", "Quantities"
    columns, quantities = (text.split(f"### {t}")[1].split("\n##")[0] for t in titles)
    size = {"length": 300.0, "width": 200.0, "nx": 6, "stroke": 1.0}
    runs = {
        "Tensile": ff.Tensile(nx=4, strain=1e-3),
        "BiasExtension": ff.BiasExtension(nx=8, strain=0.15),
        "PictureFrame": ff.PictureFrame(nx=2, angle=5),
        "Press": dome(**size),
    }
    for name, test in runs.items():
        result = test.job(steps=8, balance=None).run(pictures=False)
        (line,) = re.findall(rf"^\| `{name}`.*? \|(.*)\|$", quantities, re.M)
        told = re.findall(r"`(\w+)`", line)
        assert told and set(told) <= set(result.summary["quantities"]), name
        for column in result.rows[-1]:
            short = column.replace("die_", "punch_").replace("blank_holder_", "holder_")
            short = re.sub(r"_energy_Nmm$", "_...", short)
            assert f"`{column}`" in columns or f"`{short}`" in columns, column


def test_pages_name_every_study_and_public_name_and_files_that_exist():
    told = re.findall(r"python (\w+/\w+\.py)", (DOCS / "studies.md").read_text())
    scripts = [*ROOT.glob("studies/*.py"), *ROOT.glob("benchmarks/*.py")]
    assert set(told) == {name(path) for path in scripts}
    told = re.findall(r"^   (\w+)$", (DOCS / "api/index.md").read_text(), re.M)
    assert sorted(told) == ff.__all__
    assert not [(name(page), to) for page in PAGES for to in links(page) if not to.exists()]
    named = re.findall(r"`(\w+/[\w/]+\.py)`", (DOCS / "verification.md").read_text())
    assert not [file for file in named if not (ROOT / "tests" / file).exists()]


def test_pictures_are_small_and_of_the_scripts_as_they_are():
    for picture in (DOCS / "pictures").glob("*.png"):
        assert picture.stat().st_size < 150_000, picture.name
    known = json.loads((DOCS / "pictures/made_from.json").read_text())
    for script in EXAMPLES:
        state = hashlib.sha256(script.read_bytes()).hexdigest()[:16]
        assert known[script.name] == state, f"{script.name} was changed; run `make pictures`"
