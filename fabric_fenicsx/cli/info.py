"""What is installed, and whether each piece of it works by itself: nothing outside the standard
library is imported before its turn, so that missing ones are reported."""

import os
import platform
import re
import tempfile
import time
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest.mock import patch

from ..core.processes import end_with_reader, in_child
from ..core.version import __version__


def world() -> Any:
    """All ranks; None where mpi4py or its MPI is missing, which `show` then tells."""
    with suppress(ImportError, RuntimeError):
        return import_module("mpi4py.MPI").COMM_WORLD


def show(comm: Any) -> int:
    """Print versions, presets and checks on rank 0; the exit status: 0 if all is well, else 1."""
    status = 0
    # compiled forms in an empty place, so that one is compiled
    with tempfile.TemporaryDirectory() as cache, patch.dict(os.environ, XDG_CACHE_HOME=cache):
        with suppress(Exception):  # reported below
            import_module("dolfinx")  # on all ranks, which PETSc starts together
        end_with_reader()  # after PETSc, which has a handler of its own
        if comm is None or comm.rank == 0:
            parts = [(name, version, "") for name, version in VERSIONS.items()]
            works = [_tell(*each) for each in (*parts, *((n, c, "ok") for n, c in CHECKS.items()))]
            status = int(not all(works))
    return comm.bcast(status) if comm else status


def _tell(name, act, well):
    """Print behind the word `well` what `act` returns, or the version of the package that it names,
    or why that fails; whether it works."""
    began, result = time.perf_counter(), well
    try:
        words = act() if callable(act) else import_module(act).__version__
    except Exception as error:
        last = ["?", *str(error).strip().splitlines()][-1].strip()
        result, words = "fails", f"{type(error).__name__}: {last[-300:]}"
    cost = f" {time.perf_counter() - began:.2f} s" if well else ""
    print(f"{name:15} {f'{result}{cost} {words}'.strip()}", flush=True)
    return result == well


def _mumps():
    from petsc4py import PETSc

    A = PETSc.Mat().createAIJ((1, 1), csr=([0, 1], [0], [2.0]), comm=PETSc.COMM_SELF)
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setOperators(A)
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    x, b = A.createVecs()
    b.array[:] = 3.0
    pc.apply(b, x)
    return f"solution of an equation {x.array[0]:.9g}"


def _blas():
    """The BLAS of the system that PETSc calls, as this process has loaded it, and a faster one."""
    import_module("petsc4py.PETSc")
    files = set(re.findall(r"\S*/lib\w*blas\S*", Path("/proc/self/maps").read_text()))
    names = ", ".join(sorted(file for file in files if ".libs/" not in file))  # not NumPy's own
    slow = "/libblas.so" in names and "openblas" not in names
    return names + "; libopenblas0-serial makes MUMPS up to five times faster" * slow


def _jit():
    import ufl
    from dolfinx import fem, mesh
    from mpi4py import MPI

    from .. import dolfinx_compat as compat

    square = mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    area = fem.assemble_scalar(compat.form(fem.Constant(square, 1.0) * ufl.dx(square)))
    return f"area of a unit square {area:.6g}"


def _gmsh():
    cells = import_module("fabric_fenicsx.sheet.specimen").specimen(1, 1, 4, 4, "unstructured")[1]
    return f"{len(cells)} cells in a square"


def _pyvista():
    """Draw in a process of its own, as VTK may take it down where there is no screen."""
    try:
        return in_child(draw_triangle, patience=60.0)
    except RuntimeError as error:
        raise RuntimeError(f"{error} (libegl1 on Debian 12, xvfb on 13?)") from None


def draw_triangle() -> str:
    """Draw a red triangle as the package's pictures are drawn; RuntimeError if none is seen."""
    import numpy as np
    import pyvista

    from ..results.space import drawing

    with drawing() as plotter:
        plotter.add_mesh(pyvista.Triangle(), color="red", lighting=False)
        plotter.view_xy()
        image = np.asarray(plotter.screenshot(None, return_img=True))
    if not 0.02 < (image.min(-1) < 50).mean() < 0.9:
        raise RuntimeError("the picture of a triangle is blank or wrong")
    return ""


# what each returns is said; what it raises is why it fails
NAMES = "dolfinx ufl petsc4py mpi4py numpy scipy gmsh meshio pyvista ezdxf shapely"
VERSIONS = {
    "presets": lambda: ", ".join(import_module("fabric_fenicsx.material.presets").PRESETS),
    "fabric_fenicsx": lambda: __version__,
    "python": platform.python_version,
    **{name: name for name in NAMES.split()},
    "petsc": lambda: ".".join(map(str, import_module("petsc4py.PETSc").Sys.getVersion())),
    "MPI library": lambda: re.split("[,\n]", import_module("mpi4py.MPI").Get_library_version())[0],
    "VTK": lambda: import_module("vtkmodules.vtkCommonCore").vtkVersion.GetVTKVersion(),
}
CHECKS = {
    "MPI": lambda: f"{world().size} rank(s)",
    "MUMPS": _mumps,
    "BLAS": _blas,
    "JIT": _jit,
    "gmsh": _gmsh,
    "pyvista": _pyvista,
}
