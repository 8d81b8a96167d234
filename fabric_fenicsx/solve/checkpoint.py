"""Checkpoints: an accepted state in one file that any number of ranks can go on from."""

import hashlib
import io
import json
import math
import re
import time
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from .. import dolfinx_compat as compat
from ..core.collective_errors import on_root
from ..core.errors import InputError
from ..core.files import plain, replace_file
from ..scene.scene import OF_CELLS, rescale_loads
from ..sheet.blank import Blank
from .progress import Progress, Viscosity

# entry of a problem whose run has stages, {number of a stage: its steps}
STAGES = "steps of stages"


class Checkpoint:
    """File `path` (.npz) with the last accepted state of `blank`. It identifies nodes by their
    position and by the cells around them, cells by their centres. problem: definition of the run, a
    dict that JSON can hold; a checkpoint of another problem is refused, but for `STAGES` that were
    added behind its own: loads are then those of the problem now."""

    FORMAT = 10  # counted up with each change of what the file holds
    YOUNG = 60.0  # s, in which a run is not worth the wait for the disk at each step
    PLACES = "x", "around"  # arrays of the nodes
    MEMORY = "memory "  # before the names of the terms' arrays
    # of the progress that JSON holds
    SCALARS = {each.name for each in fields(Progress)} - {"x", "previous", "viscosity", "memory"}

    def __init__(self, path: Path, blank: Blank, problem: Mapping[str, object]) -> None:
        self.path, self.blank, self.problem = path, blank, json.loads(json.dumps(plain(problem)))
        self.comm, self._lasting_from = blank.mesh.comm, time.monotonic() + self.YOUNG
        self.owned = blank.V.dofmap.index_map.size_local
        self._centres = blank.midpoints().T
        self._places = blank.coordinates()[: self.owned], self._around()
        self._known = [self.comm.gather(values) for values in self._places]

    def _around(self):
        """Sum of the vectors from each owned node to the centres of the cells around it, (owned
        nodes, gdim) [mm]: it tells nodes at one place apart, as on the two lips of a slit."""
        blank = self.blank
        vectors = self._centres[:, None] - blank.along(blank.coordinates().T).T[blank.cell_nodes]
        return blank.summed(vectors)[: self.owned]

    def save(self, progress: Progress, notes: dict[str, Any]) -> None:
        """Write a `Progress` and `notes` (for JSON); the file is complete at any moment, and is on
        the disk unless the run is `YOUNG`. Raises OSError if it can't be written."""
        gdim = self.blank.mesh.geometry.dim
        arrays = {"u": progress.x, "previous": progress.previous}
        arrays = {k: v.array.reshape(-1, gdim)[: self.owned] for k, v in arrays.items()}
        arrays |= {self.MEMORY + name: values for name, values in progress.memory.items()}
        if any(name.startswith(OF_CELLS) for name in progress.memory):
            arrays["centres"] = self._centres
        gathered = {name: self.comm.gather(values) for name, values in arrays.items()}
        if self.comm.rank != 0:
            return
        gathered |= dict(zip(self.PLACES, self._known))
        arrays = {name: np.concatenate(parts) for name, parts in gathered.items()}
        meta = {k: getattr(progress, k) for k in self.SCALARS}
        meta |= {"format": self.FORMAT, "problem": self.problem, "notes": notes}
        meta["viscosity"] = asdict(progress.viscosity)
        arrays["meta"] = np.array(json.dumps(plain(meta)))
        content = io.BytesIO()
        np.savez(content, checksum=np.array(_checksum(arrays)), **arrays)
        replace_file(self.path, content.getvalue(), time.monotonic() >= self._lasting_from)

    def load(
        self, memory: Mapping[str, np.ndarray] | None = None
    ) -> tuple[Progress, dict[str, Any]]:
        """The saved `Progress` and notes. memory: arrays that the scene's terms remember now; the
        saved ones must have their names and widths (None: any).

        Raises InputError, on all ranks, for a file that is missing, damaged, of another format,
        problem or mesh.
        """
        meta, arrays, share = on_root(self.comm, lambda: self._read(memory))
        self._lasting_from = 0.0
        places = np.hstack([arrays.pop(name) for name in self.PLACES])
        nodes = self._find(places, np.hstack(self._places), "nodes")
        cells = np.empty(0, int)
        if (centres := arrays.pop("centres", None)) is not None:
            cells = self._find(centres, self._centres, "cells")
        vectors = [compat.petsc_vector(self.blank.u).duplicate() for _ in range(2)]
        for vector, name in zip(vectors, ("u", "previous")):
            vector.array[:] = arrays.pop(name)[nodes].ravel()
        remembered = {k.removeprefix(self.MEMORY): values for k, values in arrays.items()}
        for name, values in remembered.items():
            remembered[name] = values[cells if name.startswith(OF_CELLS) else nodes]
        state, notes = {k: meta[k] for k in self.SCALARS} | {"memory": remembered}, meta["notes"]
        state["viscosity"] = Viscosity(**meta["viscosity"])
        if share < 1:
            for name in ("load", "step", "last_step"):
                state[name] = state[name] and share * state[name]
            for row in notes["rows"]:
                row["load"] *= share
            notes["states"] = [(share * load, ranks) for load, ranks in notes["states"]]
            rescale_loads(remembered, share)
        return Progress(*vectors, **state), notes

    def _find(self, saved, places, kind):
        """Indices of the `saved` nodes or cells (n, k) at this rank's `places` (m, k)."""
        count, off, nearest = self.comm.allreduce(len(places)), math.inf, np.empty(0, int)
        gdim = self._centres.shape[1]
        if saved.shape[1] == places.shape[1]:  # both in a plane, or both in space
            distance, nearest = cKDTree(saved).query(places)
            off = self.comm.allreduce(distance.max(initial=0.0), MPI.MAX)
        is_other = count != len(saved) or off > 1e-9 * np.ptp(saved[:, :gdim], axis=0).max()
        if is_other or self.comm.allreduce(np.bincount(nearest, minlength=count)).max() > 1:
            fault = "or they lie elsewhere" if is_other else "of which some lie at one place"
            raise InputError(
                f"checkpoint {self.path} is of another mesh, with {len(saved)} {kind}; now there "
                f"are {count}, {fault}"
            )
        return nearest

    def _read(self, memory):
        """Meta data and arrays of the file, and the share of the load that its stages take."""
        name = f"checkpoint {self.path}"
        if not self.path.is_file():
            raise InputError(f"`resume=True` finds no {name}; it needs the `out` of a run")
        try:
            with np.load(self.path) as file:
                arrays = {k: file[k] for k in file.files}
            checksum, meta = str(arrays.pop("checksum", "")), json.loads(str(arrays["meta"]))
            if (version := meta.get("format", 1)) != self.FORMAT:
                raise ValueError(f"it has format {version}; this version reads {self.FORMAT}")
            if checksum != _checksum(arrays):
                raise ValueError("its content has another checksum")
        except Exception as e:  # readers raise whatever their parsing stumbles on
            reason = " ".join(str(e).split()) or type(e).__name__
            raise InputError(f"{name} cannot be read ({reason})") from None
        del arrays["meta"]
        share, mark = self._share(meta["problem"]), self.MEMORY
        of_terms = {k.removeprefix(mark): v for k, v in arrays.items() if k.startswith(mark)}
        saved, now = (
            ", ".join(f"{k} {values.shape[1:]}" for k, values in sorted(each.items()))
            for each in (of_terms, memory or {})
        )
        if memory is not None and (saved or meta["accepted"]) and saved != now:
            raise InputError(
                f"{name} has memory {saved or 'nothing'} where the terms have {now or 'nothing'}"
            )
        return meta, arrays, share

    def _share(self, before):
        """Share of the load that the stages `before` take; InputError for another problem."""
        known, steps = (list(each.get(STAGES, {}).values()) for each in (before, self.problem))
        # what may be another then: the entry `press` says how tools and holders move
        moves, count = re.compile(r"(\S+\.)?(path|force|pressure) of term "), len(known)
        added = 0 < count < len(steps) and steps[:count] == known
        for key, now in self.problem.items():
            if added:
                number = re.match(rf"(?:press\.stage|{STAGES})\.(\d+)", key)
                if key == STAGES or moves.match(key) or (number and int(number[1]) > count):
                    continue
                if key == "press":
                    now = now | {"stage": now["stage"][:count]}
            if (was := before.get(key)) != now:
                raise InputError(
                    f"checkpoint {self.path} was made with {key} = {was}, now it is {now}; use "
                    "the same problem, or restart (`overwrite`)"
                )
        return sum(known) / sum(steps) if added else 1.0


def _checksum(arrays):
    digest = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        digest.update(f"{name} {values.dtype} {values.shape} ".encode() + values.tobytes())
    return digest.hexdigest()
