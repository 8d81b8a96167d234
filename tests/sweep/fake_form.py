"""A stand-in for `fabric form`: numbers of `ring.pressure`, quickly, in files as a run has them."""

import argparse
import json
import os
import signal
import sys
import time
from pathlib import Path

p = argparse.ArgumentParser()
p.add_argument("--set", action="append", default=[])
p.add_argument("--out", type=Path)
for switch in ("--resume", "--overwrite"):
    p.add_argument(switch, action="store_true")
p.add_argument("--dry-run", action="store_true")
p.add_argument("--slow", type=float, default=0.0)
given = p.parse_args()
(given.out / ".files.json").write_text(json.dumps({"parts": [""], "files": ["starts.txt"]}))
values = {k: float(v) for k, v in (word.split("=", 1) for word in given.set)}
pressure = values["ring.pressure"]
if pressure < 0:
    print("a first line\nfabric form: error: ring.pressure is -1; expected a number from 0")
    sys.exit(2)
if given.dry_run:
    print("4 cells\nthe run takes 1 to 2 s\nmemory 3 MiB")
    sys.exit()
stopped = []
signal.signal(signal.SIGTERM, lambda *_: stopped.append("stopped by SIGTERM"))
with open(given.out / "starts.txt", "a") as starts:
    starts.write("resume\n" if given.resume else "begin\n")
(given.out / "checkpoint.npz").touch()
if pressure == 0.25 and not given.resume:
    os.kill(os.getpid(), signal.SIGKILL)
until = time.monotonic() + (0 if given.resume else given.slow)
while time.monotonic() < until and not stopped:
    time.sleep(0.01)
reached = 0.5 if stopped or pressure > 1 else 1.0
reason = stopped[0] if stopped else "no step is small enough" if pressure > 1 else "full load"
rows = [f"{load},{10 * load},{1000 * pressure * load}" for load in (0.0, 0.5, 1.0)]
(given.out / "history.csv").write_text("load,displacement_mm,reaction_N\n" + "\n".join(rows))
doubts = [{"verdict": "doubtful", "text": "wrinkles are inaccurate", "of": "wrinkles"}]
doubts *= 0.39 < pressure <= 1
shortening = 0.02 * pressure**-0.5 + values.get("tools.punch.friction", 0.2) * pressure**2 - 0.04
summary = {
    "converged": reached == 1,
    "verdict": "invalid" if reached < 1 else "doubtful" if doubts else "ok",
    "reasons": doubts,
    "stroke_reached": reached,
    "reason": reason,
    "reaction_N": 1000 * pressure * values.get("fabric.factor", 1.0),
    "reaction_is": "punch force",
    "wall_s": {"total": 0.1},
    "quantities": {
        "shortening_mean": shortening,
        "wrinkles": {"count": int(pressure < 0.05), "at_mm": [1.0, 2.0]},
    },
}
(given.out / "summary.json").write_text(json.dumps(summary))
print(f"fabric form: stopped: {reason}" if reached < 1 else "done", file=sys.stderr)
sys.exit(3 if reached < 1 else 0)
