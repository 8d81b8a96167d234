"""Messages of a run: the logger's marks, the console and the file log.txt."""

import logging
import sys
from pathlib import Path

log = logging.getLogger("fabric_fenicsx")
# of records that a user should look at: what console and log.txt write before them, while handlers
# of other programs have the level for that
MARKED = {"mark": "warning: "}


def formatter(before: str = "", date: str | None = None) -> logging.Formatter:
    """Formatter of messages with their mark; before: what of a record stands in front of it."""
    return logging.Formatter(f"{before}%(mark)s%(message)s", date, defaults={"mark": ""})


class Console(logging.Handler):
    """Results to standard output, warnings to standard error, each at once."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.setFormatter(formatter())

    def emit(self, record: logging.LogRecord) -> None:
        """Print it."""
        file = sys.stderr if record.levelno >= logging.WARNING else sys.stdout
        print(self.format(record), file=file, flush=True)


class LogFile(logging.FileHandler):
    """log.txt, opened with the first message; it starts with the command."""

    def __init__(self, path: Path, mode: str, command: str) -> None:
        super().__init__(path, mode, delay=True)
        self.command = command
        self.setFormatter(formatter("%(asctime)s  ", "%H:%M:%S"))

    def _open(self):
        file = super()._open()
        file.write(f"{self.command}\n")
        return file

    def handleError(self, record: logging.LogRecord) -> None:
        """Nothing: what a full disk does to the log ends no run."""
