"""Checkpoints: an accepted state in one file that any number of ranks can go on from."""

import io
import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from .. import dolfinx_compat as compat
from ..blank import Blank
from ..errors import InputError
from ..running import replace
from .stepping import Progress, Viscosity

SCALARS = ("load", "step", "last_step", "work", "solver", "accepted", "rejected", "iterations")


class Checkpoint:
    """`path` (.npz) with the last accepted state of `blank`, its nodes known by their position.

    problem: what defines the run, a dict that JSON can hold; a checkpoint of another problem is refused.
    """

    def __init__(self, path: Path, blank: Blank, problem: dict[str, Any]) -> None:
        self.path, self.blank, self.problem = path, blank, json.loads(json.dumps(problem))
        self.comm = blank.mesh.comm
        self.owned = blank.V.dofmap.index_map.size_local
        self._x = self.comm.gather(blank.coordinates()[: self.owned])

    def save(self, progress: Progress, notes: dict[str, Any]) -> None:
        """Write a `Progress` and `notes` (for JSON); the file is whole at any moment. Raises OSError where it can't be."""
        gdim = self.blank.mesh.geometry.dim
        parts = {}
        for name, vector in (("u", progress.x), ("previous", progress.previous)):
            parts[name] = self.comm.gather(vector.array.reshape(-1, gdim)[: self.owned])
        memory = {f"memory {name}": self.comm.gather(values) for name, values in progress.memory.items()}
        if self.comm.rank != 0:
            return
        parts |= memory
        meta = {"problem": self.problem, "notes": notes, "viscosity": asdict(progress.viscosity)} | {
            k: getattr(progress, k) for k in SCALARS
        }
        content = io.BytesIO()
        arrays = {k: np.concatenate(v) for k, v in parts.items()}
        np.savez(content, meta=json.dumps(meta), x=np.concatenate(self._x), **arrays)
        replace(self.path, content.getvalue(), lasting=True)

    def load(self) -> tuple[Progress, dict[str, Any]]:
        """The saved `Progress` and notes; raises InputError, on all ranks, if there is none of this problem."""
        content = self.comm.bcast(self._read() if self.comm.rank == 0 else None)
        if isinstance(content, str):
            raise InputError(content)
        meta, x, u, previous, memory = content
        distance, node = cKDTree(x).query(self.blank.coordinates()[: self.owned])
        nodes, size = self.comm.allreduce(self.owned), np.ptp(x, axis=0).max()
        if nodes != len(x) or self.comm.allreduce(distance.max(initial=0.0), MPI.MAX) > 1e-9 * size:
            raise InputError(
                f"checkpoint {self.path} is of another mesh, with {len(x)} nodes, now there are {nodes} or they lie elsewhere; allowed is the same mesh"
            )
        vectors = [compat.petsc_vector(self.blank.u).duplicate() for _ in range(2)]
        for vector, values in zip(vectors, (u, previous)):
            vector.array[:] = values[node].ravel()
        memory = {name: values[node] for name, values in memory.items()}
        state = {k: meta[k] for k in SCALARS} | {"viscosity": Viscosity(**meta["viscosity"]), "memory": memory}
        return Progress(x=vectors[0], previous=vectors[1], **state), meta["notes"]

    def _read(self):
        """Content of the file, or what is wrong with it."""
        try:
            with np.load(self.path) as file:
                meta = json.loads(str(file["meta"]))
                arrays = [file[k] for k in ("x", "u", "previous")]
                memory = {k.removeprefix("memory "): file[k] for k in file if k.startswith("memory ")}
        except FileNotFoundError:
            return f"--resume finds no checkpoint {self.path}; allowed is the --out of a run that was begun"
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as e:
            return f"checkpoint {self.path} cannot be read ({e}); allowed is one that a study wrote"
        for key, now in self.problem.items():
            if meta["problem"].get(key) != now:
                return f"checkpoint {self.path} was made with {key} = {meta['problem'].get(key)}, now it is {now}; allowed is the same problem"
        return meta, *arrays, memory
