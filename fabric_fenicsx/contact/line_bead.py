"""A drawbead along a line, as the force by which it restrains a sheet, without its shape."""

from collections.abc import Sequence

import numpy as np
import shapely

from ..core.errors import InputError
from ..core.rules import POSITIVE, repr_short
from ..energy.nodes import Nodes
from ..energy.term import SceneFacts
from ..surfaces.primitives import Plane
from ..surfaces.surfaces import checked_vector
from ..surfaces.tool import Tool
from .contact_term import ToolContactTerm
from .coulomb import LAG, Coulomb


class LineBead(ToolContactTerm):
    """Equivalent drawbead: a line that stands still in x and y, along which a force per length
    opposes the sliding of the sheet that crosses it, in whatever direction it slides.

    The force does not depend on the rate; it begins with an elastic slip, as `Coulomb` friction.
    Sheets that lie there on one another share it. It acts on the nodes around the line by their
    shape functions; which ones these are is taken anew at each accepted state.

    Parameters
    ----------
    line : sequence of (x, y)
        Two points or more of a polyline [mm].
    restraint : float
        Force per length of the line on the sheet [N/mm], above 0.
    slip, lag
        As in `Coulomb`.
    name : str
        Of the bead in results.

    Raises
    ------
    InputError
        For numbers out of range, fewer points, and as `Contact` does for blanks.

    Examples
    --------
    >>> ff.LineBead([(0, 60), (80, 60)], restraint=2.5).line.length
    80.0
    """

    name, energy_kind = "bead", "friction"
    SPACING = 0.01  # of points along the line, over the size of a mean cell

    def __init__(
        self,
        line: Sequence[Sequence[float]],
        restraint: float,
        slip: float | None = None,
        lag: float = LAG,
        name: str = "bead",
    ) -> None:
        points = [checked_vector(f"line of {name}", each, size="two") for each in line]
        self.line = shapely.LineString(points) if points[1:] else shapely.LineString()
        if not self.line.length:
            raise InputError(
                f"line of {name} is {repr_short(line)}; allowed are two points or more"
            )
        self.restraint = POSITIVE.check(f"restraint of {name} [N/mm]", restraint)
        super().__init__(
            Tool(Plane((0, 0, 0), (0, 0, 1)), name=name), Coulomb(1.0, slip, lag), name
        )

    def set_up(self, scene: SceneFacts) -> None:
        blank = scene.blank
        self.nodes = Nodes(blank, self.part)
        sums = blank.mesh.comm.allreduce(np.array([blank.areas().sum(), len(blank.areas())]))
        self._at = self.points(self.SPACING * float(np.sqrt(sums[0] / sums[1])))
        self.accept()
        self._start_friction()

    def points(self, spacing: float = 1.0) -> np.ndarray:
        """Points (n, 2) [mm] in the middle of equal pieces of the line, `spacing` long or less."""
        count = int(np.ceil(self.line.length / spacing))
        at = (np.arange(count) + 0.5) / count
        return shapely.get_coordinates(self.line.interpolate(at, normalized=True))

    def _crossed(self):
        """Length of the line at each node (nodes,) [mm], of sheets that share it."""
        blank, comm, count = self.blank, self.nodes.comm, len(self._at)
        triangles = blank.triangles(self.part.cells).reshape(-1, 3)
        corners = (blank.coordinates() + blank.nodal_displacement())[triangles][..., :2]
        tree = shapely.STRtree(shapely.polygons(corners))
        point, triangle = tree.query(shapely.points(self._at), "intersects")
        sharing = comm.allreduce(np.bincount(point, minlength=count))
        edges = np.moveaxis(corners[triangle, 1:] - corners[triangle, :1], 1, 2)
        off = self._at[point] - corners[triangle, 0]
        N = np.linalg.solve(edges, off[..., None])[..., 0]
        lengths = (self.line.length / count / sharing[point])[:, None]
        N = np.column_stack([1 - N.sum(1), N]) * lengths
        return blank.summed_at(triangles[triangle], N[..., None])[: self.nodes.count, 0]

    def accept(self) -> None:
        self._lengths = self._crossed()
        super().accept()

    def normal_forces(self) -> np.ndarray:
        return self.restraint * self._lengths

    def restrained(self) -> float:
        """Sum of the sizes of the forces in the accepted state, of all ranks [N]."""
        return float(self.nodes.total(np.linalg.norm(self._friction_forces(), axis=1)))

    def _update_pressing(self):
        return False

    def _pressing_forces(self):
        return np.zeros((self.nodes.count, 3))

    def _normals(self):
        return np.tile([0.0, 0.0, 1.0], (self.nodes.count, 1))
