"""Hard cases of sheets in space: snaps, wrinkles, contact and friction, presses, metal, plies."""

import math
from dataclasses import replace

import numpy as np
import pyvista
from scipy.optimize import brentq

import fabric_fenicsx as ff
from fabric_fenicsx.scene.output import virial
from fabric_fenicsx.scene.supports import on_edge

from .hard import Number, Run, near
from .hard_strips import density, rectangle, stress

STEEL = ff.Metal(200_000.0, 0.0, ff.Swift(500.0, 0.001, 0.2), thickness=0.5)
ELASTIC = STEEL.replace(hardening=ff.Swift(1e6, 0.001, 0.2))  # as good as


def at(axis, place):
    return lambda x: np.abs(x[axis] - place) < 1e-6


def both_ends(x):
    return at(0, 0.0)(x) | at(0, 100.0)(x)


def everywhere(x):
    return np.full(x.shape[1], True)


def sheet(s, length, width, nx, ny=None, **more):
    return rectangle(s, length, width, nx, ny=ny, spatial=True, **more)


def slack_net(s):
    """a slack net without bending, held at its edge, under 10 kPa: the edge bears all of it"""
    blank = sheet(s, 100, 100, 12)
    edge = [ff.Support("edge", on_edge(blank), (0, 1, 2))]
    gas = ff.DeadPressure(0.01, (0, 0, 1))
    run = Run(ff.Scene(blank, [ff.Membrane(s.fabric), gas], edge), steps=10)
    force, rise = -run.scene.reaction("edge")[2], run.height()
    return [run], [near("force/N", force, 100.0, 1e-6), Number("rise/mm", rise, 1, 50)]


def strip_that_snaps(s):
    """a buckled strip pushed in its middle until it is its mirror image: the same energy"""
    blank, energies = sheet(s, 100, 20, 20), []

    def ends(x, load):
        return np.array([[-4.0 * min(1, 2 * load)], [0], [0]]) * (x[0] > 50)

    def middle(x, load):
        return np.array([[0], [0], [12.0 * np.interp(load, [0, 0.5, 1], [0, 1, -1])]]) + 0 * x

    supports = [ff.Support("ends", both_ends, (0, 1, 2), ends)]
    supports.append(ff.Support("middle", at(0, 50.0), (2,), middle))
    terms = [ff.SheetMetal(ELASTIC, clamped=both_ends)]

    def note(run, load):
        if load == 0.5:
            energies.append(sum(run.scene.energies().values()))

    run = Run(ff.Scene(blank, terms, supports), watch=note)
    return [run], [near("energy/N mm", run.energy, energies[0], 1e-4)]


def dome_that_snaps(s):
    """a shallow dome of elastic steel under a pressure that turns it inside out: as many steps as
    one likes, and beyond its mirror image"""
    runs, centre = [], []
    for steps in (20, 5):
        flat = sheet(s, 100, 100, 8)
        x, cells = flat.coordinates().copy(), flat.cell_nodes
        x[:, 2] = 4 * np.sin(np.pi * x[:, 0] / 100) * np.sin(np.pi * x[:, 1] / 100)
        blank = ff.Blank.from_arrays(s.comm, x, cells, "triangle", spatial=True)
        edge = ff.Support("edge", on_edge(blank), (0, 1, 2))
        terms = [ff.SheetMetal(ELASTIC), ff.DeadPressure(0.3, (0, 0, -1))]
        runs.append(run := Run(ff.Scene(blank, terms, [edge]), steps=steps))
        centre.append(run.height())
    fell = Number("fall/mm", centre[0], 8.0, 12.0)
    return runs, [near("energy/N mm", runs[1].energy, runs[0].energy, 1e-6), fell]


def wrinkles_in_shear(s):
    """a sheet with yarns at 45 deg sheared by 5 %: it folds, with less energy than kept plane"""

    def scene(spatial):
        blank = rectangle(s, 100, 50, 16, spatial=spatial, fibre_angle=45)
        axes = (0, 1, 2)[: 2 + spatial]
        ends = [ff.Support("low", at(1, 0.0), axes)]
        ends.append(ff.Support("high", at(1, 50.0), axes, (2.5, 0, 0)))
        bending = [ff.Bending(1.0, D_t=0.2)] if spatial else []
        return ff.Scene(blank, [ff.Membrane(s.fabric.replace(d=20.0)), *bending], ends)

    plane, run = Run(scene(False), steps=10), Run(scene(True), steps=10)
    share = Number("energy over that in the plane", run.energy / plane.energy, 0.1, 0.999)
    return [plane, run], [share, Number("height/mm", run.height(), 0.2, 10)]


PULLED = (0.0, 0.25, 1e-3), (0.1, 0.6, 1e-3), (1.0, 2.0, 1e-4), (50.0, 0.25, 1e-4)


def pulled_out(s):
    """a strip drawn from under a holder of 0 to 50 MPa, friction 0.25 to 2, an elastic slip of 1e-3
    and 1e-4 mm: 2 mu p A"""
    runs, numbers = [], []
    for p, mu, slip in PULLED:
        law = ff.Coulomb(mu, slip)
        plate = ff.Tool(ff.Plane((0, 0, -0.5), (0, 0, 1)), name="plate")
        holder = ff.BlankHolderPressure(p, (0, 0, -1), everywhere, friction=law)
        terms = [ff.Membrane(s.fabric), ff.Contact(plate, friction=law), holder]
        grip = ff.Support("grip", everywhere, (0, 1), (0.1, 0, 0))
        runs.append(run := Run(ff.Scene(sheet(s, 20, 10, 4), terms, [grip]), steps=40))
        force, off = 2 * mu * p * 200, 1e-9 + 2e-4 * mu * p * 200
        value = float(run.scene.reaction("grip")[0])
        numbers.append(Number(f"mu {mu}, {p} MPa: force/N", value, force - off, force + off))
    return runs, numbers


def sharp_bar(s):
    """a bar with a radius of a fifth of a cell under a strip: force of its straight parts"""
    r, h, fabric = 1.0 + 0.2, 12.0, s.fabric.decoupled()
    edge = ff.Cylinder((50, 0, -r), (0, 1, 0), 1.0)
    bar = ff.Tool(edge, path=(0.0, 0.0, h), name="bar")
    terms = [ff.Membrane(fabric), contact := ff.Contact(bar, 0.4, 1000.0)]
    blank = sheet(s, 100, 20, 20, pattern="left")
    run = Run(ff.Scene(blank, terms, ff.clamped_ends()), steps=10)

    def straight(turn):  # from where the bar is touched to the clamp
        return (50 - r * math.sin(turn)) / math.cos(turn)

    turn = brentq(lambda v: straight(v) * math.sin(v) + r * math.cos(v) - r - h, 0, 1)
    strain = (straight(turn) + r * turn) / 50 - 1
    pull = 20 * stress(lambda a: density(fabric, a, 0.0, 0.0), strain)
    return [run], [near("force/N", contact.force()[2], 2 * pull * math.sin(turn), 0.03)]


def ball(s, *sheets, tool=None, **given):
    """A ball of 24 mm pushed by 6 mm into a sheet of 100 x 80 mm."""
    ring = ff.Turned(ff.Plate(length=56, entry=5), (180.0, 0.0, 0.0))
    tools = {"ball": tool or ff.PressTool(ff.Sphere(24))}
    tools["ring"] = ff.PressTool(ring, side="above")
    usual: dict = {"stages": ff.Stage("forming", moves={"ball": 6.0}, steps=4)}
    usual["interface"] = ff.Interface(friction=0.2, slip=0.01)
    usual["holders"] = {"holder": ff.PressureHolder(0.02)}
    sheets = sheets or (ff.Sheet(fabric=s.fabric, nx=6),)
    blank = [replace(each, length=100.0, width=80.0) for each in sheets]
    return ff.Press(sheets=blank, tools=tools, **usual | given)


def ball_of_triangles(s):
    """a ball of 2000 triangles: the force of the smooth one"""
    faces = pyvista.Sphere(radius=24, theta_resolution=32, phi_resolution=33)
    surface = ff.TriangulatedSurface(faces.points, faces.regular_faces)
    smooth, facets = s.press(ball(s)), s.press(ball(s, tool=ff.PressTool(surface)))
    return [smooth[0], facets[0]], [near("force/N", facets[1], smooth[1], 0.01)]


def ball_by_force(s):
    """a ball pushed by the force that another needs: as far"""
    moved, force = s.press(ball(s))
    tool = ff.PressTool(ff.Sphere(24), force=force / 10)
    press = ball(s, tool=tool, stages=ff.Stage("forming", forces={"ball": force}, steps=4))
    run, _ = s.press(press)
    (pushed,) = (t for t in run.scene.terms if isinstance(t, ff.Contact) and t.tool.force)
    return [moved, run], [near("travel/mm", pushed.tool.travel, 6.0, 1e-3)]


def matched_die(s):
    """a double dome whose die leaves the ply's thickness: the shear of one with a fifth more"""
    presses = (ff.Press.read("double_dome", ["blank.nx=6", f"stage.1.close={c}"]) for c in (1.2, 1))
    wide, narrow = (s.press(press)[0] for press in presses)
    return [wide, narrow], [near("shear/deg", narrow.shear(), wide.shear(), 0.05)]


def dome_without_friction(s):
    """a double dome without friction: all work is in the energies"""
    run, _ = s.press(ff.Press.read("double_dome", ["blank.nx=8", "contact.friction=0"]))
    return [run], [Number("share missing", run.imbalance, 0.0, 0.005)]


def plies(lowest, *angles):
    """A case of plies with yarns a at these angles; lowest: element of the lowest, else P1."""

    def case(s):
        def formed(turn):
            sheets, ply = [], ff.Sheet(fabric=s.fabric, nx=4)
            for k, a in enumerate(angles):
                own: dict = {"fibre_angle": a + turn, "element": "P1" if k else lowest}
                sheets.append(replace(ply, name=f"ply {k}", **own))
            return s.press(ball(s, *sheets, stages=ff.Stage(moves={"ball": 3.0}, steps=3)))

        (one, first), (other, second) = formed(0), formed(90)
        return [one, other], [near("force/N", second, first, 1e-3)]

    case.__doc__ = f"plies at {angles} deg, the lowest {lowest}, under a ball: as with b for a"
    return case


def steel_at_30_percent(s):
    """a strip of steel drawn by 30 %: the stress of its hardening curve"""
    blank, strain = sheet(s, 10, 5, 4, 2, pattern="unstructured"), 0.3

    def stretch(x, load):
        return np.array([[math.expm1(strain * load)], [0], [0]]) * x

    held = [ff.Support("along", everywhere, (0,), stretch), ff.Support("flat", everywhere, (2,))]
    held.append(ff.Support("side", at(1, 0.0), (1,)))
    run = Run(ff.Scene(blank, [ff.SheetMetal(STEEL)], held), steps=4)
    p = brentq(lambda p: STEEL.hardening.stress(p) / STEEL.E + p - strain, 0, strain)
    true = virial(run.scene)[0, 0] * math.exp(strain) / (50 * STEEL.thickness)
    return [run], [near("stress/MPa", true, float(STEEL.hardening.stress(p)), 1e-6)]


def steel_that_buckles(s):
    """a clamped strip of elastic steel shortened by 1 %: Euler's force, and its rise beyond it"""
    blank = sheet(s, 100, 10, 40, 4)
    metal = ff.SheetMetal(ELASTIC, clamped=both_ends)
    run = Run(ff.Scene(blank, [metal], ff.clamped_ends(-1.0)), steps=10)
    euler = 4 * math.pi**2 * STEEL.E * 0.5**3 / 12 * 10 / 100**2
    return [run], [near("force/N", -run.scene.reaction("moving grip")[0], euler * 1.005, 0.01)]


def on_bar(length, cells, curvature):
    """Displacement (x, load) that lays a strip along x on a bar, by chords as long as its cells;
    curvature: function of the load [1/mm]."""
    step = length / cells

    def moved(x, load):
        turns = (2 * np.arange(cells) + 1) * step * curvature(load) / 2
        along, up = (np.append(0, step * f(turns).cumsum()) for f in (np.cos, np.sin))
        s = np.round(x[0] / step).astype(int)
        return np.array([along[s] - x[0], 0 * x[0], up[s]])

    return moved


def half_turn(s):
    """a strip whose end is turned by 180 deg along an arc: the energy of the arc"""
    length, arc = 60.0, on_bar(60.0, 30, lambda load: math.pi * load / 60)
    ends = lambda x: (x[0] < 2.1) | (x[0] > length - 2.1)  # noqa: E731
    held = [ff.Support("ends", ends, (0, 2), arc), ff.Support("side", at(1, 0.0), (1,))]
    blank = sheet(s, length, 8, 30, 1, pattern="left")
    yarns = ff.Membrane(s.fabric.decoupled().replace(d=250.0))  # hardly shorten
    D = 8.33  # N mm
    run = Run(ff.Scene(blank, [yarns, ff.Bending(D, D_t=2 * D)], held), steps=12)
    energy = D * 8 * math.pi**2 / 2 / length
    return [run], [near("energy/N mm", run.scene.energies()["bending"], energy, 0.05)]
