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

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

import fabric_fenicsx as ff
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


def dimension(ax, a, b, text: str, shift=(0.0, 6.0)) -> None:  # noqa: ANN001
    """Draw a dimension from a to b, with its text above its middle or `shift` points from there."""
    ax.annotate("", a, b, arrowprops={"arrowstyle": "<->", "lw": 0.9, "shrinkA": 0, "shrinkB": 0})
    middle = ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
    look = {"textcoords": "offset points", "ha": "center", "va": "center"}
    ax.annotate(text, middle, shift, **look)


def pointed(ax, at, text: str, place) -> None:  # noqa: ANN001
    """Write a text with a line to a point."""
    ax.annotate(text, at, place, arrowprops={"arrowstyle": "-", "lw": 0.9}, va="center")


def double_dome() -> None:
    """Draw the plan and two sections of the default double dome with its dimensions."""
    dome = ff.DoubleDome()
    sharp = {"entry_radius": 1e-3, "top_radius": 1e-3, "wall_angle": 0.0, "saddle_depth": 0.0}

    def section(ax, surface, axes, at, **look) -> None:  # noqa: ANN001, ANN003
        """Draw a surface where the third coordinate is `at`."""
        u, v = np.meshgrid(np.arange(-241, 242, 3.0), np.arange(-141.0, 142, 3))
        points = np.full((u.size, 3), float(at))
        points[:, axes[0]], points[:, axes[1]] = u.ravel(), v.ravel()
        gap = surface.evaluate(points).gap.reshape(u.shape)
        ax.contour(u, v, gap, [0.0], **look)

    page = Figure(figsize=(9, 9), layout="constrained")
    plan, along, across = page.subplots(3, 1, height_ratios=(290, 100, 100))
    section(plan, ff.DoubleDome(**sharp), (0, 1), 30, colors="k")
    for z in (0.5, 15, 30, 44, 59.5):
        section(plan, dome, (0, 1), z, colors="0.7", linewidths=0.8)
    plan.plot(235 * np.array([-1, 1, 1, -1, -1]), 135 * np.array([-1, -1, 1, 1, -1]), "--", c="C0")
    c, R, w = dome.dome_distance / 2, dome.dome_radius, dome.waist
    plan.plot([-c, c], [0, 0], "k+", ms=9)
    dimension(plan, (-c, -20), (c, -20), f"{2 * c:g}, also the length of the saddle", (-130, 6))
    dimension(plan, (0, -w), (0, w), f"{2 * w:g}", (16, 0))
    dimension(plan, (-c - R, 100), (c + R, 100), f"{2 * (c + R):g}")
    turn = np.radians(50)
    dimension(plan, (c, 0), (c + R * np.cos(turn), R * np.sin(turn)), f"R {R:g}", (-18, 6))
    plan.text(-230, -128, "blank 470 x 270", color="C0")
    plan.set(title="plan [mm]: outline of the walls without fillet, lines of equal height")
    section(along, dome, (0, 2), 0, colors="k")
    low = dome.depth - dome.saddle_depth
    dimension(along, (0, 0), (0, low), f"{low:g}", (12, 0))
    dimension(along, (-c, 0), (-c, dome.depth), f"{dome.depth:g}", (12, 0))
    along.set(title="section along the middle, y = 0")
    section(across, dome, (1, 2), c, colors="k")
    a = np.radians(dome.wall_angle)
    pointed(across, (-42, 52), f"R {dome.top_radius:g}", (-110, 62))
    pointed(across, (67, 3), f"R {dome.entry_radius:g}", (100, 22))
    foot = R - dome.depth / 2 * np.tan(a)
    pointed(across, (foot, 30), f"wall {dome.wall_angle:g} deg from the vertical", (80, 48))
    across.set(title=f"section across a dome, x = {c:g}")
    for ax in (plan, along, across):
        ax.set_aspect("equal")
        ax.set_axis_off()
    along.set(ylim=(-5, 70), xlim=(-240, 240))
    across.set(ylim=(-5, 70), xlim=(-240, 240))
    picture = DOCS / "pictures/double_dome_dimensions.png"
    page.savefig(picture, dpi=110)
    shrunk(picture, picture.stem)


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
        words = [
            sys.executable,
            "-m",
            "fabric_fenicsx",
            "tensile",
            "--no-error",
            "--out",
            "tensile",
        ]
        subprocess.run(words, cwd=path, env=environment, check=True)
        shrunk(Path(path) / "tensile/maps.png", "tensile")
    double_dome()
    for name in LARGE:
        shrunk(DOCS.parent / f"studies/pictures/{name}.png", name)
    known = {script.name: source_state(script) for script in EXAMPLES}
    (DOCS / "pictures/made_from.json").write_text(json.dumps(known, indent=2) + "\n")


if __name__ == "__main__":
    main()
