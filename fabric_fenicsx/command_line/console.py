"""Console messages of a study."""

import logging
import sys

from ..runtime.logs import formatter


class Console(logging.Handler):
    """Results to standard output, warnings to standard error, neither into the line of progress."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.setFormatter(formatter())

    def emit(self, record: logging.LogRecord) -> None:
        """Print at once."""
        file = sys.stderr if record.levelno >= logging.WARNING else sys.stdout
        print(self.format(record), file=file, flush=True)
