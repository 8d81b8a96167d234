"""CPU time, iterations and force of the studies at this commit and at another one.

    benchmarks/cost.py --against COMMIT [--runs 3] [--only tensile two_plies] [--ranks 2]

Each scene runs at both commits in turn, in a process of its own, so that what slows the machine
slows both; the ratio is the median over the pairs. Options that a commit does not know are left
out there. The first pair fills caches and is not counted."""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parents[1]
DOME = "double_dome --steps 20 --nx"
SCENES = {
    "tensile": "tensile",
    "bias": "bias_extension",
    "bias_1024": "bias_extension --pattern crossed --element P1 --nx 16",
    "dome_24": f"{DOME} 24",
    "dome_47": f"{DOME} 47",
    "dome_94": f"{DOME} 94",
    "dome_45": f"{DOME} 24 --fibre-angle 45",
    "two_plies": "form {tree}/studies/presses/two_plies.toml --nx 12",
}
EARLIER = {SCENES["two_plies"]: "double_dome --stack {tree}/studies/stacks/two_plies.toml --nx 12"}
ALWAYS = "--no-pictures", "--no-error", "--overwrite"


def run(tree, words, folder, ranks):
    """CPU seconds of a study in the tree of a commit, of all ranks, and its summary."""
    if words in EARLIER and (tree / "studies/stacks").exists():
        words = EARLIER[words]
    name, *options = words.format(tree=tree).split()
    start = [sys.executable, str(tree / "fabric_fenicsx" / "studies" / f"{name}.py")]
    env = os.environ | {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"}
    env["XDG_CACHE_HOME"] = str(folder / "cache")
    helped = subprocess.run([*start, "--help"], env=env, capture_output=True, text=True, check=True)
    options += [each for each in ALWAYS if each in helped.stdout]
    if ranks > 1:
        start = ["mpirun", "-n", str(ranks), *start]
    command, before = [*start, *options, "--out", str(folder / "run")], os.times()
    done = subprocess.run(command, env=env, cwd=folder, capture_output=True)
    if done.returncode != 3:  # invalid, which costs as much
        done.check_returncode()
    cpu = sum(os.times()[2:4]) - sum(before[2:4])
    return cpu, json.loads((folder / "run" / "summary.json").read_text())


def row(name, here, there):
    """A scene's line from pairs of runs."""
    (_, mine), (_, other) = here[-1], there[-1]
    ratio = median(one / two for (one, _), (two, _) in zip(here, there))
    seconds = (min(cpu for cpu, _ in runs) for runs in (here, there))
    iterations = (summary["newton_iterations"] for summary in (mine, other))
    force = mine["reaction_N"]
    cells = "{:10} {:8.2f} {:8.2f} {:6.2f} {:6} {:6} {:12.6g} {:9.1e}"
    return cells.format(name, *seconds, ratio, *iterations, force, force / other["reaction_N"] - 1)


def main():
    parser = argparse.ArgumentParser("cost", description=__doc__.split("\n\n")[0])
    parser.add_argument("--against", metavar="COMMIT", required=True)
    parser.add_argument("--runs", type=int, default=3, help="pairs that count (3)")
    parser.add_argument("--only", nargs="+", choices=SCENES, default=[*SCENES], metavar="SCENE")
    parser.add_argument("--ranks", type=int, default=1)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folders = [Path(temporary) / name for name in ("here", "there")]
        for folder in folders:
            folder.mkdir()
        tree = folders[1] / "tree"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "-q", "--detach", str(tree), args.against], check=True)
        try:
            print("scene       CPU [s]    there  ratio    its  there    force [N]       off")
            for name in args.only:
                pairs = []
                for _ in range(args.runs + 1):
                    trees = zip((ROOT, tree), folders)
                    pairs.append([run(each, SCENES[name], at, args.ranks) for each, at in trees])
                print(row(name, *zip(*pairs[1:])), flush=True)
        finally:
            subprocess.run([*git, "remove", "--force", str(tree)], check=True)


if __name__ == "__main__":
    main()
