"""What ParaView gets, read back with VTK, against the solution it is of."""

import builders
import numpy as np
import pytest
import pyvista
from builders import COMM
from scipy.spatial import cKDTree

import fabric_fenicsx as ff
from fabric_fenicsx import dolfinx_compat as compat
from fabric_fenicsx.core.errors import InputError
from fabric_fenicsx.results.fields import FieldSeries, yarn_coordinates
from fabric_fenicsx.results.ply import grid_of, set_arrays
from fabric_fenicsx.results.states import _drop_units, read_state, save
from fabric_fenicsx.results.states import units as state_units
from fabric_fenicsx.scene import output as reports

LENGTH, WIDTH = 60.0, 40.0
# VTK's numbers; 69, 70: Lagrange triangle, quadrilateral
VTK_CELL = {"P1": 5, "P3": 69, "Q2": 70}


def bare(element="P1", spatial=False, nx=6, shape=None, comm=COMM, **options):
    """A sheet from the origin on, formed by `shape`, in no scene."""
    cell = "triangle" if element[0] == "P" else "quadrilateral"
    options = {"a": 0.4, "degree": int(element[1]), "spatial": spatial} | options
    options |= {"comm": comm, "cell": cell, "shape": shape}
    return builders.sheet(LENGTH, WIDTH, nx, nx * 2 // 3, **options)


def sheet(*args, terms=(), **options):
    """The scene of a sheet's membrane and other `terms`."""
    return ff.Scene(bare(*args, **options), [ff.Membrane(ff.load("komeili")), *terms])


def deform(blank, amount):
    """A displacement that no element has exactly."""
    x, y, z = blank.coordinates().T
    u = amount * np.column_stack([0.02 * x + np.sin(y / 9), np.cos(x / 11), np.sin(x / 8) * y / 20])
    blank.u.x.array[:] = u[:, : blank.mesh.geometry.dim].ravel()


def states(path):
    """{time: grids or surfaces} of a .pvd file, with names and places as they are in it."""
    reader = pyvista.PVDReader(path)
    found = {}
    for at in reader.time_values:
        reader.set_active_time_value(at)
        found[at] = list(reader.read())
        for block in found[at]:
            if isinstance(block, pyvista.DataSet):
                _drop_units(block)
    return found


@pytest.mark.versions
@pytest.mark.mpi
@pytest.mark.parametrize("element, spatial", [("P1", True), ("Q2", False), ("P3", False)])
def test_series_read_back(tmp_path, element, spatial):
    folder = COMM.bcast(tmp_path)
    scene = sheet(element, spatial)
    blank, gdim = scene.blank, 3 if spatial else 2
    inside = np.random.default_rng(0).uniform([1, 1, 0], [LENGTH - 1, WIDTH - 1, 0], (50, 3))
    series, written = FieldSeries(folder, scene), {}
    for at in (0.0, 1 / 3, 1.0):
        deform(blank, at)
        fields = reports.cell_fields(scene)
        series.write(at, fields)
        written[at] = COMM.gather((compat.values_at(blank.u, inside), fields))
    if COMM.rank != 0:
        return
    read = states(folder / "fields.pvd")
    assert list(read) == [0.0, 1 / 3, 1.0]
    for at, parts in written.items():
        u = np.nanmean([u for u, _ in parts], axis=0)
        grid = pyvista.MultiBlock(read[at]).combine()
        assert set(grid.celltypes) == {VTK_CELL[element]}
        assert grid.point_data["u"].dtype == np.float64
        # as VTK interpolates it in its own cells
        sampled = pyvista.PolyData(inside).sample(grid, tolerance=1e-6, snap_to_closest_point=False)
        assert sampled["vtkValidPointMask"].all()
        np.testing.assert_allclose(sampled["u"][:, :gdim], u, atol=1e-9)
        assert gdim == 3 or not grid["u"][:, 2].any()
        c, s = np.cos(0.4), np.sin(0.4)
        own = [sampled[f"yarn_coordinate_{name}"] for name in "ab"]
        np.testing.assert_allclose(own, [[-s, c, 0], [c, s, 0]] @ inside.T, atol=1e-9)
        for name, values in parts[0][1].items():
            values = np.concatenate([fields[name] for _, fields in parts])
            np.testing.assert_allclose(grid.cell_data[name], values, rtol=1e-14, err_msg=name)
        assert len(set(grid.cell_data["rank"])) == COMM.size
    assert read_state(folder).n_cells == grid.n_cells


@pytest.mark.versions
def test_angles_are_in_degrees_in_files_and_as_before_when_read(tmp_path):
    """Of terms of one's own, too, which may have angles in degrees by themselves."""
    grid = grid_of(np.eye(3), np.array([[0, 1, 2]]), np.ones((3, 3)))
    known = {"shear_angle": "rad", "turned": "deg", "depth_mm": "mm", "share": "-"}
    for name in known:
        grid.cell_data[name] = [0.5]
    (tmp_path / "fields").mkdir()
    save(tmp_path / "fields/0000_0.vtu", grid, {"u": "mm"} | known)
    assert {*grid.cell_data} == {*known}  # what is written stays as it is
    (tmp_path / "fields.pvd").write_text(
        '<VTKFile type="Collection"><Collection>'
        '<DataSet timestep="1" part="0" file="fields/0000_0.vtu"/></Collection></VTKFile>'
    )
    (read,) = pyvista.PVDReader(tmp_path / "fields.pvd").read()
    values = {name: float(each[0]) for name, each in read.cell_data.items()}
    written = dict.fromkeys(("shear_angle_deg", "turned_deg", "depth_mm_mm", "share"), 0.5)
    assert values == written | {"shear_angle_deg": pytest.approx(np.degrees(0.5))}
    read = read_state(tmp_path)
    assert {*read.cell_data} == {*known} and read["u"].shape == (3, 3)
    assert all(read[name] == pytest.approx([0.5], rel=1e-14) for name in known)
    assert state_units(tmp_path) == {"u": "mm"} | known


def test_yarn_coordinates_of_straight_yarns_that_are_not_orthogonal():
    a, b = np.array([1.0, 0.0]), np.array([np.cos(1.1), np.sin(1.1)])
    blank = bare("P2", a=0.0, b=1.1)
    x = blank.coordinates()[:, :2]
    across = x @ np.column_stack([[0.0, 1.0], (a - (a @ b) * b) / np.sin(1.1)])
    np.testing.assert_allclose(yarn_coordinates(blank), across, atol=1e-12)


@pytest.mark.mpi
@pytest.mark.parametrize("element, spatial", [("P1", False), ("Q2", True)])
def test_yarn_coordinates_of_curved_yarns(by_position, element, spatial):
    """Yarns a are circles about a point, b the rays from it; distances across the circles stay,
    between rays they don't."""
    centre = np.array([-30.0, -20.0])

    def rays(x):
        return np.arctan2(x[1] - centre[1], x[0] - centre[0])

    blank = bare(element, spatial, nx=12, a=lambda x: rays(x) + np.pi / 2, b=rays)
    owned = blank.V.dofmap.index_map.size_local
    # of all ranks: what is fitted to the few nodes of one proves little
    x, found = by_position(COMM, blank.coordinates()[:owned], yarn_coordinates(blank)[:owned])
    x = x.T
    radius, angle = np.hypot(*(x[:2] - centre[:, None])), rays(x)
    for values, exact, allowed in ((found[:, 0], radius, 0.1), (found[:, 1], -60 * angle, 0.4)):
        values = values * np.sign(np.polyfit(exact, values, 1)[0])
        # one value a yarn: what is left beside a smooth function of that yarn
        smooth = np.polynomial.Polynomial.fit(exact, values, 5)
        assert abs(values - smooth(exact)).max() < allowed
        assert (smooth.deriv()(exact) > 0.3).all()


@pytest.mark.versions
@pytest.mark.mpi
def test_contact_fields_and_tools_at_each_state(tmp_path):
    folder, thickness = COMM.bcast(tmp_path), 0.4
    ball = ff.Offset(ff.Sphere(13.0, (30, 20, -20.0)), 2.0)
    ball = ff.Tool(ball, path=(0, 2, 6.0), name="ball & chain")
    table = ff.Tool(ff.Reversed(ff.Plane((0, 0, 1.0), (0, 0, 1))), name="table")
    contacts = [ff.Contact(tool, thickness, 100.0) for tool in (ball, table)]
    scene = sheet(spatial=True, nx=18, terms=contacts)
    blank = scene.blank

    def go_on(series, *loads):
        for at in loads:
            blank.u.x.array[2::3] = 0.5 * at
            for contact in contacts:
                contact.set_load(at)
            series.write(at)

    series = FieldSeries(folder, scene, ())
    go_on(series, 0.0, 0.5, 0.75)
    # as from a checkpoint that was made before the last state
    series = FieldSeries(folder, scene, [[at, list(ranks)] for at, ranks in series.states[:2]])
    if COMM.rank == 0:
        assert all(list(states(folder / f"{n}.pvd")) == [0.0, 0.5] for n in ("fields", "tools"))
        assert not (folder / "tools" / "0002_0.vtp").exists()
    go_on(series, 1.0)
    tractions = [contact.state().forces / contact.areas[:, None] for contact in contacts]
    traction = COMM.gather(np.stack(tractions, 1))
    places = COMM.gather(blank.coordinates()[: contacts[0].nodes.count])
    if COMM.rank != 0:
        return
    for at, (tools,) in states(folder / "tools.pvd").items():
        assert tools.keys() == ["ball & chain", "table"]
        first, second = tools
        centre = np.array([30, 20 + 2 * at, -20 + 6 * at])
        np.testing.assert_allclose(np.linalg.norm(first.points - centre, axis=1), 15, atol=1e-4)
        np.testing.assert_allclose(first["Normals"], (first.points - centre) / 15, atol=1e-4)
        np.testing.assert_allclose(second.points[:, 2], 1.0, atol=1e-5)
        np.testing.assert_allclose(second["Normals"][:, 2], -1.0, atol=1e-5)
        assert second.bounds[0] < 0 and second.bounds[1] > LENGTH
    for at, grids in states(folder / "fields.pvd").items():
        grid = pyvista.MultiBlock(grids).combine()
        centre = np.array([30, 20 + 2 * at, -20 + 6 * at])
        x = grid.points + grid["u"]
        gap = np.minimum(np.linalg.norm(x - centre, axis=1) - 15, 1 - x[:, 2]) - thickness / 2
        np.testing.assert_allclose(grid["contact_gap"], gap, atol=1e-9)
    assert gap.min() < -0.1
    distance, node = cKDTree(np.concatenate(places)).query(grid.points)
    assert distance.max() < 1e-9
    traction = np.concatenate(traction)[node]
    np.testing.assert_allclose(grid["contact_traction"], traction.sum(1), atol=1e-12)
    pressures = np.linalg.norm(traction, axis=2)
    np.testing.assert_allclose(grid["contact_pressure"], pressures.max(1), atol=1e-12)
    assert traction.any()


def test_a_later_state_at_the_same_load_and_a_new_run_replace_what_was_written(tmp_path):
    """And a scene without tools leaves none."""
    scene = sheet()
    series = FieldSeries(tmp_path, scene)
    for at, amount in ((0.0, 0.0), (1.0, 0.5), (1.0, 1.0)):
        deform(scene.blank, amount)
        series.write(at)
    assert [at for at, _ in series.states] == list(states(tmp_path / "fields.pvd")) == [0.0, 1.0]
    assert np.array_equal(read_state(tmp_path)["u"][:, :2], scene.blank.nodal_displacement())
    (tmp_path / "tools").mkdir()
    for file in ("fields/0000_0.vtu.part", "tools/0000_0.vtp", "tools.pvd"):
        (tmp_path / file).touch()
    FieldSeries(tmp_path, scene)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.mpi
def test_all_ranks_learn_of_the_file_that_one_cannot_write(tmp_path):
    folder, last = COMM.bcast(tmp_path), COMM.size - 1
    scene = sheet()
    series = FieldSeries(folder, scene)
    if COMM.rank == 0:
        (folder / "fields" / f"0000_{last}.vtu.part").mkdir()
    COMM.barrier()
    with pytest.raises(InputError, match=f"fields/0000_{last}.vtu can't be read or written"):
        series.write(0.0)


def test_a_mask_is_written_as_0_and_1():
    grid = grid_of(np.eye(3), np.array([[0, 1, 2]]), np.zeros((3, 3)))
    set_arrays(grid.GetCellData(), {"held": np.array([True])})
    assert grid.cell_data["held"].tolist() == [1]
