"""Fields in files, and units."""

import math

import meshio
import numpy as np
import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.core.rules import FROM_ZERO
from fabric_fenicsx.io import units
from fabric_fenicsx.io.field import of_place

GRID = np.stack(np.meshgrid(np.linspace(-20, 20, 5), np.linspace(0, 10, 3)), -1).reshape(-1, 2)
INSIDE = np.array([[1.0, 2.0, 0.0], [-13.0, 9.0, 5.0], [20.0, 10.0, 0.0]])


def linear(x, y):
    return 3.0 + 0.1 * x - 0.2 * y


def mesh(path, **data):
    cells = {"vertex": np.arange(len(GRID))[:, None]}
    points = np.column_stack([GRID, 0 * GRID[:, 0]])
    meshio.write(path, meshio.Mesh(points, cells, data or {"v": linear(*GRID.T)}))
    return path


def test_a_file_is_its_function_between_the_points_and_its_nearest_point_beyond(tmp_path):
    files, rows = (tmp_path / "f.csv", mesh(tmp_path / "f.vtu")), [*GRID.T, linear(*GRID.T)]
    how = {"delimiter": ",", "header": "x [mm],y [mm],T [deg C]", "comments": ""}
    np.savetxt(files[0], np.transpose(rows), **how)
    for field in map(ff.Field, files):
        assert field.at(INSIDE) == pytest.approx(ff.Field(linear).at(INSIDE), rel=1e-12)
        beyond = field.at(np.array([[35.0, 14.0, 0.0], [-3.0, -9.0, 0.0]]))
        assert beyond == pytest.approx([linear(20, 10), linear(0, 0)])
        with pytest.raises(ff.InputError, match=r"no point within 80.6 mm of \(90, 50\)"):
            field.at(np.array([[0.0, 0.0, 0.0], [90.0, 50.0, 0.0]]))
        assert field.at(np.array([[59.9, 10.0, 0]])) == pytest.approx(linear(20, 10))
        with pytest.raises(ff.InputError, match="no point within 40.1 mm"):  # as far as they reach
            field.at(np.array([[60.1, 10.0, 0]]))
    twice = tmp_path / "twice.csv"
    twice.write_text("x,y,v\n0,0,1\n0,0,1.0000000005\n1,0,3\n0,1,2\n")
    assert ff.Field(twice).at(np.zeros((1, 3))) == pytest.approx(1)
    two = mesh(tmp_path / "two.vtu", v=linear(*GRID.T), w=0 * GRID[:, 0])
    assert ff.Field(two, "v") == ff.Field(files[0]) != ff.Field(two, "w")


def test_in_space(tmp_path):
    rng = np.random.default_rng(0)
    x = rng.uniform(-10, 10, (40, 3))
    values = x @ [0.01, 0.02, 0.03] + 1
    path = tmp_path / "f.csv"
    np.savetxt(path, np.column_stack([x, values]), delimiter=";", header="x;y;z;mu", comments="")
    field = of_place(FROM_ZERO, "xyz").check("`friction`", str(path))
    places = rng.uniform(-3, 3, (5, 3))
    assert field.at(places) == pytest.approx(places @ [0.01, 0.02, 0.03] + 1)
    with pytest.raises(ff.InputError, match="whose points have different z"):
        of_place(FROM_ZERO).check("`friction`", str(path))


def test_a_bad_file_or_function_is_told(tmp_path):
    path = tmp_path / "bad.csv"
    for text, said in (
        ("x,y,v\n0,0,1\n1,1,2\n2,2,3\n", "its 3 points span no area"),
        ("x,y,v\n0,0,1\n0,0,2\n1,0,3\n", r"at \(0, 0\) mm there are the values 1 and 2"),
        ("x,y,v\n0,0,1\n0,0,1.000000002\n1,0,3\n0,1,2\n", "there are the values 1 and 1"),
        ("x,y,v\n0,0,1\n1,0,2\n0,1,-1\n", r"`mu` at \(0, 1\) mm is -1.0; expected a number"),
    ):
        path.write_text(text)
        with pytest.raises(ff.InputError, match=said):
            of_place(FROM_ZERO).check("`mu`", str(path))
    for function, said in (
        (lambda x: x, r"`mu` as a function of x, y fails \(TypeError"),
        (lambda x, y: 0.1 * x, r"`mu` at \(-13, 9, 5\) mm is -1.3; expected a number from 0"),
    ):
        with pytest.raises(ff.InputError, match=said):
            of_place(FROM_ZERO).check("`mu`", function).at(INSIDE)


FACTORS = {
    **{"MPa": 1, "kPa": 1e-3, "Pa": 1e-6, "GPa": 1e3, "mm": 1, "cm": 10, "m": 1e3, "um": 1e-3},
    **{"g/cm3": 1, "kg/m3": 1e-3, "g/m2": 1, "kg/m2": 1e3, "Nmm": 1, "Nm": 1e3, "1/mm": 1},
    **{"1/m": 1e-3, "N": 1, "mN": 1e-3, "Nmm/mm": 1},
}


def test_factors_of_all_units():
    known = [each for kind in units.UNITS for each in units.factors(kind).items()]
    assert dict(known) == FACTORS and len(known) == len(FACTORS)
    assert units.ANGLE == {"rad": 1, "deg": pytest.approx(math.pi / 180)}
    assert units.STRAIN == {"-": 1, "%": 0.01}
    per_width = {"N/mm": 2, "N/m": 2e-3, "kN/m": 2}  # of a sheet of 0.5 mm
    assert units.stresses(0.5) == units.factors("stress") | {"N/mm2": 1} | per_width
    assert units.suffixes("density") == {"g_per_cm3": 0, "kg_per_m3": -3}
