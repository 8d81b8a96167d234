"""Presses of a user's own tools: from files, in stages, with all that may be wrong with them."""

import dataclasses

import meshio
import numpy as np
import pytest
import pyvista
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.cli import main
from fabric_fenicsx.energy.fingerprint import entries
from fabric_fenicsx.press import pictures
from fabric_fenicsx.press.press import EXAMPLES
from fabric_fenicsx.results import pictures as result_pictures
from fabric_fenicsx.results import space
from fabric_fenicsx.sheet.specimen import own_model
from fabric_fenicsx.solve.checkpoint import Checkpoint
from fabric_fenicsx.solve.progress import Progress

HEMISPHERE = EXAMPLES / "hemisphere.toml"


def hemisphere(*changes, file=HEMISPHERE, **fields):
    """The press, built."""
    return ff.Press.read(file, changes).replace(**fields).build()


def changed(tmp_path, *pairs):
    """A press file with other text in it."""
    text = HEMISPHERE.read_text()
    for before, after in pairs:
        assert before in text
        text = text.replace(before, after)
    path = tmp_path / "press.toml"
    path.write_text(text)
    return path


def test_tools_stand_off_and_may_be_in_the_face_by_a_twentieth_of_the_thickness():
    """On either side; where a ball of 50 mm touches it stands at z = -50.5371, on the face, not
    where the nearest node is."""
    off = "blank.nx=4", "tools.punch.start_distance=3", "tools.ring.off=2"
    springs = {"springs": ff.SpringHolder(0.5, edges=["high x"])}
    punch, ring = hemisphere(*off, holders=springs).tools.values()
    assert [punch.path(0)[2], ring.path(0)[2]] == pytest.approx([-53.5371, 2.5371], abs=1e-4)
    for at, z in (([0, 0, -50.488], -50.488), ([7, 2.1], -50.5371)):
        changes = "blank.symmetry=none", "stage.1.moves.punch=5", f"tools.punch.at={at}"
        punch, ring = hemisphere("blank.nx=4", *changes).tools.values()
        assert [punch.path(0)[2], ring.path(1)[2]] == pytest.approx([z, 0.5371], abs=1e-4)


def test_the_net_of_stiff_yarns_over_an_open_ring():
    """As exact as over the closed dome: within 0.25 deg r.m.s. on 6 quadratic cells a side."""
    from nets import spherical_net

    yarn = ff.Yarn(b=2e4, d=20.0)
    stiff = ff.WovenFabric(yarn, yarn, s1=0.01, thickness=0.4)
    changes = ["blank.nx=6", "blank.element=P2", "holder.pressure=0.05", "contact.friction=0.02"]
    (sheet,) = ff.Press.read(HEMISPHERE, changes).sheets
    sheet = dataclasses.replace(sheet, fabric=stiff, bending_modulus=20.0)
    press = hemisphere(*changes, sheets=sheet)
    grid = press.job(steps=5, path_tolerance=1e-3, balance=None).run().grid
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
    held = "[holders.holder]\npressure = 0.02       # on the ply over the ring [MPa]\n"
    tool = hemisphere("blank.nx=4", file=changed(tmp_path, (held, ring))).tools["lower"]
    tool.at(1.0)
    assert tool.push == 112.5 and tool.direction.tolist() == [0, 0, 1]


@pytest.mark.parametrize(
    "changes, words",
    [
        (["tools.punch.at=[300, 0]"], "tools.punch does not meet the blank .*, 200 mm beside it"),
        (
            ["tools.punch.at=[0, 0, -50.478]"],
            r"cuts into the blank by 0.05913 mm .*expected z of `at` up to -50.5371",
        ),
        (["tools.ring.turn=[180, 0, 0]"], r"body between its face .*, turn = \[180, 0, 0\]"),
        (["tools.ring.length=60"], "punch and ring overlap by 13.* mm at the end of f"),
        (["holder.against=punch"], "holder.against is punch, which moves; expected a tool"),
        (["holder.bead={line=[[60, 0], [40, 9]], restraint=1}"], "bead leaves the flange of ring"),
        (["holder.gap=0.53"], "holder.gap is 0.53, which crushes the blank; expected from"),
    ],
)
def test_tools_that_cannot_stand_or_move_as_given(changes, words):
    with pytest.raises(ff.InputError, match=words):
        hemisphere(*changes)


@pytest.mark.parametrize(
    "changes, words",
    [
        (["stage.1.moves.punch=-30"], "tools.punch moves only away from the blank"),
        (["gravity=[1, 0, -9.81]"], "gravity` is .*, across a plane of symmetry"),
        (
            ["holder.bead={line=[[9, 0], [9, 9]]}"],
            "is {'line': .* a table of `line` and `restraint`",
        ),
        (["stage.1.close=1.2"], "close needs a tool with a die, as die_of"),
        (["holder={pressure=1, force=3}"], "has pressure and force; expected one of pressure, f"),
        (["ply=[{metal='dc04', fabric='komeili'}]"], "1.fabric and ply.1.metal are both given"),
        (["holders={}", "tools.ring.side=below"], "are below the blank, and nothing resists"),
        (["tools.ring={die_of='ring'}"], "tools.ring.die_of ring refers to a tool that is itself"),
        (["blank.slits=[[0, 1], [2]]"], r"blank.slits are .*; expected lines \[\[x, y\]"),
    ],
)
def test_what_is_wrong_is_said_with_its_file_and_key(changes, words):
    with pytest.raises(ff.InputError, match=words) as error:
        ff.Press.read(HEMISPHERE, changes)
    assert "hemisphere.toml: " in str(error.value)


def test_the_encoding_of_a_file_is_named(tmp_path):
    for encoding in ("Latin-1", "UTF-16"):
        (tmp_path / "press.toml").write_text(f"# Übung\n{HEMISPHERE.read_text()}", encoding)
        with pytest.raises(ff.InputError, match=f"is in {encoding}.*; expected TOML in UTF-8"):
            ff.Press.read(tmp_path / "press.toml")


def test_tools_that_no_plane_of_symmetry_mirrors_are_doubted():
    """One off by 0.32 mm, more than a quarter of the thickness, or that goes aside."""
    doubt = "tools.punch is not symmetric about "
    aside = ("tools.punch.at=[0.16, 0]", "x = 0"), ("stage.1.moves.punch=[0, 3, 20]", "y = 0")
    for change, place in (*aside, ("tools.punch.at=[0.12, 0]", "")):
        warnings = hemisphere("blank.nx=4", change).warnings
        assert any(doubt + place in each for each in warnings) == bool(warnings) == bool(place)


def test_an_answer_less_symmetric_than_its_press_is_doubted():
    """Half of the whole ply slips by 1 mm along x."""
    whole = "blank.nx=4", "blank.symmetry=none", "stage.1.moves.punch=3"
    press, aside = hemisphere(*whole), hemisphere(*whole, "tools.punch.at=[1, 0]")
    result = press.job(steps=1, balance=None).run()
    assert not press.doubts(result)
    result.grid.point_data["u"][result.grid.points[:, 0] > 1, 0] += 1
    (doubt,) = press.doubts(result)
    assert "symmetric about x = 0, but the blank, which" in doubt.text
    assert " mm in plan, is off its image by 1 mm at (" in doubt.text
    held = {"left": ff.PressureHolder(0.1, where=lambda x: x[0] < 0)}
    turned, segment = hemisphere(*whole, "blank.fibre_angle=30"), hemisphere(*whole, holders=held)
    assert not [each for press in (aside, turned, segment) for each in press.doubts(result)]


@pytest.mark.parametrize(
    "changes, nx",
    [("", 24), ("blank.symmetry=none", 48), ("tools.ring.entry=1", 48)]
    + [("tools.ring.entry=5", 34), ("tools.ring.entry=5 blank.fibre_angle=30", 17)]
    + [("blank.element=P2", 24), ("blank.fibre_angle=30 blank.nx=8", 8)],
)
def test_default_cells_follow_the_least_radius_of_the_tools(tmp_path, changes, nx):
    """A quarter of 100 mm: 1/48 of the whole or 0.6 of a radius, down to 1/96; P2 twice that."""
    file = changed(tmp_path, ("nx = 16", "#"))
    assert hemisphere(*changes.split(), file=file).sheets[0].nx == nx


def test_a_plate_has_the_opening_of_its_die(tmp_path):
    """A ball that comes down through the ring meets no plate beneath it."""
    by_force = "pressure = 0.02       # on the ply over the ring [MPa]", "force = 400"
    over = changed(tmp_path, ("radius = 50", 'radius = 50\nside = "above"'), by_force)
    press = hemisphere("blank.nx=6", "stage.1.moves.punch=5", file=over)
    result = press.job(steps=3, balance=None).run()
    forces = result.summary["quantities"]["tool_forces_of_whole_blank_N"]
    assert -100 < forces["punch"] < 0
    # towards the blank, of the modelled quarter
    assert 4 * result.number("reaction_N") == pytest.approx(-forces["punch"])


def ball(folder, change=lambda x: x, kept=lambda x: x[:, 0] < np.inf):
    """A press whose punch is a ball in a file: triangles of it whose middles (n, 3) are kept, at
    changed places."""
    sphere = pyvista.Sphere(radius=50, theta_resolution=40, phi_resolution=40)
    x, cells = sphere.points.astype(float).round(9), sphere.regular_faces
    half = cells[x[cells].mean(1)[:, 1] > 0]  # so that the other is its image
    x, cells = np.vstack([x, x * [1, -1, 1]]), np.vstack([half, half[:, ::-1] + len(x)])
    cells = cells[kept(x[cells].mean(1))]
    grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: cells}, change(x))
    grid.save(folder / "ball.vtu")
    return changed(folder, ('shape = "sphere"\nradius = 50', 'file = "ball.vtu"'))


def test_a_surface_that_faces_away_is_refused(tmp_path):
    """A ball stands as it is; with normals into the body it does not."""
    press = hemisphere("blank.nx=4", file=ball(tmp_path))
    assert press.tools["punch"].path(0)[2] == pytest.approx(-50 - press.thickness / 2, abs=0.05)
    with pytest.raises(ff.InputError, match="tools.punch has its body between .* normals point"):
        hemisphere("blank.nx=4", file=ball(tmp_path, lambda x: x * [1, 1, -1]))


SHORT = "blank.nx=4", "stage.1.moves.punch=8", "stage.1.steps=2"


def test_a_tool_may_have_any_coordinates_and_results_are_told_in_them(tmp_path):
    """The same ball, turned, and 1000 km from its origin."""
    place, turn = np.array([1e6, -5e5, 2e5]), [180, 0, 30]
    turned = Rotation.from_euler("xyz", turn, degrees=True)
    press = hemisphere(*SHORT, file=ball(tmp_path))
    here, centre = press.job(balance=None).run(), press.tools["punch"].path(1.0)
    file = ball(tmp_path, lambda x: turned.apply(x, inverse=True) + place)
    at = f"tools.punch.at={(-turned.apply(place))[:2].tolist()}"
    press = hemisphere(*SHORT, at, f"tools.punch.turn={turn}", file=file)
    there = press.job(balance=None).run(tmp_path / "out", pictures=False)
    assert there.number("reaction_N") == pytest.approx(here.number("reaction_N"), rel=1e-8)
    expected = turned.apply(here.grid.points + here.grid["u"] - centre, inverse=True) + place
    export = ["export", str(tmp_path / "out"), str(tmp_path / "a.vtu"), "--modelled", "--frame"]
    assert main.main([*export, "tool"]) == 0 and main.main([*export, "no"]) == 2
    found = pyvista.read(tmp_path / "a.vtu").points
    assert cKDTree(found).query(expected)[0].max() < 1e-6
    numbers = there.summary["quantities"]
    own = numbers["shear_angle_max_in_punch_at_mm"] - place
    formed = here.summary["quantities"]["shear_angle_max_formed_at_mm"]
    assert turned.apply(own) + centre == pytest.approx(np.array(formed), abs=1e-5)


@pytest.mark.parametrize("lid", [0, 1])
def test_half_a_tool_beside_the_origin_is_that_of_its_plane_of_symmetry(tmp_path, lid):
    """A ball cut at y = -400, open there, or closed by triangles in the plane."""
    whole = hemisphere(*SHORT, file=ball(tmp_path)).job(balance=None).run()
    away = [0, -400.0, 0]
    file = ball(tmp_path, lambda x: x + away, lambda x: x[:, 1] > 0)
    if lid:
        grid = pyvista.read(tmp_path / "ball.vtu")
        hole = pyvista.PolyData.from_regular_faces(grid.points, *grid.cells_dict.values())
        hole.fill_holes(1e3).cast_to_unstructured_grid().save(tmp_path / "ball.vtu")
    changes = "blank.symmetry={x = 0, y = -400}", "tools.ring.at=[0, -400]"
    half = hemisphere(*SHORT, *changes, file=file)
    assert not half.warnings
    result = half.job(balance=None).run()
    assert result.number("reaction_N") == pytest.approx(whole.number("reaction_N"), rel=1e-8)
    ends = [space.surface_of(each.grid).bounds for each in (result, whole)]
    assert np.subtract(*ends) == pytest.approx(np.repeat(away, 2), abs=1e-6)


@pytest.mark.parametrize("turn", [0, 180])
def test_the_die_of_a_closed_model_is_that_of_its_face(tmp_path, turn):
    """A block with a dome on it, all of whose faces the file has."""
    import gmsh

    with own_model(gmsh):
        cad = gmsh.model.occ
        block, ball = cad.addBox(-60, -60, -40, 120, 120, 40), cad.addSphere(0, 0, -30, 50)
        tall, _ = cad.fuse([(3, block)], [(3, ball)])
        low, _ = cad.cut(tall, [(3, cad.addBox(-60, -60, -99, 120, 120, 59))])
        cad.rotate(low, 0, 0, 0, 1, 0, 0, np.radians(turn))
        cad.synchronize()
        gmsh.write(str(tmp_path / "punch.step"))
    (tmp_path / "press.toml").write_text(
        'unit = "mm"\nblank = { fabric = "komeili", length = 100, width = 100, nx = 4 }\n'
        f'tools.punch = {{ file = "punch.step", turn = [{turn}, 0, 0] }}\n'
        'tools.die.die_of = "punch"\nstage = [{ name = "forming", close = 1.2 }]\n'
    )
    tools = hemisphere(file=tmp_path / "press.toml").tools
    x = np.array([[0, 0, 0], [45, 45, 0], [20, 0, 0]])
    apart = [tool.surface.evaluate(x - tool.path(1.0)).gap for tool in tools.values()]
    assert sum(apart)[:2] == pytest.approx([1.2 * 1.074] * 2, abs=0.01)


def test_a_picture_that_fails_loses_no_run(tmp_path, monkeypatch, caplog):
    def fails(*_):
        raise ValueError("Empty meshes cannot be plotted")

    monkeypatch.setattr(pictures, "setup_picture", fails)
    monkeypatch.setattr(result_pictures, "draw_plies", lambda *_: None)  # for time
    press = hemisphere("blank.nx=2", "stage.1.moves.punch=5")
    result = press.job(steps=1, balance=None).run(tmp_path)
    assert result.summary["converged"] and (tmp_path / "maps.png").exists()
    assert "setup.png was not drawn: Empty meshes" in caplog.text


@pytest.mark.parametrize("name", sorted(path.stem for path in EXAMPLES.glob("*.toml")))
def test_a_press_is_data_that_a_file_holds(name, tmp_path):
    """Read, written and read again it is the same; building leaves it as it was."""
    press = ff.Press.read(name, ["limits.shear=80", "limits.stop_when_invalid=true"])
    assert (press.limits.shear, press.stop_when_invalid) == (80, True)
    press.write(tmp_path / "press.toml")
    again = ff.Press.read(tmp_path / "press.toml")
    assert press == again == press.replace() != press.replace(title="another")
    with pytest.raises(dataclasses.FrozenInstanceError):
        press.symmetry = "none"


def test_a_blank_has_its_centroid_by_area_from_which_springs_pull(tmp_path):
    """Of two columns of cells, 90 and 210 mm wide."""
    x, y = (each.ravel() for each in np.meshgrid([0.0, 90, 300], [0.0, 200]))
    cells = [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)]
    points = np.column_stack([x, y, 0 * x])
    meshio.write_points_cells(tmp_path / "ply.vtu", points, [("triangle", cells)])
    changes = [f"blank.mesh={tmp_path / 'ply.vtu'}", "blank.symmetry=none"]
    changes += [f"tools.{name}.at=[150, 100]" for name in ("punch", "ring")]
    springs = ff.SpringHolder(stiffness=0.5, preload=8.0, at=[(300, 200)])
    made = ff.Press.read("hemisphere", changes).replace(holders={"s": springs}).build()
    assert made.laid.centre == pytest.approx([150, 100])
    (term,) = made.holders["s"]
    assert term.force() == pytest.approx(8 * np.array([150, 100, 0]) / np.hypot(150, 100))


def test_what_no_file_can_say_is_named(tmp_path):
    own = ff.load("komeili").replace(name="mine", thickness=0.7)
    other = own.replace(thickness=0.5, name="glass/PP twill")
    punch = ff.PressTool(ff.Turned(ff.Sphere(20), (180, 0, 0)), "above", at=np.array([1.0, 2.0]))
    tools = {"punch": punch, "die": ff.PressTool(ff.DieOf("punch"), "below", turn=[0, 0, 0])}
    springs = ff.SpringHolder(stiffness=1.0, at=np.array([[10.0, 20.0]]))
    press = ff.Press.read("hemisphere")
    (sheet,) = press.sheets
    two = [dataclasses.replace(sheet, name=f"{f.thickness}", fabric=f) for f in (own, other)]
    mine = press.replace(sheets=two, tools=tools, holders={"springs": springs})
    mine.write(tmp_path / "press.toml")
    assert ff.Press.read(tmp_path / "press.toml").replace(title=press.title) == mine
    assert (tmp_path / "press_mine.toml").is_file()
    segment = press.replace(holders={"left": ff.PressureHolder(0.1, where=lambda x: x[0] < 0)})
    with pytest.raises(ff.InputError, match="left.where is .*, which cannot be written to a file"):
        segment.write(tmp_path / "press.toml")
    with pytest.raises(ff.InputError, match="one of the plies is 0; expected `Sheet"):
        press.replace(sheets=[0])


def test_a_run_whose_earlier_stages_differ_is_not_gone_on_with(tmp_path):
    """Unloading may be added to it."""
    six, seven = (ff.Stage("first", moves={"punch": way}, steps=3) for way in (6, 7))
    back, unload = ff.Stage("back", leave=["punch"], steps=1), ff.Stage(unload=True)
    stages = [six], [six, unload], [seven, back]
    before, same, now = (hemisphere("blank.nx=4", stages=each) for each in stages)
    assert same.fingerprint() == before.fingerprint()
    x = compat.petsc_vector(before.scene.blank.u)
    state = Progress(x.copy(), x.copy(), step=0.1)
    prints = (each.fingerprint() for each in (before, now))
    problems = [entries(each["press"], "press") | each for each in prints]
    Checkpoint(tmp_path / "c.npz", before.scene.blank, problems[0]).save(state, {})
    with pytest.raises(ff.InputError, match="press.stage.1.moves.punch = 6, now it is 7"):
        Checkpoint(tmp_path / "c.npz", before.scene.blank, problems[1]).load()


def test_sheets_touch_themselves_and_a_run_stops_if_asked():
    changes = ["blank.nx=4", "ply.2.metal=dc04", "contact.self=true"]
    made = ff.Press.read("two_plies", [*changes, "limits.stop_when_invalid=true"]).build()
    found = [each for each in made.scene.terms if isinstance(each, ff.SelfContact)]
    assert [t.coulomb.coefficient for t in found] == [0.334, 0.25]
    assert made.job().stop_when_invalid


def test_cells_beside_a_radius_may_be_limited():
    """Of 25 mm beside one of 8 mm at the ring's opening."""
    press = hemisphere("blank.nx=4", "stage.1.steps=2", "stage.1.moves.punch=5")
    with pytest.raises(ff.SolverFailure, match=r"cells are 312 % .*; the limit is 300 % .*size"):
        press.job(balance=None, limits=ff.Limits(imbalance=9, cell_size=3.0)).run()
