"""Checkpoints: an accepted state in one file that any number of ranks can go on from."""

import dataclasses
import hashlib
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

FORMAT = 7  # counted up with each change of what the file holds
COUNTS = ("accepted", "rejected", "iterations")
SCALARS = ("load", "step", "last_step", "work", "stored", "solver", *COUNTS)
PLACES = ("x", "around")  # of the nodes
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
        parts |= memory | dict(zip(PLACES, self._known))
        meta = {"format": FORMAT, "problem": self.problem, "notes": notes} | {
            k: getattr(progress, k) for k in SCALARS
        }
        meta["viscosity"] = dataclasses.asdict(progress.viscosity)
        arrays = {"meta": np.array(json.dumps(meta))}
        arrays |= {name: np.concatenate(values) for name, values in parts.items()}
        content = io.BytesIO()
        np.savez(content, checksum=np.array(_checksum(arrays)), **arrays)
        replace_file(self.path, content.getvalue(), lasting=True)

    def load(
        self, memory: Mapping[str, np.ndarray] | None = None
    ) -> tuple[Progress, dict[str, Any]]:
        """The saved `Progress` and notes. memory: the arrays that the scene's terms remember now;
        the saved ones must have their names and widths (None: any).

        Raises InputError, on all ranks, if there is no such file, if it is damaged or of another
        format, and if it is of another problem or mesh.
        """
        content = self.comm.bcast(self._read(memory) if self.comm.rank == 0 else None)
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
        count, off, which = self.comm.allreduce(len(places)), math.inf, np.empty(0, int)
        if saved.shape[1] == places.shape[1]:  # both in a plane, or both in space
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

    def _read(self, memory):
        """Meta data and arrays of the file, or what is wrong with it."""
        if not self.path.is_file():
            return (
                f"`resume=True` finds no checkpoint {self.path}; allowed is the `out` "
                "of a run that was begun"
            )
        try:
            with np.load(self.path) as file:
                arrays = {k: file[k] for k in file.files}
            meta = json.loads(str(arrays["meta"]))
            version = meta.get("format", 1)
        except Exception as e:  # readers raise whatever their parsing stumbles on
            reason = " ".join(str(e).split()) or type(e).__name__
            return (
                f"checkpoint {self.path} cannot be read ({reason}); allowed is "
                "one that a study wrote"
            )
        if version != FORMAT:
            return (
                f"checkpoint {self.path} is of format {version}; allowed is {FORMAT}, "
                "which this version writes"
            )
        if str(arrays.pop("checksum", "")) != _checksum(arrays):
            return (
                f"checkpoint {self.path} is damaged, as its content has another checksum; "
                "allowed is one that a study wrote"
            )
        del arrays["meta"]
        for key, now in self.problem.items():
            if meta["problem"].get(key) != now:
                return (
                    f"checkpoint {self.path} was made with {key} = {meta['problem'].get(key)}, "
                    f"now it is {now}; allowed is the same problem, or a run "
                    "that begins anew (`overwrite`)"
                )
        saved = _sizes({k: v for k, v in arrays.items() if k.startswith(MEMORY)})
        now = _sizes({MEMORY + k: v for k, v in (memory or {}).items()})
        if memory is not None and (saved or meta["accepted"]) and saved != now:
            return (
                f"checkpoint {self.path} remembers {_listed(saved)} where the terms remember "
                f"{_listed(now)}; allowed is the same problem"
            )
        return meta, arrays


def _checksum(arrays):
    """SHA-256 of arrays by name."""
    digest = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        digest.update(f"{name} {values.dtype} {values.shape} ".encode() + values.tobytes())
    return digest.hexdigest()


def _sizes(memory):
    """{name: numbers a node or cell} of arrays that terms remember."""
    return {name.removeprefix(MEMORY): values.shape[1:] for name, values in memory.items()}


def _listed(sizes):
    words = (f"{name} {size}" for name, size in sorted(sizes.items()))
    return ", ".join(words) or "nothing"
