"""The numbers that pages state: `make numbers` computes them and writes docs/numbers.json.

Pages take them by `{{ name }}`, README between `<!-- name -->` and `<!-- -->`. A name below a
program or command is what that prints, where "..." stands for any words; other names are numbers of
docs/data/runs.toml, or tables of docs/data, each with the command that made it. A number stays as
it is if the new one agrees to 1e-4.
"""

import argparse
import contextlib
import csv
import io
import json
import logging
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

from fabric_fenicsx.material.laws.base import LAWS
from fabric_fenicsx.press.forming_scene import FormingScene

DOCS, ROOT = Path(__file__).parent, Path(__file__).resolve().parents[1]
README, DATA, TIMES = ROOT / "README.md", DOCS / "numbers.json", DOCS / "times.json"
PAGES = [README, *sorted(p for p in DOCS.rglob("*.md") if "generated" not in p.parts)]
NAMED = re.compile(r"\{\{ (\w+) \}\}")
START = ".venv/bin/python "
HOW: dict[str, Any] = {"capture_output": True, "text": True, "check": True}
HOW["env"] = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
NUMBER = re.compile(r"(\(?)([-+]?\d[\d.]*(?:e[-+]?\d+)?)([^\w.]*)")
PLAN = tomllib.loads((DOCS / "data/runs.toml").read_text())


def blocks(text: str) -> Iterator[tuple[str, str, int]]:
    """(kind, text, number of paragraphs before it) of the blocks of a page in their order:
    programs, included files, commands, output."""
    before = 0
    for part in re.split(r"^(```.*?^```\n)", text, flags=re.S | re.M):
        if not (block := re.match(r"```(\{[\w-]+\} ?)?(\S*)\n(.*)```", part, re.S)):
            before += len(re.findall(r"\S.*?(?:\n\n|$)", part, re.S))
            continue
        directive, word, body = block.groups("")
        if "literalinclude" in directive:
            word, body = "included", Path(word).stem
        if word in ("included", "python", "text") or (word == "sh" and not directive):
            yield word, body, before
            before = 0


def with_output(text: str) -> list[tuple[str, str, str]]:
    """(kind, text, name of the output) of the blocks of a page that run. Output stands under its
    block, with at most a paragraph between; "": there is none."""
    pairs = zip(found := [*blocks(text), ("", "", 2)], found[1:])
    return [
        (kind, body, "".join(NAMED.findall(after)) if output == "text" and between < 2 else "")
        for (kind, body, _), (output, after, between) in pairs
        if kind != "text"
    ]


def write_files(folder: Path, *pages: Path) -> Path:
    """The files that pages show under their names, written into a folder; the folder `mine`."""
    shown = r"^`([\w/]+\.(?:toml|csv))`:\n\n```(?:\{code-block\} )?\w+\n(.*?)^```"
    (folder / "mine").mkdir(exist_ok=True)
    for page in pages:
        for file, content in re.findall(shown, page.read_text(), re.S | re.M):
            (folder / file).write_text(content)
    return folder / "mine"


def printed_by(program: str) -> str:
    """What a Python program prints that runs here, in the present folder."""
    out, log = io.StringIO(), logging.getLogger("fabric_fenicsx")
    patches = patch.object(log, "handlers", []), patch.object(sys, "argv", ["program"])
    with patch.dict(LAWS), patches[0], patches[1], contextlib.redirect_stdout(out):
        with patch.object(FormingScene, "pictures", lambda *_: None):  # left in the folder unasked
            exec(compile(program, "program", "exec"), {"__name__": "program"})
    return out.getvalue()


def aligned(told: list[str], printed: list[str]) -> list[str] | None:
    """Words of a page with the numbers that are printed now, as they were if they agree to 1e-4;
    None if other words are printed. "..." stands for any words."""
    if not (told and printed):
        return None if printed or told not in ([], ["..."]) else told
    if told[0] == "...":
        tails = (aligned(told[1:], printed[k:]) for k in range(len(printed) + 1))
        tail = next((each for each in tails if each is not None), None)
        return None if tail is None else ["...", *tail]
    word, old, new = told[0], NUMBER.fullmatch(told[0]), NUMBER.fullmatch(printed[0])
    if word != printed[0]:
        if not (old and new and old.group(1, 3) == new.group(1, 3)):
            return None
        same = math.isclose(float(old[2]), float(new[2]), rel_tol=1e-4)
        word = word if same else printed[0]
    tail = aligned(told[1:], printed[1:])
    return None if tail is None else [word, *tail]


def renewed(told: str, printed: str, whole: bool) -> str:
    """Text of a page with the numbers that are printed now: of a program all that is printed, of a
    command the lines that the page has of it, in their order."""
    if whole:
        same = aligned(told.split(), printed.split()) == told.split()
        return told if same else printed.rstrip("\n")
    lines, found = iter(printed.splitlines()), []
    for line in told.splitlines():
        tries = (aligned(line.split(), each.split()) for each in lines)
        if (words := next(filter(None, tries), None)) is None:
            raise SystemExit(f"{line}\nis not in\n{printed}\nedit {DATA}")
        gaps = re.split(r"\S+", line)
        found.append(gaps[0] + "".join(f"{w}{gap}" for w, gap in zip(words, gaps[1:])))
    return "\n".join(found)


def outputs(page: Path, wanted: set[str], known: dict[str, str]) -> Iterator[tuple[str, str]]:
    """(name, text) of the programs and commands of a page whose outputs are wanted."""
    with tempfile.TemporaryDirectory() as path, contextlib.chdir(path):
        os.symlink(ROOT / "studies", "studies")
        write_files(Path(path), DOCS / "howto/own_data.md", page)
        for kind, body, name in with_output(page.read_text()):
            if name not in wanted and " -c " not in body:
                continue
            if kind == "sh":
                body = body.replace("make study", f"{START}studies/tensile.py")
                for words in map(shlex.split, body.splitlines()):
                    if words[1].startswith("studies/"):
                        words += ["--no-pictures"] + ["--overwrite"] * ("identify" not in words[1])
                    printed = subprocess.run([sys.executable, *words[1:]], **HOW).stdout
            else:
                file = DOCS / f"examples/{body}.py"
                printed = printed_by(file.read_text() if kind == "included" else body)
            if name in wanted:
                wanted.remove(name)
                yield name, renewed(known.get(name, ""), printed, kind != "sh")


def run(command: str) -> dict[str, float]:
    """The numbers of a run that pages state, to seven digits."""
    with tempfile.TemporaryDirectory() as path:
        words = [*command.split(), "--no-error", "--no-pictures", "--out", f"{path}/run"]
        subprocess.run([sys.executable, "-m", "fabric_fenicsx", *words], **HOW)
        summary = json.loads(Path(path, "run/summary.json").read_text())
    found, quantities = {}, summary["quantities"]
    sheets = {f"_{ply}": numbers for ply, numbers in quantities.get("plies", {}).items()}
    sheets[""] = summary | quantities | quantities.get("draw_in", {})
    for ply, numbers in sheets.items():
        kept = {f"{text}{ply}": numbers.get(name) for text, (name, _) in PLAN["quantities"].items()}
        found |= {text: float(f"{v:.7g}") for text, v in kept.items() if v is not None}
    return found


def values(runs: dict[str, dict[str, float]]) -> dict[str, str]:
    """The numbers of runs, and their changes, as pages write them."""
    found = {}
    for name, numbers in runs.items():
        for text, value in numbers.items():
            kinds = PLAN["quantities"].items()
            form = next(form for k, (_, form) in kinds if re.fullmatch(rf"{k}(_[a-z]+)?", text))
            written = f"{value:{form}}".replace(",", " ").replace("%", " %")
            found[f"{name}_{text}"] = written
    for name, (text, one, other) in ((k, v.split()) for k, v in PLAN["changes"].items()):
        change = 100 * abs(runs[other][text] / runs[one][text] - 1)
        found[name] = f"{change:.1g}" if change < 0.95 else f"{change:.1f}"
    return found


def texts() -> dict[str, str]:
    """What the names of pages stand for."""
    known, times = json.loads(DATA.read_text()), json.loads(TIMES.read_text())
    found = known["outputs"] | known["values"]
    for file in (DOCS / "data").glob("*.csv"):
        rows = [*csv.reader(line for line in file.read_text().splitlines() if line[0] != "#")]
        rows.insert(1, ["---"] * len(rows[0]))
        found[file.stem] = "\n".join(f"| {' | '.join(row)} |" for row in rows)
        if file.stem == "error_estimates":
            found["covered_reactions"], found["covered_forces"] = (
                f"{row[2]} of {row[1].split()[0]}" for row in (rows[2], rows[5])
            )
    return found | {f"time_{name}": f"{value:g}" for name, value in times["seconds"].items()}


def readme(text: str) -> str:
    """README with its numbers."""
    known = texts()

    def put(found):
        is_block = found[3].startswith("\n```")
        text = f"\n```text\n{known[found[2]]}\n```\n" if is_block else known[found[2]]
        return found[1] + text + found[4]

    return re.sub(r"(<!-- (\w+) -->)(.*?)(<!-- -->)", put, text, flags=re.S)


def cpu_seconds(known: dict[str, float]) -> dict[str, float]:
    """Of the commands in docs/studies.md; those of minutes as they are known."""
    rows = r"^\| `\S+ ([^`]+)` \| \{\{ time_(\w+) \}\}"
    for command, name in re.findall(rows, (DOCS / "studies.md").read_text(), re.M):
        if known.get(name, 0) < 100:
            with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
                for part in ("studies", "benchmarks"):
                    os.symlink(ROOT / part, part)
                before, words = sum(os.times()[2:4]), [sys.executable, *shlex.split(command)]
                if subprocess.run(words, **HOW | {"check": False}).returncode in (0, 3):
                    known[name] = float(f"{sum(os.times()[2:4]) - before:.2g}")
    return known


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--only", nargs="+", help="names of outputs and runs")
    options.add_argument("--long", action="store_true", help="also runs of minutes")
    options.add_argument("--times", action="store_true", help="also docs/times.json")
    args = options.parse_args()
    known, every = json.loads(DATA.read_text()), PLAN["runs"] | PLAN["long"]
    named = {name for page in PAGES for *_, name in with_output(page.read_text()) if name}
    wanted = {*named} if args.only is None else named & {*args.only}
    sys.path.insert(0, str(DOCS / "examples"))
    new = {k: v for page in PAGES for k, v in outputs(page, wanted, known["outputs"])}
    runs = dict(known["runs"])
    for name in every.keys() & {*(args.only or (every if args.long else PLAN["runs"]))}:
        before, now = runs.get(name, {}), run(every[name])
        near = (k for k in now if math.isclose(now[k], before.get(k, math.nan), rel_tol=1e-4))
        runs[name] = now | {k: before[k] for k in near}
    printed = {name: (known["outputs"] | new)[name] for name in sorted(named)}
    found = {"runs": runs, "values": values(runs), "outputs": printed}
    words = ["git", "-C", str(ROOT), "rev-parse", "--short", "HEAD"]
    commit = {"commit": subprocess.run(words, **HOW).stdout.strip()}
    if found != {part: known[part] for part in found}:
        DATA.write_text(json.dumps(commit | found, indent=1) + "\n")
    if args.times:
        commit["machine"] = re.findall(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text())[0]
        seconds = cpu_seconds(json.loads(TIMES.read_text())["seconds"])
        TIMES.write_text(json.dumps(commit | {"seconds": seconds}, indent=1) + "\n")
    README.write_text(readme(README.read_text()))


if __name__ == "__main__":
    main()
