"""The scenes of the net: presses and coupons as data, each a function of a folder for its files."""

import dataclasses
from collections.abc import Callable

import meshio
import numpy as np
import pyvista

import fabric_fenicsx as ff
from fabric_fenicsx.press.holders import Region

KOMEILI = ff.load("komeili")
# warp and weft differ, so that a change that takes one for the other is seen
TWILL = KOMEILI.replace(
    warp=dataclasses.replace(KOMEILI.warp, a=3000.0, p_min=0.8),
    weft=dataclasses.replace(KOMEILI.weft, b=500.0, c=20.0),
)
STEEL = ff.Metal(186600.0, 0.3, ff.Swift(500.0, 0.0005, 0.2), thickness=0.5, density=7.85)
SIDES = {"length": 100.0, "width": 80.0}
OVER = (180.0, 0.0, 0.0)


class Own(ff.WovenFabric):
    """A law of a user's own."""

    law = "own_of_the_net"


class Bedding(ff.Term):
    """A term of a user's own: springs at all nodes, along z."""

    name = energy_kind = "bedding"

    def _z(self):
        count = self.blank.V.dofmap.index_map.size_local
        return self.blank.u.x.array.reshape(-1, 3)[:count, 2]

    def stored(self):
        return 5e-4 * float(self._z() @ self._z())

    def add_forces(self, f):
        f.reshape(-1, 3)[: len(self._z()), 2] += 1e-3 * self._z()

    def tangent(self):
        first = self.blank.V.dofmap.index_map.local_range[0]
        dofs = (3 * (first + np.arange(len(self._z()))) + 2).astype(np.int32)
        return dofs, dofs, np.full(len(dofs), 1e-3)


class Bed:
    """A holder of a user's own, with that term."""

    def terms(self, site):
        pressure = ff.BlankHolderPressure(0.02, site.up, site.on_flange(), lag=site.lag)
        return [Bedding(), pressure]


def sheet(fabric=TWILL, **given):
    return ff.Sheet(fabric=fabric, **SIDES | {"nx": 6} | given)


def press(*sheets, **given):
    """A ball that is pushed into a sheet on a ring."""
    tools = {
        "ball": ff.PressTool(ff.Sphere(24)),
        "ring": ff.PressTool(ff.Turned(ff.Plate(length=56, entry=5), OVER), side="above"),
    }
    usual = {"interface": ff.Interface(friction=0.2), "stages": FAR}
    usual |= {"holders": {"holder": ff.PressureHolder(0.02)}}
    tools |= given.pop("tools", {})
    return ff.Press(sheets=sheets or [sheet()], tools=tools, **usual | given)


def held(holder, **given):
    return lambda folder: press(holders={"holder": holder}, **given)


def bump():
    """A punch of triangles that is its own mirror image nowhere: place (x, y) to height."""
    x, y = np.meshgrid(np.linspace(-30, 30, 25), np.linspace(-30, 30, 25))
    z = -((x / 30) ** 2 + (y / 24) ** 2) * 8 + 1.5 * np.exp(-((x - 8) ** 2 + (y - 5) ** 2) / 200)
    grid = pyvista.StructuredGrid(x, y, z)
    return grid.extract_surface(algorithm=None).triangulate().flip_faces()  # up


def of_file(folder):
    bump().save(folder / "bump.stl")
    return press(tools={"ball": ff.PressTool(str(folder / "bump.stl"))})


def of_model(folder):
    import gmsh

    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addSphere(0, 0, 0, 24)
    gmsh.model.occ.synchronize()
    gmsh.write(str(folder / "ball.step"))
    gmsh.finalize()
    return press(tools={"ball": ff.PressTool(str(folder / "ball.step"), chord=0.5)})


CORNERS = np.array([(-50, -40), (50, -40), (50, 20), (30, 40), (-50, 40)], float)


def of_outline(folder):
    np.savetxt(folder / "ply.csv", CORNERS, delimiter=",", header="x,y", comments="")
    return press(ff.Sheet(fabric=TWILL, outline=str(folder / "ply.csv"), size=16))


def of_mesh(folder):
    x, y = np.meshgrid(np.linspace(-50, 50, 7), np.linspace(-40, 40, 6), indexing="ij")
    k = np.arange(42).reshape(7, 6)
    quads = np.stack([k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]], -1).reshape(-1, 4)
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    cells = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    meshio.write(folder / "ply.vtu", meshio.Mesh(points, {"triangle": cells}), binary=False)
    return press(ff.Sheet(fabric=TWILL, mesh=str(folder / "ply.vtu")))


def die_of(folder):
    dome = ff.Press.read("double_dome", ["blank.nx=6", "blank.symmetry=none"])
    return dome.replace(stages=ff.Stage("forming", moves={"punch": 10.0}, steps=2))


def two_plies(**given):
    plies = sheet(name="lower", nx=4), sheet(name="upper", nx=4, fibre_angle=30)
    return press(*plies, stages=SHORT, **given)


WARM = TWILL.replace(at_temperatures={20.0: {"shear_factor": 4.0}, 200.0: {"shear_factor": 1.0}})


def of_fields(folder):
    """Functions that no mirror leaves as they are."""
    ply = sheet(
        WARM,
        fibre_angle=lambda x, y: 10 + 0.1 * x - 0.2 * y,
        thickness=lambda x, y: 0.9 + 0.002 * x,
        temperature=lambda x, y: 100 + x + 0.5 * y,
    )
    friction = lambda x, y, z: 0.2 + 0.002 * x + 0.01 * z  # noqa: E731
    return press(ply, interface=ff.Interface(friction=friction))


def of_files(folder):
    """A quarter with a warm middle, by files of points."""
    x, y = (c.ravel() for c in np.meshgrid(np.linspace(-50, 50, 11), np.linspace(-40, 40, 9)))
    table = np.column_stack([x, y, 180 - 2 * abs(x)])
    np.savetxt(folder / "warm.csv", table, delimiter=",", header="x,y,T [C]", comments="")
    points, mu = np.column_stack([x, y, 0 * x]), {"mu": 0.1 + 0.002 * abs(y)}
    cells = {"vertex": np.arange(len(x))[:, None]}
    meshio.write(folder / "mu.vtu", meshio.Mesh(points, cells, mu), binary=False)
    return press(
        sheet(WARM, nx=4, temperature=str(folder / "warm.csv")),
        symmetry="xy",
        interface=ff.Interface(friction=str(folder / "mu.vtu")),
    )


MIDDLES = [(-50, 0), (50, 0), (0, -40), (0, 40)]  # of edges
FORCE = {"ball": ff.PressTool(ff.Sphere(24), force=1.0)}
PUSHED = ff.Stage("forming", forces={"ball": 2.0}, steps=2)
SHORT, FAR = (ff.Stage("forming", moves={"ball": way}, steps=2) for way in (2.0, 4.0))
BACK = [FAR, ff.Stage("back", moves={"ball": -2.0}, steps=1)]
TWICE = [
    ff.Stage("first", moves={"ball": 4.0}, steps=2),
    ff.Stage("second", moves={"ball": 2.0}, pressures={"holder": 0.04}, steps=2),
]
SEGMENTS = {
    "right": ff.PressureHolder(0.03, where=Region({"angle": [-85, 95]})),
    "left": ff.PressureHolder(0.01, where=Region({"angle": [95, 275], "r": [0, 200]})),
}
RUBBING = {
    "shear_friction": ff.ShearFriction(0.05, 0.002),
    "bending_friction": ff.BendingFriction(30.0, 0.02),
}

PRESSES: dict[str, Callable] = {
    "whole": lambda folder: press(),
    "skewed": lambda folder: press(sheet(fibre_angle=20, yarn_angle=80)),
    "half": lambda folder: press(sheet(nx=4), symmetry="x"),
    "quarter": lambda folder: press(sheet(nx=4), symmetry="xy"),
    "slippery": lambda folder: press(interface=ff.Interface(friction=0.0)),
    "gap": held(ff.GapHolder(1.2)),
    "force": held(ff.ForceHolder(50.0)),
    "tension": held(ff.Grippers(0.02, edges=["low x", "high x"])),
    "springs": held(ff.SpringHolder(stiffness=0.02, preload=0.5, at=MIDDLES)),
    "edge_springs": held(ff.SpringHolder(stiffness=0.05, edges=["low x", "high x"])),
    "segments": lambda folder: press(holders=SEGMENTS),
    "own_term": held(Bed()),
    "stl": of_file,
    "step": of_model,
    "die_of": die_of,
    "by_force": lambda folder: press(tools=FORCE, stages=PUSHED),
    "back": lambda folder: press(stages=BACK),
    "two_stages": lambda folder: press(stages=TWICE),
    "outline": of_outline,
    "mesh": of_mesh,
    "P2": lambda folder: press(sheet(nx=4, element="P2")),
    "inner": lambda folder: press(sheet(nx=4, element="P2", integration="inner", fibre_angle=30)),
    "Q1": lambda folder: press(sheet(element="Q1", bending_modulus=0.0)),
    "two_plies": lambda folder: two_plies(),
    "ply_and_metal": lambda folder: press(
        ff.Sheet(metal=STEEL, name="steel", **SIDES, nx=5), sheet(name="ply", nx=5), stages=SHORT
    ),
    "self": lambda folder: press(interface=ff.Interface(friction=0.2, self=True)),
    "no_bending": lambda folder: press(sheet(bending_modulus=0.0)),
    "yarn_friction": lambda folder: press(sheet(TWILL.replace(**RUBBING))),
    "fields": of_fields,
    "files": of_files,
    "own_law": lambda folder: press(sheet(Own(**vars(TWILL)), pattern="left")),
}
COUPONS: dict[str, Callable] = {
    "strip": lambda folder: ff.Tensile(TWILL, nx=6, length=100, width=40),
    "bias": lambda folder: ff.BiasExtension(TWILL, nx=6, length=100, width=40),
    "frame": lambda folder: ff.PictureFrame(TWILL, nx=4),
}
