"""Files to read, files that are complete at any moment, and folders that one run has locked."""

import csv
import fcntl
import io
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from .errors import InputError


def ending(path: Path | str) -> str:
    """The ending of a file's name, with its dot, in small letters."""
    return Path(path).suffix.lower()


def check_file(path: Path, what: str, allowed: str) -> None:
    """Raise InputError for a `what` that is not there, no file, or empty."""
    if not path.is_file() or not path.stat().st_size:
        flaw = "is empty" if path.is_file() else "does not exist or is not a file"
        raise InputError(f"{what} {path} {flaw}; expected {allowed}")


def plain(value: Any) -> Any:
    """Nested data with Python's numbers and lists instead of NumPy's, which JSON does not know.
    Whatever is written as JSON or to history.csv goes through here once."""
    if isinstance(value, Mapping):
        return {plain(key): plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each) for each in value]
    return value.tolist() if hasattr(value, "tolist") else value


def csv_text(rows: Sequence[Mapping]) -> str:
    """A table of dicts as the content of a CSV file, with a column for each of their keys."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, dict.fromkeys(key for row in rows for key in row))
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def read_json(path: Path) -> dict:
    """The table in `path`, {} if there is none."""
    with suppress(OSError, ValueError):
        data = json.loads(path.read_text())
        return data if isinstance(data, dict) else {}
    return {}


def failure_reason(path: Path) -> str:
    """Why the run of the summary in `path` did not end well; "" if it did or there is none."""
    summary = read_json(path)
    return "" if summary.get("converged", True) else str(summary.get("reason", "no reason given"))


def check_new(*files: Path, overwrite: bool) -> None:
    """Raise InputError for a file that is there and may not be replaced."""
    for file in files:
        if file.exists() and not overwrite:
            allowed = "another file, or --overwrite to replace it"
            raise InputError(f"{file} exists already; use {allowed}")


def lock_folder(folder: Path) -> IO | None:
    """Lock `folder` for this process until the returned file is closed or the process ends; None if
    another process has locked it. A file system without locks locks nothing. Raises OSError if the
    folder can't be written to."""
    file = open(folder / ".lock", "a")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        return None
    except OSError:  # no locks here
        pass
    return file


def replace_file(path: Path, content: str | bytes, lasting: bool = False) -> None:
    """Replace the content of the file `path` in one step; lasting: wait until it is on the disk.
    Raises OSError, which names the file, if it can't be written; the file then stays as it was."""
    part = path.with_name(path.name + ".part")
    try:
        with open(part, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            if lasting:
                os.fsync(file.fileno())
        os.replace(part, path)
    except OSError as error:
        with suppress(OSError):
            part.unlink()
        raise OSError(error.errno, error.strerror, str(path)) from None


def write_json(path: Path, data: Any) -> None:
    """Write nested data to a JSON file, with null for numbers that JSON does not know."""
    data = json.loads(json.dumps(plain(data)), parse_constant=lambda _: None)
    replace_file(path, json.dumps(data, indent=2) + "\n")


def unwritable(error: OSError) -> InputError:
    """The InputError of a file that a command can't read or write, or of a library that fails."""
    if error.errno is None:  # as of gmsh, whose wheel needs some of the machine's libraries
        return InputError(f"{error}; `fabric info` says what works here")
    flaw = f"{error.filename or 'a file'} can't be read or written ({error.strerror})"
    return InputError(f"{flaw}; expected a file in a folder of this user, with space left")
