"""The documentation's pictures, made anew: `make pictures`.

Runs the examples in a folder of its own and keeps what they draw, small enough for a page. Formed
sheets are drawn in space, too. Two large pictures of studies are made smaller. `made_from.json`
tells the state of each script then, so that a test finds pictures that are older.
"""

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from fabric_fenicsx.results.space import formed_picture
from fabric_fenicsx.results.states import states

DOCS = Path(__file__).parent
EXAMPLES = sorted((DOCS / "examples").glob("*.py"))
LARGE = "formed", "compression_parameters"  # of studies/pictures
COLOURS, WIDTH = 256, 900  # of a picture in the documentation


def shrunk(picture: Path, name: str) -> None:
    """Keep a picture in at most `WIDTH` pixels and `COLOURS` colours."""
    image = Image.open(picture).convert("RGB")
    image.thumbnail((WIDTH, 2 * WIDTH), Image.Resampling.LANCZOS)
    palette = image.quantize(COLOURS, kmeans=2)
    palette.save(DOCS / "pictures" / f"{name}.png", optimize=True)


def in_space(folder: Path) -> None:
    """Draw the strip over the ball, where it was run."""
    made, last = folder / "ball_in_space.png", states(folder / "results/ball")[-1]
    (strip,), (ball,) = last.plies().values(), last.tools().values()
    formed_picture(made, [strip], ball, spacing=5.0, full=False)
    shrunk(made, made.stem)


def source_state(script: Path) -> str:
    """A digest of a script's text."""
    return hashlib.sha256(script.read_bytes()).hexdigest()[:16]


def main() -> None:
    environment = os.environ | {"PYTHONPATH": str(DOCS.parent)}
    with tempfile.TemporaryDirectory() as path:
        for script in EXAMPLES:
            subprocess.run([sys.executable, script], cwd=path, env=environment, check=True)
        for script in EXAMPLES:
            if (picture := Path(path) / f"{script.stem}.png").exists():
                shrunk(picture, script.stem)
        for name in ("forming", "hemisphere"):
            shrunk(Path(path) / f"results/{name}/formed.png", f"{name}_in_space")
        in_space(Path(path))
    for name in LARGE:
        shrunk(DOCS.parent / f"studies/pictures/{name}.png", name)
    known = {script.name: source_state(script) for script in EXAMPLES}
    (DOCS / "pictures/made_from.json").write_text(json.dumps(known, indent=2) + "\n")


if __name__ == "__main__":
    main()
