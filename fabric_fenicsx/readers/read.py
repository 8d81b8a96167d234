"""One mesh from a file: the first reader that reads it without doubt counts."""

import locale
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from tempfile import TemporaryFile

from ..runtime.errors import InputError
from ..runtime.files import check_file, ending
from .abaqus import read_abaqus
from .libraries import NotMine, by_gmsh, by_meshio, by_pyvista
from .stl import read_stl
from .surface_mesh import SurfaceMesh
from .unseen import NASTRAN, check_coordinate_systems, check_end

Reader = Callable[[Path], SurfaceMesh]
OWN: dict[str, tuple[str, Reader]] = {".stl": ("STL", read_stl), ".inp": ("Abaqus", read_abaqus)}
LIBRARIES: tuple[tuple[str, Reader], ...] = (
    ("meshio", by_meshio),
    ("gmsh", by_gmsh),
    ("PyVista", by_pyvista),
)
READ = "a mesh that meshio, gmsh or PyVista reads"
MAX_REASON = 160  # of a reader's reason, in letters
DOUBT = re.compile(r"\b(warning|warn|error|err)\b", re.IGNORECASE)


def read_surface_mesh(path: Path, what: str, allowed: str = READ) -> SurfaceMesh:
    """The mesh in a file, with surface cells; `what` and `allowed` are words of errors. A reader
    that warns, or names nodes that are not there, counts if no other one reads the file."""
    check_file(path, what, allowed)
    check_end(path, what)
    if ending(path) == ".h5" and path.with_suffix(".xdmf").is_file():
        raise InputError(
            f"{what} {path} has numbers alone; allowed is its {path.with_suffix('.xdmf')}"
        )
    if ending(path) in NASTRAN:
        check_coordinate_systems(path, what)
    reasons: list[str] = []
    doubtful: list[SurfaceMesh] = []
    without: list[SurfaceMesh] = []
    own = [OWN[ending(path)]] if ending(path) in OWN else []
    for name, reader in (*own, *LIBRARIES):
        try:
            mesh, reason = _attempt(reader, path)
        except InputError as error:
            raise InputError(f"{what} {path} {error}") from None
        if mesh and mesh.sound and not reason:
            return mesh
        if mesh and len(mesh.points):
            (doubtful if mesh.cells else without).append(mesh)
        elif mesh or reason:
            reasons.append(f"{name}: {reason or 'no nodes in it'}")
    if doubtful:
        return doubtful[0]
    if without:
        others = sorted(next((mesh.others for mesh in without if mesh.others), {}))
        curves = ending(path) == ".msh" and "line" in others
        more = ": gmsh saves them too with Mesh.SaveAll = 1" if curves else ""
        raise InputError(
            f"{what} {path} holds no surface cells, but {others or 'nodes alone'}; allowed is "
            f"{allowed}, with triangles or quadrilaterals{more}"
        )
    why = "; ".join(reasons) or "no reader knows this ending"
    raise InputError(
        f"{what} {path} cannot be read as {path.suffix or 'a mesh'} ({why}); allowed is {allowed}"
    )


def _attempt(reader: Reader, path: Path) -> tuple[SurfaceMesh | None, str]:
    """The mesh that a reader finds, and its reason to fail or to doubt, "" if there is none."""
    lines: list[str] = []
    try:
        with ExitStack() as stack:
            # VTK reads legacy files in C's locale and stays there, where Python takes all text for
            # ASCII
            stack.callback(locale.setlocale, locale.LC_ALL, locale.setlocale(locale.LC_ALL))
            stack.enter_context(_printed(lines))
            mesh = reader(path)
    except InputError:
        raise
    except NotMine:
        return None, ""
    # the libraries raise whatever their parsing stumbles on, or exit
    except (Exception, SystemExit) as error:
        reasons = [_reason(error)], _first_of_vtk(lines), ["it gives no reason"]
        return None, next(filter(None, (_line(each, path) for each in reasons)))
    return mesh, _line(filter(DOUBT.search, _first_of_vtk(lines)), path)


def _reason(error):
    """The text of an error, with its kind where a text as a KeyError's is none without."""
    kind, text = type(error).__name__, " ".join(str(error).split())
    if kind in ("SystemExit", "VTKExecutionError"):  # what it follows from is printed
        return ""
    is_whole = not text or kind in ("Exception", "ReadError", "OtherFormat")
    return text if is_whole else f"{kind}: {text}"


def _first_of_vtk(lines):
    """VTK's first error without time and place, from which others follow; all lines without one."""
    errors = [line for line in lines if "ERR|" in line][:1]
    return [re.sub(r".*ERR\|( vtk\w* \(\w*\):)?", "Error:", line) for line in errors] or lines


def _line(lines, path):
    """One short line of a reader's text, without the file's name."""
    text = " ".join(" ".join(lines).split()).replace(str(path.absolute()), path.name)
    text = text.replace(str(path), path.name)
    text = re.sub(r"\x1b\[[0-9;]*m|Error: Couldn't read file .*", "", text)
    text = "".join(letter if letter.isprintable() else "?" for letter in text)
    text = text.strip(" ;").removeprefix("Error: ")
    return text if len(text) <= MAX_REASON else text[:MAX_REASON].rsplit(" ", 1)[0] + " ..."


@contextmanager
def _printed(lines: list[str]) -> Iterator[None]:
    """Add what the block prints, by Python or by libraries in C, to `lines`."""
    with TemporaryFile("w+", encoding="utf-8", errors="replace") as file:
        kept = []
        for stream, number in ((sys.stdout, 1), (sys.stderr, 2)):
            with suppress(OSError, ValueError, AttributeError):
                stream.flush()
            with suppress(OSError):  # a process may have closed it
                kept.append((number, os.dup(number)))
                os.dup2(file.fileno(), number)
        try:
            with redirect_stdout(file), redirect_stderr(file):
                yield
        finally:
            file.flush()
            for handler in logging.root.handlers:  # one that was made meanwhile
                if isinstance(handler, logging.StreamHandler) and handler.stream is file:
                    handler.setStream(sys.stderr)
            for number, copy in kept:
                os.dup2(copy, number)
                os.close(copy)
            file.seek(0)
            lines += file.read().splitlines()
