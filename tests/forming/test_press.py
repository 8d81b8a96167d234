"""Presses of a user's own tools: from files, in stages, with all that may be wrong with them."""

import dataclasses
from pathlib import Path

import meshio
import numpy as np
import pytest
import pyvista

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.mechanics.fingerprint import entries
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.solve.checkpoint import Checkpoint
from fabric_fenicsx.solve.progress import Progress

PRESSES = Path(ff.__file__).parent / "studies/presses"
HEMISPHERE = PRESSES / "hemisphere.toml"


def hemisphere(*changes, **fields):
    """The press, built."""
    return ff.Press.read(HEMISPHERE, changes).replace(**fields).build()


def read(path, changes=()):
    """The press of a file, built."""
    return ff.Press.read(path, changes).build()


def changed(tmp_path, *pairs, file=HEMISPHERE):
    """A press file with other text in it."""
    text = file.read_text()
    for before, after in pairs:
        assert before in text
        text = text.replace(before, after)
    path = tmp_path / "press.toml"
    path.write_text(text)
    return path


def formed(press, **settings):
    return press.job(**settings).run()


@pytest.mark.parametrize(
    "changes, radius, way",
    [
        ([], 50, 40),
        (["tools.punch.radius=1e6", "stage.1.moves.punch=0.05"], 1e6, 0.05),  # all but flat
        # on the face, not where the nearest node is
        (["blank.symmetry=none", "tools.punch.at=[7, 2.1]", "stage.1.moves.punch=5"], 50, 5),
    ],
)
def test_tools_touch_the_blank_at_first_and_move_towards_it(changes, radius, way):
    press = hemisphere("blank.nx=4", *changes)
    half, (punch, ring) = press.thickness / 2, press.tools.values()
    assert punch.path(0)[2] == pytest.approx(-radius - half, rel=1e-9)
    assert punch.path(1)[2] - punch.path(0)[2] == pytest.approx(way)
    assert ring.path(0)[2] == ring.path(1)[2] == pytest.approx(half)


def test_tools_stand_off_and_may_be_in_the_face_by_a_twentieth_of_the_thickness():
    """On either side; where a ball of 50 mm touches it stands at z = -50.5371."""
    off = "blank.nx=4", "tools.punch.off=3", "tools.ring.off=2"
    springs = {"springs": ff.SpringHolder(0.5, edges=["high x"])}
    punch, ring = hemisphere(*off, holders=springs).tools.values()
    assert [punch.path(0)[2], ring.path(0)[2]] == pytest.approx([-53.5371, 2.5371], abs=1e-4)
    punch, _ = hemisphere("blank.nx=4", "tools.punch.at=[0, 0, -50.488]").tools.values()
    assert punch.path(0)[2] == -50.488


def test_the_net_of_stiff_yarns_over_an_open_ring():
    """As exact as over the closed dome: within 0.25 deg r.m.s. on 6 quadratic cells a side."""
    from nets import spherical_net

    yarn = ff.Yarn(b=2e4, d=20.0)
    stiff = ff.WovenFabric(yarn, yarn, s1=0.01, thickness=0.4)
    changes = ["blank.nx=6", "blank.element=P2", "holder.pressure=0.05", "contact.friction=0.02"]
    sheet = dataclasses.replace(
        ff.Press.read(HEMISPHERE, changes).sheets[0], fabric=stiff, bending_modulus=20.0
    )
    press = hemisphere(*changes, sheets=sheet)
    grid = formed(press, steps=5, balance=None, path_tolerance=1e-3).grid
    radius = 50 + press.thickness / 2
    u, v, _ = grid.cell_centers().points.T
    on = np.hypot(u, v) < 0.9 * radius
    exact = spherical_net.shear_angle(u[on], v[on], radius)
    off = np.degrees(abs(grid["shear_angle"][on]) - exact)
    assert np.degrees(exact.max()) > 20
    assert np.sqrt((off**2).mean()) < 0.25


def test_the_force_of_a_tool_is_that_on_the_whole_blank(tmp_path):
    """A quarter of it pushes the quarter that is modelled, towards it."""
    ring = '[tools.lower]\nshape = "plate"\nlength = 108\nentry = 8\nforce = 450\n'
    held = "[holders.holder]\npressure = 0.02       # on what lies on the ring [MPa]\n"
    tool = read(changed(tmp_path, (held, ring)), ["blank.nx=4"]).tools["lower"]
    tool.at(1.0)
    assert tool.push == 112.5 and tool.direction.tolist() == [0, 0, 1]


@pytest.mark.parametrize(
    "changes, words",
    [
        (["tools.punch.at=[300, 0]"], "tools.punch does not meet the blank .*, 200 mm beside it"),
        (
            ["tools.punch.at=[0, 0, -50.478]"],
            r"cuts into the blank by 0.05913 mm .*allowed is z of `at` up to -50.5371",
        ),
        (["tools.ring.turn=[180, 0, 0]"], r"body between its face .*or turn = \[180, 0, 0\]"),
        (["tools.ring.length=60"], "punch and ring go 13.* mm through one another at the end of f"),
        (["holder.against=punch"], "holder.against is punch, which moves; allowed is a tool"),
        (
            ["holder.gap=0.53"],
            "holders.holder.gap is 0.53, which crushes the blank; allowed is from",
        ),
    ],
)
def test_tools_that_cannot_stand_or_move_as_given(changes, words):
    with pytest.raises(ff.InputError, match=words):
        hemisphere(*changes)


@pytest.mark.parametrize(
    "changes, words",
    [
        (["tools.punch.radios=3"], r"tools.punch.radios is unknown \(did you mean radius\?\)"),
        (["tools.punch.shape=ball"], "shape ball is unknown; allowed are sphere, "),
        (["tools.punch.at=[0, 0, -60]", "tools.punch.off=1"], "punch.off is not allowed beside"),
        (["stage.1.moves.punch=-30"], "tools.punch only moves away from the blank"),
        (["stage.forming.moves.pnch=3"], r"tool pnch is unknown \(did you mean punch"),
        (["stage.forming.forces={punch=3}"], "forming.forces.punch needs a `force` from the start"),
        (["stage.forming.leave=['punch']"], "stage.forming.leave names punch, which moves in this"),
        (["stage.1.close=1.2"], "close needs a tool with a die, as die_of"),
        (["holder={pressure=1, force=3}"], "has pressure and force; allowed is one of pressure, f"),
        (["holder.where={z=[0, 1]}"], "holder.where.z is unknown; allowed are x, y, r, angle"),
        (["holder.where={x=[2, 1]}"], r"x is .*; allowed are two numbers, .lowest, highest"),
        (["blank.fabric=none.toml"], "material 'none.toml' is unknown"),
        (["blank.outline=none.dxf"], "no file; allowed is one beside the press file"),
        (["ply=[{}, {}]", "blank={fabric='komeili'}"], "ply.1.length and ply.1.width"),
        (["holders={}", "tools.ring.side=below"], "stand below the blank, and nothing resists"),
        (["blank.symmetry=z"], "blank.symmetry is 'z'; allowed .*xy"),
        (["limits.stop_when_invalid=1"], "stop_when_invalid is 1; allowed is true or"),
        (["tools.punch"], "is no KEY=VALUE; allowed is for example blank.nx=8"),
    ],
)
def test_what_is_wrong_is_said_with_its_file_and_key(changes, words):
    with pytest.raises(ff.InputError, match=words) as error:
        ff.Press.read(HEMISPHERE, changes)
    assert "hemisphere.toml: " in str(error.value)


FABRIC = ff.load("komeili")


@pytest.mark.parametrize(
    "kind, given, words",
    [
        (ff.Sheet, {"fabric": FABRIC, "metal": ff.load_metal("dc04")}, "`fabric` is not allowed b"),
        (ff.Sheet, {"fabric": FABRIC, "holdr": 1}, "field `holdr` of Sheet is unknown"),
        (dict, {"stage": ()}, "field `stage` of Press is unknown .did you mean stages"),
        (dict, {"tools": {"punch": ff.Sphere(5)}}, "tools.punch is .*; allowed is a `PressTool"),
        (dict, {"sheets": [0]}, "`sheets` holds 0; allowed are sheets"),
        (dict, {"sheets": ff.Sheet(FABRIC)}, "a sheet needs blank.length and"),
    ],
)
def test_what_is_no_part_of_a_press(kind, given, words):
    """kind: dict, for fields of the press itself."""
    with pytest.raises(ff.InputError, match=words):
        made = kind(**given)
        if kind is dict:
            ff.Press.read("hemisphere").replace(**made)


@pytest.mark.parametrize(
    "change, words",
    [
        # by 0.32 mm, more than a quarter of the thickness
        ("tools.punch.at=[0.16, 0]", "tools.punch is not its own mirror image in x = 0"),
        ("stage.1.moves.punch=[0, 3, 20]", "tools.punch is not its own mirror image in y = 0"),
        ("tools.other={shape='sphere', radius=20, at=[0, 0, -60]}", "real ones can't"),
        ("holder.pressure=20000", "holders.holder.pressure is 20000, which is much"),
        ("tools.ring.side=below", "punch and ring stand below the blank"),
        ("tools.punch.at=[0.12, 0]", ""),
    ],
)
def test_what_is_doubted_of_a_press(change, words):
    warnings = hemisphere("blank.nx=4", change).warnings
    assert any(words in each for each in warnings) if words else not warnings


@pytest.mark.parametrize("name, nx", [("hemisphere", 4), ("box", 4)])
def test_examples_run_from_their_files(name, nx):
    """The beginning of their first stage: tools and holders are in balance."""
    base = ff.Press.read(name, [f"blank.nx={nx}"])
    moves = {tool: 0.1 * way for tool, way in base.stages[0].moves.items()}
    press = base.replace(stages=ff.Stage(moves=moves, steps=2)).build()
    result = formed(press, balance=None)
    assert result.number("force_N") > 0
    assert result.number("unbalanced_force_N") < 1e-6 * result.number("force_N")


@pytest.mark.long
def test_a_ply_that_the_punch_leaves_slack_does_not_depend_on_steps():
    """Friction keeps what shape it can, and the balance closes."""
    forward, back = (ff.Stage(moves={"punch": way}, steps=8) for way in (30, -30))
    energies, heights = [], []
    for steps in (8, 16):
        press = hemisphere("blank.nx=6", stages=[forward, dataclasses.replace(back, steps=steps)])
        result = formed(press)
        assert result.number("force_N") == pytest.approx(0, abs=1e-6)
        assert result.summary["energy_imbalance"] < 0.02
        energies.append(result.summary["energy"]["friction"])
        heights.append(np.ptp(result.grid.warp_by_vector("u").points[:, 2]))
    assert energies[0] == pytest.approx(energies[1], rel=0.01)
    assert heights[0] == pytest.approx(heights[1], rel=0.02) and heights[0] > 1


def test_a_plate_has_the_opening_of_its_die(tmp_path):
    """A ball that comes down through the ring meets no plate beneath it."""
    over = changed(
        tmp_path,
        ("radius = 50", 'radius = 50\nside = "above"'),
        ("pressure = 0.02       # on what lies on the ring [MPa]", "force = 400"),
    )
    press = read(over, ["blank.nx=6", "stage.1.moves.punch=5"])
    result = formed(press, steps=3, balance=None)
    forces = result.summary["quantities"]["tool_forces_of_whole_blank_N"]
    assert -100 < forces["punch"] < 0
    # towards the blank, of the modelled quarter
    assert 4 * result.number("force_N") == pytest.approx(-forces["punch"])


@pytest.mark.parametrize("turn, upside_down", [([0, 0, 0], False), ([180, 0, 0], True)])
def test_a_surface_that_faces_away_is_turned_round(tmp_path, turn, upside_down):

    ball = pyvista.Sphere(radius=50, theta_resolution=90, phi_resolution=90)
    cap = ball.clip(normal=(0, 0, 1), origin=(0, 0, 10), invert=upside_down)
    cap = cap.extract_surface().triangulate().flip_faces()
    cap.save(tmp_path / "cap.stl")
    path = changed(tmp_path, ('shape = "sphere"\nradius = 50', 'file = "cap.stl"'))
    press = read(path, ["blank.nx=4", f"tools.punch.turn={turn}"])
    assert any("tools.punch: the normals of its surface point away" in w for w in press.warnings)
    assert press.tools["punch"].path(0)[2] == pytest.approx(-50 - press.thickness / 2, abs=0.05)


def test_a_cad_model_is_read_with_a_finer_chord_where_it_is_too_coarse(tmp_path, monkeypatch):
    from fabric_fenicsx.forming import placement

    chords, finest = [], 0.05

    def read_surface(path, chord, comm):
        chords.append(chord)
        return ff.TriangulatedSurface([(-99, -99, 0), (99, -99, 0), (0, 99, 0)], [(0, 1, 2)])

    def check(surface, name, *_):
        assert name == f"tools.punch with chord = {chords[-1]:g}"
        if chords[-1] > finest:
            raise ff.InputError("facets are off")

    monkeypatch.setattr(placement.TriangulatedSurface, "read", read_surface)
    monkeypatch.setattr(placement, "check_triangles", check)
    (tmp_path / "x.step").write_text("")
    path = changed(tmp_path, ('shape = "sphere"\nradius = 50', 'file = "x.step"'))
    changes = ["blank.nx=4", "stage.1.moves.punch=0.1"]
    read(path, changes)
    assert chords == [0.1, 0.05]
    finest = 0.0
    with pytest.raises(ff.InputError, match="facets are off, or a smaller `chord`"):
        read(path, changes)


@pytest.mark.parametrize("turn", [0, 180])
def test_the_die_of_a_closed_model_is_that_of_its_face(tmp_path, turn):
    """A block with a dome on it, all of whose faces the file has."""
    import gmsh

    gmsh.initialize(readConfigFiles=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        cad = gmsh.model.occ
        block, ball = cad.addBox(-60, -60, -40, 120, 120, 40), cad.addSphere(0, 0, -30, 50)
        tall, _ = cad.fuse([(3, block)], [(3, ball)])
        low, _ = cad.cut(tall, [(3, cad.addBox(-60, -60, -99, 120, 120, 59))])
        cad.rotate(low, 0, 0, 0, 1, 0, 0, np.radians(turn))
        cad.synchronize()
        gmsh.write(str(tmp_path / "punch.step"))
    finally:
        gmsh.finalize()
    (tmp_path / "press.toml").write_text(
        'unit = "mm"\nblank = { fabric = "komeili", length = 100, width = 100, nx = 4 }\n'
        f'tools.punch = {{ file = "punch.step", turn = [{turn}, 0, 0] }}\n'
        'tools.die.die_of = "punch"\nstage = [{ name = "forming", close = 1.2 }]\n'
    )
    tools = read(tmp_path / "press.toml").tools
    x = np.array([[0, 0, 0], [45, 45, 0], [20, 0, 0]])
    apart = [tool.surface.evaluate(x - tool.path(1.0)).gap for tool in tools.values()]
    assert sum(apart)[:2] == pytest.approx([1.2 * 1.074] * 2, abs=0.01)


def test_a_mesh_that_is_not_flat_is_no_blank(tmp_path):
    points, cells, kind = specimen(160, 160, 6, 6, "crossed")
    points[:, 2] = points[:, 0] / 2 - 40
    meshio.write_points_cells(tmp_path / "blank.vtu", points, [(kind, cells)])
    changes = [f"blank.mesh={tmp_path / 'blank.vtu'}", "blank.symmetry=none"]
    with pytest.raises(ff.InputError, match="reaches from z = -40 to 40 mm; allowed is a flat"):
        ff.Press.read("hemisphere", changes).build()


def test_a_picture_that_fails_loses_no_run(tmp_path, monkeypatch, caplog):
    from fabric_fenicsx.plot import forming_pictures, press_pictures

    def fails(*_):
        raise ValueError("Empty meshes cannot be plotted")

    monkeypatch.setattr(press_pictures, "filmstrip", fails)
    monkeypatch.setattr(press_pictures, "setup_picture", lambda *_: None)  # for time
    monkeypatch.setattr(forming_pictures, "draw_plies", lambda *_: None)
    press = hemisphere("blank.nx=4", "stage.1.moves.punch=5")
    result = press.job(steps=2, balance=None).run(tmp_path)
    assert result.summary["converged"] and (tmp_path / "maps.png").exists()
    assert "filmstrip.png was not drawn: Empty meshes" in caplog.text


EXAMPLES = sorted(path.stem for path in PRESSES.glob("*.toml"))


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_press_is_data_that_a_file_holds(name, tmp_path):
    """Read, written and read again it is the same; building leaves it as it was."""
    press = ff.Press.read(name, ["limits.shear=80", "limits.stop_when_invalid=true"])
    assert (press.limits.shear, press.stop_when_invalid) == (80, True)
    press.write(tmp_path / "press.toml")
    again = ff.Press.read(tmp_path / "press.toml")
    assert press == again == press.replace() != press.replace(title="another")
    with pytest.raises(dataclasses.FrozenInstanceError):
        press.symmetry = "none"


def test_a_press_is_disturbed_along_no_axis():
    """By 2 mm at 30 deg, of the whole blank with as large cells."""
    other = hemisphere("blank.nx=4").disturbed(2.0)
    assert other.tools["punch"].at[:2] == pytest.approx((np.sqrt(3), 1.0))
    assert (other.symmetry, other.sheets[0].nx) == ("none", 8)


def test_a_blank_has_its_centroid_by_area_from_which_springs_pull(tmp_path):
    """Of two columns of cells, 90 and 210 mm wide."""
    x, y = (each.ravel() for each in np.meshgrid([0.0, 90, 300], [0.0, 200]))
    cells = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)]
    meshio.write_points_cells(
        tmp_path / "ply.vtu", np.column_stack([x, y, 0 * x]), [("triangle", cells)]
    )
    changes = [f"blank.mesh={tmp_path / 'ply.vtu'}", "blank.symmetry=none"]
    changes += [f"tools.{name}.at=[150, 100]" for name in ("punch", "ring")]
    springs = ff.SpringHolder(stiffness=0.5, preload=8.0, at=[(300, 200)])
    made = ff.Press.read("hemisphere", changes).replace(holders={"s": springs}).build()
    assert made.laid.centre == pytest.approx([150, 100])
    (term,) = made.holders["s"]
    assert term.force() == pytest.approx(8 * np.array([150, 100, 0]) / np.hypot(150, 100))


def test_a_press_tells_its_job_where_to_stop():
    changes = ["blank.nx=2", "limits.stop_when_invalid=true"]
    assert ff.Press.read("hemisphere", changes).job().stop_when_invalid


def test_what_no_file_can_say_is_named(tmp_path):
    own = ff.load("komeili").replace(name="mine", thickness=0.7)
    press = ff.Press.read("hemisphere")
    mine = press.replace(sheets=dataclasses.replace(press.sheets[0], fabric=own))
    mine.write(tmp_path / "press.toml")
    assert (
        ff.Press.read(tmp_path / "press.toml") == mine and (tmp_path / "press_mine.toml").is_file()
    )
    other = own.replace(thickness=0.5, name="glass/PP twill")
    (sheet,) = press.sheets
    two = [dataclasses.replace(sheet, name=f"{f.thickness}", fabric=f) for f in (own, other)]
    press.replace(sheets=two).write(tmp_path / "press.toml")
    assert [s.fabric for s in ff.Press.read(tmp_path / "press.toml").sheets] == [own, other]
    segment = press.replace(holders={"left": ff.PressureHolder(0.1, where=lambda x: x[0] < 0)})
    with pytest.raises(ff.InputError, match="holders.left.where is .*, which a file cannot hold"):
        segment.write(tmp_path / "press.toml")


def test_arrays_and_lists_are_the_same_data_and_dies_keep_their_side(tmp_path):
    press = ff.Press.read("hemisphere")
    punch = ff.PressTool(ff.Turned(ff.Sphere(20), (180, 0, 0)), "above", at=np.array([1.0, 2.0]))
    springs = ff.SpringHolder(stiffness=1.0, at=np.array([[10.0, 20.0]]))
    tools = {"punch": punch, "die": ff.PressTool(ff.DieOf("punch"), "below", turn=[0, 0, 0])}
    mine = press.replace(tools=tools, holders={"springs": springs})
    mine.write(tmp_path / "press.toml")
    assert ff.Press.read(tmp_path / "press.toml").replace(title=press.title) == mine


FIRST = ff.Stage("first", moves={"punch": 6}, steps=3)
MORE = [
    ff.Stage("hold", pressures={"holder": 0.04}, steps=1),
    ff.Stage("on", moves={"punch": 4}, steps=2),
]


def test_a_run_whose_earlier_stages_differ_is_not_gone_on_with(tmp_path):
    other = [dataclasses.replace(FIRST, moves={"punch": 7}), *MORE]
    before, now = (hemisphere("blank.nx=4", stages=each) for each in ([FIRST], other))
    state = Progress(*(compat.petsc_vector(before.blank.u).copy() for _ in range(2)), step=0.1)
    problems = [
        entries(each.fingerprint()["press"], "press") | each.fingerprint() for each in (before, now)
    ]
    Checkpoint(tmp_path / "c.npz", before.blank, problems[0]).save(state, {})
    with pytest.raises(ff.InputError, match="press.stage.1.moves.punch = 6, now it is 7"):
        Checkpoint(tmp_path / "c.npz", before.blank, problems[1]).load()


def test_unloading_may_be_added_to_a_run():
    with_it = hemisphere("blank.nx=4", stages=[FIRST, ff.Stage(unload=True)])
    assert with_it.fingerprint() == hemisphere("blank.nx=4", stages=[FIRST]).fingerprint()


def test_sheets_touch_themselves_if_asked():
    changes = ["blank.nx=4", "ply.2.metal=dc04", "contact.self=true"]
    made = ff.Press.read("two_plies", changes).build()
    found = [each for each in made.scene.terms if isinstance(each, ff.SelfContact)]
    assert [t.coulomb.coefficient for t in found] == [0.334, 0.25]


def test_cells_beside_a_radius_may_be_limited():
    """Of 25 mm beside one of 8 mm at the ring's opening."""
    changes = "blank.nx=4", "stage.1.steps=2", "stage.1.moves.punch=5"
    press, other = hemisphere(*changes), hemisphere(*changes)
    with pytest.raises(ff.SolverFailure, match=r"cells are 312 % .*; allowed is 300 % .*cell_size"):
        press.job(balance=None, limits=ff.Limits(imbalance=9, cell_size=3.0)).run()
    result = other.job(balance=None, limits=ff.Limits(imbalance=9, cell_size=3.2)).run()
    assert result.summary["verdict"] == "doubtful"
