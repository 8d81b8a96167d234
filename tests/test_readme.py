"""What README tells a reader to type works."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import pyvista

from fabric_fenicsx.material.presets import load
from fabric_fenicsx.meshes.specimen import specimen, write
from fabric_fenicsx.ranks import RANKS_ENVIRONMENT

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.S)


def block(language):
    (text,) = blocks(language)
    return text


def test_the_material_file(tmp_path):
    (tmp_path / "fabric.toml").write_text(block("toml"))
    fabric = load(str(tmp_path / "fabric.toml"))
    assert fabric.thickness == 0.4
    assert fabric.density == 0.75
    assert fabric.warp == fabric.weft == load("komeili").warp


def test_the_programs(tmp_path, hang):
    write(tmp_path / "strip.msh", *specimen(nx=20, ny=5))
    (tmp_path / "fabric.toml").write_text(block("toml"))
    pyvista.Sphere(radius=30, theta_resolution=60, phi_resolution=60).save(tmp_path / "ball.stl")
    printed = []
    for program in blocks("python"):
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=hang)
        assert done.returncode == 0, done.stderr
        printed.append([float(word) for word in done.stdout.split()])
    (reaction, _), (reached, force, shear), (pressed, push, slid) = printed
    assert reaction == pytest.approx(1275.6, rel=0.01)
    assert reached == 1 and 40 < force < 60 and 0.01 < shear < 0.3
    assert pressed == 1 and 60 < push < 68 and 0.2 < slid < 0.4
    assert (tmp_path / "formed.png").stat().st_size > 10_000


# run in the same way, or longer, by tests of their own
ELSEWHERE = "speed_vs_error", "double_dome", "compression_parameters", "hard_cases", "stability_map"
COMMANDS = [
    line for line in README.replace("`", "\n").splitlines() if line.startswith(".venv/bin/python ")
]
COMMANDS = [
    line for line in COMMANDS if not any(f"studies/{name}.py" in line for name in ELSEWHERE)
]


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands(tmp_path, command, hang):
    _, script, *options = shlex.split(command)
    write(tmp_path / "blank.msh", *specimen(nx=20, ny=5))
    for name in ("fabric.toml", "glass_pp.toml"):
        if f"--out {name}" not in command:
            (tmp_path / name).write_text(block("toml"))
    quick = ["--quick"] if script.startswith("studies/") and "identify" not in script else []
    (tmp_path / "studies").symlink_to(ROOT / "studies")
    done = subprocess.run(
        [sys.executable, ROOT / script if script.endswith(".py") else script, *options, *quick],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=hang,
        env=os.environ | RANKS_ENVIRONMENT,
    )
    assert done.returncode == 0, done.stderr
    if script.startswith("studies/"):
        assert len([p for p in tmp_path.rglob("*.html") if "studies" not in p.parts]) == 1


def test_readme_names_every_study_and_only_those():
    told = set(re.findall(r"studies/(\w+)\.py", README))
    assert told == {path.stem for path in (ROOT / "studies").glob("*.py")}
