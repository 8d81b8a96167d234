"""Checkpoints: an accepted state in one file that any number of ranks can go on from."""

import dataclasses
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from .. import dolfinx_compat as compat
from ..runtime.errors import InputError
from ..runtime.files import replace_file
from ..scene.scene import OF_CELLS
from ..sheets.blank import Blank
from .progress import Progress
from .viscosity import Viscosity

# of the file; the first told a slit's lips apart by chance, those after it had other names, and
# none of the first five the numbers of terms
FORMAT = 6
COUNTS = ("accepted", "rejected", "iterations")
SCALARS = ("load", "step", "last_step", "work", "stored", "solver", *COUNTS)
NODAL = ("x", "around", "u", "previous")
MEMORY = "memory "  # before the names of the terms' arrays
CELLS = MEMORY + OF_CELLS  # and of those of cells
CENTRES = "centres"  # of the cells, where a term remembers some


class Checkpoint:
    """A file `path` (.npz) with the last accepted state of `blank`. It identifies nodes by their
    position and by the cells around them, cells by their centres.

    problem: what defines the run, a dict that JSON can hold. A checkpoint of another problem is
    refused.
    """

    def __init__(self, path: Path, blank: Blank, problem: dict[str, Any]) -> None:
        self.path, self.blank, self.problem = path, blank, json.loads(json.dumps(problem))
        self.comm = blank.mesh.comm
        self.owned = blank.V.dofmap.index_map.size_local
        self._places = blank.coordinates()[: self.owned], self._around()
        self._known = [self.comm.gather(values) for values in self._places]
        self._centres = blank.midpoints().T

    def _around(self):
        """Sum of the arms from each owned node to the centres of the cells around it, (owned nodes,
        gdim) [mm]: it tells nodes at one place apart, as on the two lips of a slit."""
        blank = self.blank
        centres = blank.midpoints().T
        nodes = compat.dofmap(blank.V)[: len(centres)]
        arms = centres[:, None] - blank.along(blank.coordinates().T).T[nodes]
        return blank.summed(arms)[: self.owned]

    def save(self, progress: Progress, notes: dict[str, Any]) -> None:
        """Write a `Progress` and `notes` (for JSON); the file is complete at any moment. Raises
        OSError if it can't be written."""
        gdim = self.blank.mesh.geometry.dim
        parts = {}
        for name, vector in (("u", progress.x), ("previous", progress.previous)):
            parts[name] = self.comm.gather(vector.array.reshape(-1, gdim)[: self.owned])
        memory = {
            MEMORY + name: self.comm.gather(values) for name, values in progress.memory.items()
        }
        if any(name.startswith(CELLS) for name in memory):
            memory[CENTRES] = self.comm.gather(self._centres)
        if self.comm.rank != 0:
            return
        parts |= memory
        meta = {"format": FORMAT, "problem": self.problem, "notes": notes} | {
            k: getattr(progress, k) for k in SCALARS
        }
        meta["viscosity"] = dataclasses.asdict(progress.viscosity)
        content = io.BytesIO()
        arrays = {k: np.concatenate(v) for k, v in (parts | dict(zip(NODAL, self._known))).items()}
        np.savez(content, meta=json.dumps(meta), **arrays)
        replace_file(self.path, content.getvalue(), lasting=True)

    def load(
        self,
        memory: Mapping[str, np.ndarray] | None = None,
        solver: Mapping[str, Any] | None = None,
    ) -> tuple[Progress, dict[str, Any]]:
        """The saved `Progress` and notes. memory, solver: what scene and solver would give now,
        whose names and shapes the saved ones must have (None: any).

        Raises InputError, on all ranks, if there is no such file, if something in it is missing, of
        another shape or not finite, and if it is of another problem, mesh or version.
        """
        content = self.comm.bcast(self._read(memory, solver) if self.comm.rank == 0 else None)
        if isinstance(content, str):
            raise InputError(content)
        meta, arrays = content
        places = np.hstack([arrays["x"], arrays["around"]])
        node = self._found(places, np.hstack(self._places), np.ptp(arrays["x"], axis=0), "nodes")
        cell = node
        if CENTRES in arrays:
            centres = arrays[CENTRES]
            cell = self._found(centres, self._centres, np.ptp(centres, axis=0), "cells")
        vectors = [compat.petsc_vector(self.blank.u).duplicate() for _ in range(2)]
        for vector, name in zip(vectors, ("u", "previous")):
            vector.array[:] = arrays[name][node].ravel()
        remembered = {
            k.removeprefix(MEMORY): values[cell if k.startswith(CELLS) else node]
            for k, values in arrays.items()
            if k.startswith(MEMORY)
        }
        state = {k: meta[k] for k in SCALARS} | {
            "viscosity": Viscosity(**meta["viscosity"]),
            "memory": remembered,
        }
        return Progress(x=vectors[0], previous=vectors[1], **state), meta["notes"]

    def _found(self, saved, places, extent, what):
        """Which of the `saved` nodes or cells (n, k) those at this rank's `places` (m, k) are."""
        count = self.comm.allreduce(len(places))
        distance, which = cKDTree(saved).query(places)
        off = self.comm.allreduce(distance.max(initial=0.0), MPI.MAX)
        if count != len(saved) or off > 1e-9 * extent.max():
            raise InputError(
                f"checkpoint {self.path} is of another mesh, with {len(saved)} {what}, now there "
                f"are {count} or they lie elsewhere; allowed is the same mesh"
            )
        if self.comm.allreduce(np.bincount(which, minlength=count)).max() > 1:
            amid = " amid the same cells" if what == "nodes" else ""
            raise InputError(
                f"checkpoint {self.path} has {what} that lie at one place{amid}; "
                f"allowed is a mesh whose {what} can be told apart"
            )
        return which

    def _read(self, memory, solver):
        """Meta data and arrays of the file, or what is wrong with it."""
        if not self.path.is_file():
            return (
                f"`resume=True` finds no checkpoint {self.path}; allowed is the `out` "
                "of a run that was begun"
            )
        try:
            with np.load(self.path) as file:
                meta = json.loads(str(file["meta"]))
                arrays = {k: file[k] for k in file.files if k != "meta"}
        except Exception as e:  # readers raise whatever their parsing stumbles on
            reason = " ".join(str(e).split()) or type(e).__name__
            return (
                f"checkpoint {self.path} cannot be read ({reason}); allowed is "
                "one that a study wrote"
            )
        version = meta.get("format", 1) if isinstance(meta, dict) else None
        if version != FORMAT:
            return (
                f"checkpoint {self.path} is of format {version}; allowed is {FORMAT}, "
                "which this version writes"
            )
        wrong = self._wrong_meta(meta, solver) or self._wrong_arrays(
            arrays, memory, begun=bool(meta["accepted"])
        )
        if wrong:
            return f"checkpoint {self.path} is damaged: {wrong}; allowed is one that a study wrote"
        for key, now in self.problem.items():
            if meta["problem"].get(key) != now:
                return (
                    f"checkpoint {self.path} was made with {key} = {meta['problem'].get(key)}, "
                    f"now it is {now}; allowed is the same problem, or a run "
                    "that begins anew (`overwrite`)"
                )
        return meta, arrays

    @staticmethod
    def _wrong_meta(meta, solver):
        """What is missing in the meta data, or is no number where it should be one."""
        missing = [k for k in ("problem", "notes", "viscosity", *SCALARS) if k not in meta]
        if missing:
            return f"{', '.join(missing)} is missing"
        for name in ("problem", "notes", "viscosity", "solver"):
            if not isinstance(meta[name], dict):
                return f"{name} is {meta[name]!r}"
        fields = [f.name for f in dataclasses.fields(Viscosity)]
        if sorted(meta["viscosity"]) != sorted(fields):
            return (
                f"viscosity has {', '.join(meta['viscosity']) or 'nothing'} where "
                f"{', '.join(fields)} should be"
            )
        if solver is not None and meta["solver"] and sorted(meta["solver"]) != sorted(solver):
            return f"solver has {', '.join(meta['solver'])} where {', '.join(solver)} should be"
        numbers = (
            {k: meta[k] for k in SCALARS if k != "solver"} | meta["viscosity"] | meta["solver"]
        )
        if meta["last_step"] is None:  # before the first step
            del numbers["last_step"]
        for name, value in numbers.items():
            if not isinstance(value, (int, float)) or not math.isfinite(value):
                return f"{name} is {value!r}"
        if not (0 <= meta["load"] <= 1 and meta["step"] > 0):
            return f"load is {meta['load']} and step {meta['step']}"
        for name in COUNTS:
            if not isinstance(meta[name], int) or meta[name] < 0:
                return f"{name} is {meta[name]}"
        return ""

    def _wrong_arrays(self, arrays, memory, begun):
        """What is missing in the arrays, of another shape or not finite."""
        of_cells = any(k.startswith(CELLS) for k in arrays)
        fixed = (*NODAL, CENTRES) if of_cells else NODAL
        missing = [k for k in fixed if k not in arrays]
        if missing:
            return f"{', '.join(missing)} is missing"
        gdim, nodes = self.blank.mesh.geometry.dim, len(np.atleast_1d(arrays["x"]))
        cells = len(np.atleast_1d(arrays[CENTRES])) if of_cells else 0
        shapes = {"x": (nodes, 3), "around": (nodes, gdim), CENTRES: (cells, gdim)}
        shapes |= {"u": (nodes, gdim), "previous": (nodes, gdim)}
        names = sorted(k.removeprefix(MEMORY) for k in arrays if k not in fixed)
        if memory is not None and (names or begun):
            if names != sorted(memory):
                return (
                    f"it remembers {', '.join(names) or 'nothing'} where "
                    f"{', '.join(memory) or 'nothing'} should be"
                )
            for name, values in memory.items():
                rows = cells if name.startswith(OF_CELLS) else nodes
                shapes[MEMORY + name] = rows, *values.shape[1:]
        for name in (*fixed, *(k for k in arrays if k not in fixed)):
            values, rows = arrays[name], cells if name.startswith(CELLS) else nodes
            shape = shapes.get(name, (rows, *values.shape[1:]))
            if values.shape != shape:
                return f"{name} has shape {values.shape} where {shape} should be"
            if values.dtype.kind != "f" or not np.isfinite(values).all():
                return f"{name} has values that are no finite numbers"
        return ""
