"""Check of what is installed, each piece by itself.

Nothing outside the standard library is imported before its turn, so that what is missing or broken
is told in words.
"""

import os
import platform
import re
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from importlib.metadata import version as installed
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from ..runtime.child import in_child
from ..runtime.signals import end_with_reader
from ..runtime.version import __version__

if TYPE_CHECKING:
    from mpi4py import MPI

PATIENCE = 60  # seconds to draw
LONG = 300  # characters of a reason
DRAWING = f"from {__name__} import draw_triangle; draw_triangle()"  # in a process of its own


def world() -> "MPI.Comm | None":
    """All ranks; None where mpi4py or its MPI is missing, which `show` then tells."""
    try:
        from mpi4py import MPI
    except (ImportError, RuntimeError):
        return None
    return MPI.COMM_WORLD


def show(comm: "MPI.Comm | None") -> int:
    """Print versions, presets and checks on rank 0; returns the exit status on all ranks: 0 if all
    is well, else 1."""
    # compiled forms in an empty place, so that one is compiled
    with tempfile.TemporaryDirectory() as cache, patch.dict(os.environ, XDG_CACHE_HOME=cache):
        with suppress(Exception):  # told below
            import_module("dolfinx")  # on all ranks, which PETSc starts together
        end_with_reader()  # after PETSc, which has a handler of its own
        first = comm is None or comm.rank == 0
        told = [("presets", _presets), *VERSIONS.items()] if first else []
        well = all([_told(*each) for each in told]) & _checks(comm, first)
    if comm is not None and comm.size > 1:
        well = all(comm.allgather(well))
    return 0 if well else 1


def _told(name, find):
    """Print what is found; whether that works."""
    try:
        text, well = find(), True
    except ImportError as error:
        text, well = f"missing ({error})", False
    except Exception as error:
        text, well = f"broken ({_reason(error)})", False
    print(f"{name:15} {text}")
    return well


def _presets():
    from ..material.presets import PRESETS

    return ", ".join(PRESETS)


def _checks(comm, first):
    well = True
    for name, (check, on_all_ranks) in CHECKS.items():
        if not (first or on_all_ranks):
            continue
        start, result = time.perf_counter(), "ok"
        try:
            text = check(comm) or ""
        except Exception as error:
            well, result, text = False, "fails", _reason(error)
        if first:
            seconds = time.perf_counter() - start
            print(f"{name:15} {result:5} {seconds:6.2f} s  {text}".rstrip(), flush=True)
    return well


def _reason(error):
    """The text of an exception in one line; of long ones the end, where the reason is."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    text = lines[-1] if lines else "no reason given"
    text = text if len(text) <= LONG else f"... {text[-LONG:]}"
    return text if isinstance(error, RuntimeError) else f"{type(error).__name__}: {text}"


def _attribute(module):
    return import_module(module).__version__


# by name: a function that returns the version
IMPORTED = "dolfinx", "ufl", "petsc4py", "mpi4py", "numpy", "scipy", "gmsh"
VERSIONS: dict[str, Callable[[], Any]] = {
    "fabric_fenicsx": lambda: __version__,
    "python": platform.python_version,
    **{name: partial(_attribute, name) for name in IMPORTED},
    "petsc": lambda: ".".join(map(str, import_module("petsc4py.PETSc").Sys.getVersion())),
    "MPI library": lambda: re.split("[,\n]", import_module("mpi4py.MPI").Get_library_version())[0],
    "VTK": lambda: import_module("vtkmodules.vtkCommonCore").vtkVersion.GetVTKVersion(),
    **{name: partial(installed, name) for name in ("meshio", "pyvista", "ezdxf", "shapely")},
}


def _ranks(comm):
    from mpi4py import MPI  # which says why it can't be imported

    comm = comm or MPI.COMM_WORLD
    total = comm.allreduce(comm.rank + 1)
    if total != comm.size * (comm.size + 1) // 2:
        raise RuntimeError(f"the sum of 1 to {comm.size} over the ranks came out as {total}")
    return f"{comm.size} rank{'s' * (comm.size > 1)}"


def _mumps(comm):
    """CPU seconds of a standard piece of work, by which machines compare: one core factorises the
    Laplacian of a cube of 27 x 27 x 27 nodes, the best time of three."""
    from petsc4py import PETSc
    from scipy import sparse

    n = 27
    line = sparse.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n))
    laplacian = sparse.kronsum(sparse.kronsum(line, line), line).tocsr()
    rows = [each.astype(PETSc.IntType) for each in (laplacian.indptr, laplacian.indices)]
    A = PETSc.Mat().createAIJ(laplacian.shape, csr=(*rows, laplacian.data), comm=PETSc.COMM_SELF)
    A.setOption(PETSc.Mat.Option.SPD, True)
    times = []
    for _ in range(3):
        pc = PETSc.PC().create(PETSc.COMM_SELF)
        pc.setOperators(A)
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        began = time.process_time()
        pc.setUp()
        times.append(time.process_time() - began)
    x, b = A.createVecs()
    x.set(1.0)
    A.mult(x, b)
    pc.apply(b, x)
    x.shift(-1.0)
    if not (error := x.norm()) < 1e-8:
        raise RuntimeError(f"the solution of {n**3} equations is off by {error:.2g}")
    return f"{min(times):.2f} s of CPU for the standard factorisation of {n**3} unknowns"


def _blas(comm):
    """The BLAS of the system that PETSc calls, as this process has loaded it."""
    import_module("petsc4py.PETSc")
    with open("/proc/self/maps") as maps:
        files = {line.split()[-1] for line in maps if re.search(r"/lib\w*blas\w*[.-]", line)}
    # NumPy's wheels bring one of their own
    found = sorted(file for file in files if ".libs/" not in file)
    if not found:
        raise RuntimeError("no shared BLAS is loaded with PETSc")
    return describe_blas(found)


def describe_blas(files: list[str]) -> str:
    """Name of the BLAS of these shared libraries, and of a faster one."""
    names = ", ".join(files)
    if "openblas" in names:
        return f"OpenBLAS ({names})"
    faster = "MUMPS is up to five times faster with OpenBLAS (apt install libopenblas0-serial)"
    return f"reference ({names}); {faster}" if "/libblas.so" in names else names


def _jit(comm):
    """Compile the area of one triangle and assemble it."""
    import numpy as np
    import ufl
    from dolfinx import fem
    from mpi4py import MPI

    from .. import dolfinx_compat as compat

    corners = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    cells = np.array([[0, 1, 2]], dtype=np.int64)
    mesh = compat.create_mesh(MPI.COMM_SELF, cells, corners, "triangle", 1)
    area = fem.assemble_scalar(compat.form(fem.Constant(mesh, 1.0) * ufl.dx(mesh)))
    if abs(area - 0.5) > 1e-12:
        raise RuntimeError(f"a triangle of area 0.5 has {area:.6g}")


def _gmsh(comm):
    """Mesh a square, with 4 cells or so along each side."""
    from ..meshes.specimen import specimen

    if (count := len(specimen(1.0, 1.0, 4, 4, "unstructured")[1])) < 16:
        raise RuntimeError(f"the mesh of a square has {count} cells")


def _pyvista(comm):
    """Draw in a process of its own, as VTK may take it down where there is no screen."""
    try:
        in_child(exec, DRAWING, patience=PATIENCE)
    except RuntimeError as error:
        hint = "found nothing to draw on? (libegl1 on Debian 12, xvfb on 13)"
        raise RuntimeError(
            f"{error}; VTK {hint}" if "crashed" in str(error) else str(error)
        ) from None


def draw_triangle() -> None:
    """Draw a red triangle on white as the package's pictures are drawn; an exception if none is
    seen."""
    import numpy as np
    import pyvista

    from ..plot.space import drawing

    with drawing((200, 100)) as plotter:
        plotter.add_mesh(pyvista.Triangle(), color="red", lighting=False)
        plotter.view_xy()
        image = np.asarray(plotter.screenshot(None, return_img=True))
    if not 0.02 < (image.min(-1) < 50).mean() < 0.9:
        raise RuntimeError("the picture of a triangle is blank or wrong")


# by name: a function that returns what else is to be said, or raises; True if all ranks take part
CHECKS: dict[str, tuple[Callable[["MPI.Comm | None"], str | None], bool]] = {
    "MPI": (_ranks, True),
    "MUMPS": (_mumps, False),
    "BLAS": (_blas, False),
    "JIT": (_jit, False),
    "gmsh": (_gmsh, False),
    "pyvista": (_pyvista, False),
}
