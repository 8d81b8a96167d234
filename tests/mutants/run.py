"""Slips in the package that the tests must notice: `make mutants`, or
`python tests/mutants/run.py [AREA ...] [--share N] [--jobs N]`.

AREA.toml lists one-line slips as [what slips, text, text in its place] with the tests that are
asked. A text is found wherever it stands in the package, once. Each slip is made in a copy of the
project, where its tests run in one process up to the first failure, for at most 60 s of CPU. A
fourth entry of a slip says why no test notices it. Ends with 1 if fewer than 95 % are noticed."""

import argparse
import datetime
import fcntl
import os
import queue
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[2]
COPIES = ROOT / "build/mutants"
COPIED = "fabric_fenicsx", "studies", "tests", "docs", "benchmarks", "meshes", "pyproject.toml"
CPU, HANG = 60, 900  # seconds of a process, and until a run that waits is ended
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+?\.py::\w+(?:\[.*?\](?= - |$))?)", re.M)


def sources(tree):
    package = tree / "fabric_fenicsx"
    return [*package.rglob("*.py"), *(package / "studies").resolve().rglob("*.py")]


def copy(name):
    """A copy of the project, at the same place each time, with the times of its files, so that
    what Python and numba keep of it stays valid, and its own cache, which slips spoil."""
    tree = COPIES / name
    for part in COPIED:
        shutil.rmtree(tree / part, ignore_errors=True)
    tree.mkdir(parents=True, exist_ok=True)
    forms = Path(os.getenv("XDG_CACHE_HOME") or Path.home() / ".cache") / "fenics"
    if forms.is_dir() and not (tree / "cache").exists():
        shutil.copytree(forms, tree / "cache/fenics")
    for part in (ROOT / part for part in COPIED):
        if part.is_dir():
            skip = shutil.ignore_patterns("__pycache__")
            shutil.copytree(part, tree / part.name, symlinks=True, ignore=skip)
        else:
            shutil.copy2(part, tree)
    return tree


def read(areas):
    """Slips (area, tests, what, old, new, excuse), of which each text stands in one file once."""
    slips, texts = [], {file: file.read_text() for file in {f.resolve() for f in sources(ROOT)}}
    for area in areas:
        for group in tomllib.loads((ROOT / f"tests/mutants/{area}.toml").read_text())["group"]:
            for what, old, new, *excuse in group["mutants"]:
                times = sum(text.count(old) for text in texts.values())
                if times != 1 or old == new:
                    sys.exit(f"{area}.toml: `{what}`: its text stands {times} times in the package")
                slips.append((area, group["tests"].split(), what, old, new, excuse))
    return slips


def pytest(tree, tests, **environment):
    shutil.rmtree(tree / "cache/fabric_fenicsx/arrays", ignore_errors=True)
    environment |= {"XDG_CACHE_HOME": str(tree / "cache"), "PYTHONPATH": str(tree)}
    command = [sys.executable, "-m", "pytest", "-xq", "--tb=no", "-m", "not long", "--color=no"]
    done = subprocess.run(
        [*command, "-p", "no:cacheprovider", *tests],
        cwd=tree,
        env=os.environ | {"OMP_NUM_THREADS": "1"} | environment,
        capture_output=True,
        text=True,
        timeout=HANG,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU)),
    )
    return done.returncode, done.stdout


def ask(tree, tests, old, new):
    """The test that notices the slip, or None, and whether all were asked in time."""
    (file,) = {f.resolve() for f in sources(tree) if old in f.read_text()}
    text, times = file.read_text(), file.stat()
    kernels = [f for f in sources(tree) if "@compiled" in f.read_text()]
    imports = re.compile(rf"from \S*\b{file.stem} import")
    # numba sees changes in a function's own file alone
    inlined = any(f.resolve() == file or imports.search(f.read_text()) for f in kernels)
    try:
        file.write_text(text.replace(old, new))
        with tempfile.TemporaryDirectory() as empty:
            fresh = {"NUMBA_CACHE_DIR": empty} if inlined else {}
            status, out = pytest(tree, tests, **fresh)
    except subprocess.TimeoutExpired:
        return None, False
    finally:
        file.write_text(text)
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    failed = FAILED.search(out)
    if status not in (0, 1) and not failed and status >= 0:
        sys.exit(f"pytest {' '.join(tests)} ended with {status}:\n{out[-2000:]}")
    return failed and failed[1], status >= 0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("areas", nargs="*", metavar="AREA")
    parser.add_argument("--share", type=int, default=1, help="every Nth, another one each day")
    parser.add_argument("--jobs", type=int, default=1, help="slips that are asked at once")
    parser.add_argument("--least", type=float, default=0.95, help="share that must be noticed")
    parser.add_argument("--only", default="", help="slips whose description contains this")
    options = parser.parse_args()
    areas = options.areas or sorted(file.stem for file in (ROOT / "tests/mutants").glob("*.toml"))
    day = datetime.date.today().toordinal()
    slips = [s for s in read(areas) if options.only in s[2]][day % options.share :: options.share]
    COPIES.mkdir(parents=True, exist_ok=True)
    lock = open(COPIES / "lock", "w")
    fcntl.flock(lock, fcntl.LOCK_EX)  # another run that uses the copies ends first
    trees = queue.Queue()
    for k in range(options.jobs):
        trees.put(copy(f"copy{k}"))

    def judge(slip):
        area, tests, what, old, new, excuse = slip
        tree = trees.get()
        try:
            by, in_time = ask(tree, tests, old, new)
        finally:
            trees.put(tree)
        missed = "MISSED" if in_time else "MISSED (out of time)"
        print(f"{area:10} {by or missed:60} {what}", flush=True)
        return by

    with ThreadPoolExecutor(options.jobs) as pool:
        noticed = [*pool.map(judge, slips)]
    # what fails on the code as it is has noticed nothing
    tree = trees.get()
    for test in sorted({by for by in noticed if by}):
        if pytest(tree, [test])[0]:
            print(f"fails without a slip: {test}")
            noticed = [by if by != test else None for by in noticed]
    missed = [slip for slip, by in zip(slips, noticed) if not by]
    print(f"{len(slips) - len(missed)} of {len(slips)} slips noticed")
    for area, _, what, *_, excuse in missed:
        print(f"missed: {area}: {what}{': ' if excuse else ''}{''.join(excuse)}")
    sys.exit(len(missed) > (1 - options.least) * len(slips))


if __name__ == "__main__":
    main()
