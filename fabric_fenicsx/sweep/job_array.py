"""A job array of Slurm that does the runs of a sweep, each in a task."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from ..core.errors import InputError
from ..core.files import replace_file

SCRIPT = """\
#!/bin/bash
#SBATCH --job-name=sweep
#SBATCH --array=1-{count}
#SBATCH --nodes=1
#SBATCH --ntasks={ranks}
#SBATCH --signal=B:TERM@120
cd {folder}
exec {start} --only "$SLURM_ARRAY_TASK_ID"{passed}
"""  # exec: so that the signal reaches the sweep, which ends its run after its step


def write(file: Path, words: Sequence[str], count: int, ranks: int) -> None:
    """Write the script, a task a run of the `count` that `fabric sweep` with these words does, to
    start in the present folder. Raises InputError for a file that is another's, and OSError."""
    if file.exists() and "#SBATCH --job-name=sweep\n" not in file.read_text(errors="replace"):
        flaw = f"--slurm {file} is there and no script of a sweep"
        raise InputError(f"{flaw}; allowed is another file")
    cut = words.index("--") if "--" in words else len(words)
    own = [word for word, before in zip(words[:cut], ["", *words]) if before != "--slurm"]
    own = [w for w in own if w != "--overwrite" and w.split("=")[0] != "--slurm"]
    script = SCRIPT.format(
        count=count,
        ranks=ranks,
        folder=shlex.quote(str(Path.cwd())),
        start=shlex.join([sys.executable, "-m", "fabric_fenicsx", "sweep", *own]),
        passed="".join(f" {shlex.quote(word)}" for word in words[cut:]),
    )
    replace_file(file, script)
    print(f"{file}: a job array of {count} runs, for sbatch; the same sweep without --slurm then")
    print("writes their table and does those that are missing")
