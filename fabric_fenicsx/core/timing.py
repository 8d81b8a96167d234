"""Wall time of this process by phase."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

# imports: of modules; setup: the scene is built and checked; compile: forms; assemble: energies,
# forces and tangents; linear_solve; contact: terms are updated between solves; steps: all else of
# load stepping; output: results and files
PHASES = "imports setup compile assemble linear_solve contact steps output".split()
seconds: defaultdict[str, float] = defaultdict(float)
_open: list[list] = []
_uncounted = [time.perf_counter()]  # when the package was imported


@contextmanager
def phase(name: str) -> Iterator[None]:
    """Count the time inside as that of `name` alone; a phase around it is halted meanwhile."""
    _count()
    _open.append([name, time.perf_counter()])
    try:
        yield
    finally:
        _count()
        _open.pop()
        if _open:
            _open[-1][1] = time.perf_counter()


def _count():
    if _open:
        name, since = _open[-1]
        _open[-1][1] = now = time.perf_counter()
        seconds[name] += now - since


def count_imports() -> None:
    """Count the time since the package was imported, but for phases, as imports; once."""
    while _uncounted:
        seconds["imports"] += time.perf_counter() - _uncounted.pop() - sum(seconds.values())


def taken() -> dict[str, float]:
    """Seconds of each of `PHASES` since they were taken last."""
    _count()
    found = {name: seconds[name] for name in PHASES}
    seconds.clear()
    return found
