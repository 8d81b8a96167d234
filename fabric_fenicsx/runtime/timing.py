"""Wall time of this process by phase."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager

# by phase: setup, compile, assemble, linear_solve, output
seconds: defaultdict[str, float] = defaultdict(float)
_open: list[list] = []


@contextmanager
def phase(name: str) -> Iterator[None]:
    """Count the time inside as that of `name` alone; a phase around it is halted meanwhile."""
    now = time.perf_counter()
    if _open:
        seconds[_open[-1][0]] += now - _open[-1][1]
    _open.append([name, now])
    try:
        yield
    finally:
        now = time.perf_counter()
        name, since = _open.pop()
        seconds[name] += now - since
        if _open:
            _open[-1][1] = now
