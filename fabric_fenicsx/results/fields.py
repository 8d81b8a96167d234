"""Fields of a membrane, as means over its cells, and their time series for ParaView."""

import numpy as np
import pyvista
from dolfinx import fem

from .. import dolfinx_compat as compat
from ..material import stability


def cell_fields(membrane):
    """Fields on this rank's owned cells, {name: array (cells,) or (cells, 3)}, and the kernel's mismatch there.

    a, b: deformed fibres [-]; eps_a, eps_b: nominal, log_eps_11, log_eps_22: logarithmic fibre strains [-];
    shear_angle [rad]; I4, I6, I8, I10; energy_a, energy_b, energy_shear [N mm/mm3]; strain_state 1..4, eq. (13);
    sigma_a, sigma_b: Cauchy stress along the deformed fibres [MPa]; stability_convexity, stability_ellipticity: the smallest
    indicators of a cell's points [-], 1 at rest and negative where the law itself allows a band, see `material.stability`.
    """
    state, fa, fb, mismatch = membrane.state()
    weights = membrane.weights

    def mean(values):
        return np.einsum("q,cq...->c...", weights, values)

    I4, I6, I8, I10 = np.moveaxis(state.invariants, -1, 0)
    parts = mean(state.energy_parts)
    fields = {"a": mean(fa), "b": mean(fb)}
    fields |= {"eps_a": mean(np.sqrt(I4) - 1), "eps_b": mean(np.sqrt(I8) - 1)}
    fields |= {"log_eps_11": mean(np.log(I4)) / 2, "log_eps_22": mean(np.log(I8)) / 2, "shear_angle": mean(I10)}
    fields |= {"I4": mean(I4), "I6": mean(I6), "I8": mean(I8), "I10": fields["shear_angle"]}
    fields |= {"energy_a": parts[:, 0], "energy_b": parts[:, 1], "energy_shear": parts[:, 2]}
    fields["strain_state"] = (1 + (fields["eps_b"] <= 0) + 2 * (fields["eps_a"] <= 0)).astype(np.int32)
    for name, f, I in (("sigma_a", fa, I4), ("sigma_b", fb, I8)):
        fields[name] = mean(np.einsum("cqi,cqij,cqj->cq", f, state.cauchy, f) / I)
    stable = stability.evaluate(membrane.fabric, state.invariants)
    fields |= {"stability_convexity": stable.convexity.min(1), "stability_ellipticity": stable.ellipticity.min(1)}
    return fields, mismatch


def least_stability(membrane):
    """Least ellipticity indicator of all points of this rank, inf without cells; a third of the cost of `cell_fields`."""
    F, b, _ = membrane.at_points()
    fa, fb = F[..., 0], F[..., 0] * b[..., :1] + F[..., 1] * b[..., 1:]
    I4, I6, I8 = (np.einsum("cqi,cqi->cq", x, y) for x, y in ((fa, fa), (fa, fb), (fb, fb)))
    gamma = np.arctan2(I6, np.sqrt(I4 * I8 - I6 * I6)) - np.arctan2(b[..., 0], b[..., 1])
    return stability.least_ellipticity(membrane.fabric, np.stack([I4, I6, I8, gamma], -1))


def nodal_fields(scene):
    """Contact of this rank's local nodes: traction (nodes, 3) and its size, pressure [MPa], of all tools; {} without."""
    contacts = [term for term in scene.terms if hasattr(term, "tractions")]
    if not contacts:
        return {}
    traction = fem.Function(scene.blank.V)
    owned = sum(term.tractions() for term in contacts)
    traction.x.array[: owned.size] = owned.ravel()
    traction.x.scatter_forward()
    values = traction.x.array.reshape(-1, owned.shape[1])
    return {"contact_traction": values, "contact_pressure": np.linalg.norm(values, axis=1)}


class FieldSeries:
    """`DIR/fields.pvd` with one unstructured grid a state and rank: undeformed geometry, displacement `u` at the
    points, `cell_fields` on the cells, `rank`. states: those kept of a run that is resumed. The .pvd is rewritten after each state, so it can be opened any time.
    """

    def __init__(self, directory, membrane, states=()):
        self.membrane, self.blank = membrane, membrane.blank
        self.comm = self.blank.mesh.comm
        self.directory = directory
        self._folder = directory / "fields"
        self.states = [tuple(state) for state in states]  # (load, ranks with cells) of each state written
        if self.comm.rank == 0:
            self._folder.mkdir(exist_ok=True)
            for old in self._folder.glob("[0-9]*_*.vtu"):
                if int(old.name.split("_")[0]) >= len(self.states):
                    old.unlink()
        cells, types, self._points = compat.vtk_mesh(self.blank.V)
        self._ranks = [rank for rank, n in enumerate(self.comm.allgather(len(types))) if n]
        self._grid = pyvista.UnstructuredGrid(cells, types, self._points) if len(types) else None

    def write(self, load, fields, nodal=()):
        """Append the state at `load` with its `cell_fields` and `nodal_fields`."""
        if self._grid:
            u = np.zeros_like(self._points)
            values = self.blank.nodal_displacement()[: len(u)]
            u[:, : values.shape[1]] = values
            self._grid.point_data["u"] = u
            for name, array in dict(nodal).items():
                self._grid.point_data[name] = array[: len(u)]
            for name, array in fields.items():
                self._grid.cell_data[name] = array
            self._grid.cell_data["rank"] = np.full(self._grid.n_cells, self.comm.rank, dtype=np.int32)
            self._grid.save(self._folder / f"{len(self.states):04d}_{self.comm.rank}.vtu")
        self.states.append((load, self._ranks))
        self.comm.barrier()
        if self.comm.rank == 0:
            sets = "\n".join(
                f'<DataSet timestep="{t:.12g}" part="{r}" file="fields/{i:04d}_{r}.vtu"/>'
                for i, (t, ranks) in enumerate(self.states) for r in ranks
            )  # fmt: skip
            text = f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n{sets}\n</Collection>\n</VTKFile>\n'
            (self.directory / "fields.pvd").write_text(text)


def read_last(directory):
    """Last state of `DIR/fields.pvd`: one grid [pyvista.UnstructuredGrid] of all ranks' parts."""
    reader = pyvista.PVDReader(directory / "fields.pvd")
    reader.set_active_time_value(reader.time_values[-1])
    return reader.read().combine()
