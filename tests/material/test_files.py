"""Materials in files: what is written reads back equal, units, intervals, and what a wrong file is
told."""

import math
import os
import tomllib

import numpy as np
import pytest
from fabrics import LAW58, TABLE

import fabric_fenicsx as ff
from fabric_fenicsx.material.laws.coupled import Yarn

KOMEILI, DC04 = ff.load("komeili"), ff.load_metal("dc04")
UNBALANCED = KOMEILI.replace(
    weft=Yarn(a=1 / 3, b=0.1 + 0.2, d=5e-324, c=math.pi, s_T=1e300),
    s2=-1 / 7,
    name='plain "2/2"\n\x7f µ',
    density=2 / 3,
)
FALLING = ff.MeasuredBending(curvature=(0, 0.005, 0.02), moment_a=(0, 0.04, 0.1))
FABRIC = """
thickness = 1.0
density = 0.75
[units]
stress = "MPa"
length = "mm"
density = "g/cm3"
[yarns]
a = 4130
b = 667.5
d = 0.65
p_min = 0.75
c = 23.67
s_T = 1467.6
s_C = 100
[shear]
s1 = 25.06e-3
s2 = -186.79e-3
s3 = 562.39e-3
"""
KILO = """
thickness = 0.1
density = 750
units = { stress = "kPa", length = "cm", density = "kg/m3" }
[yarns]
a = 1
b = 667.5e3
d = 650
p_min = 0.75
c = 23.67
s_T_MPa = 1467.6
s_C = 100
[warp]
a = 4130e3
[weft]
a_MPa = 4130
[shear]
s1 = 25.06
s2 = -186.79
s3 = 562.39
"""
CURVE = '[hardening]\nlaw = "swift"\nK_MPa = 520\neps0 = 0.002\nn = 0.2\n'
CURVE_OF = '[hardening]\nlaw = "table"\neps = '
METAL = f'law = "metal"\nE_GPa = 186.6\nnu = 0.3\nthickness_mm = 1\n{CURVE}'


@pytest.fixture
def read(tmp_path):
    """Function of a text and a loader to the material in it."""

    def read(text, load=ff.load):
        (tmp_path / "m.toml").write_text(text, encoding="utf-8")
        return load(tmp_path / "m.toml")

    return read


@pytest.mark.parametrize(
    "material",
    [
        UNBALANCED.without("biaxial").replace(assumed=["s1", "d"], compaction=None),
        KOMEILI.replace(bending=FALLING, shear_friction=ff.ShearFriction(0.2, 0.01)),
        LAW58,
        KOMEILI.replace(at_temperatures={200: {"s1": 0.01}, 20: {"s1": 0.08}}),
        TABLE.replace(compaction=ff.Compaction(12.5, onset=2e-3, pressure=5e-4)),
        LAW58.replace(
            compaction=ff.Compaction(12.5, onset=2e-3, pressure=5e-4, thickening=1.0),
            fibre_density=2.54,
            fibre_share=0.6,
            shear_friction=ff.ShearFriction((0.2, 0.05), (0.01, 0.02)),
            bending_friction=ff.BendingFriction((8.0, 2.0), (0.02, 0.01)),
            bending=ff.MeasuredBending(cantilever_a=210.0, cantilever_b=160.0),
            scatter={"E_a": (1e3, 2e3)},
        ),
        DC04.replace(hardening=ff.Voce(159.0, 180.0, 14.0), name="so named"),
        DC04.replace(hardening=ff.HardeningTable((0.0, 0.1, 0.3), (159.0, 260.0, 390.0))),
    ],
)
def test_a_file_reads_back_equal(tmp_path, material):
    load = ff.load_metal if isinstance(material, ff.Metal) else ff.load
    for _ in range(2):  # the second one overwrites
        material.to_toml(tmp_path / "m.toml", ["a remark"])
    again = load(tmp_path / "m.toml")
    assert again == material and again.dumps() == material.dumps()
    for name in ("scatter", "assumed"):
        assert getattr(again, name, ()) == getattr(material, name, ())
    assert os.listdir(tmp_path) == ["m.toml"]
    assert (tmp_path / "m.toml").read_text().startswith("# a remark\n")
    units = {"stress": "MPa", "length": "mm", "density": "g/cm3"}
    assert tomllib.loads(material.dumps())["units"] == units


@pytest.mark.parametrize("text", [KILO, "\ufeff" + FABRIC.replace("\n", "\r\n")])
def test_units_and_layouts_give_the_same_fabric(read, text):
    fabric = read(text)
    assert fabric == KOMEILI.replace(name="") and fabric.compaction == ff.Compaction()


def test_units_of_more_tables(read):
    fabric = read(
        f"fibre_density_kg_per_m3 = 2540\n{FABRIC}"
        "[compaction]\nexponent = 12.5\nonset_kPa = 2\npressure_Pa = 500\n"
        "[shear_friction]\nstiffness_kPa = 200\nstrength_kPa = [10]\n"
        # non-crimp fabric of Broberg et al. (2024), Composites B 274:111268
        "[bending]\ncurvature_1_per_m = [0, 1]\nmoment_a_Nmm_per_mm = [0, 0.119]\n"
        "[[at]]\ntemperature = 200\ns1_kPa = 10\n[[at]]\ntemperature = 20\ns1 = 0.08\n"
    )
    assert fabric.at(65.0).s1 == pytest.approx(0.0625)
    assert fabric.fibre_density == 2.54
    assert fabric.compaction == ff.Compaction(12.5, onset=2e-3, pressure=5e-4)
    assert fabric.shear_friction == ff.ShearFriction(0.2, 0.01)
    assert fabric.bending.stiffnesses(0.75) == pytest.approx([119.0, 119.0])
    text = METAL.replace(CURVE, f"{CURVE_OF}[0, 0.1]\nsigma_kPa = [159e3, 330e3]\n")
    text += "[scatter]\nyield_factor = [0.9, 1.1]\nE_GPa = [180, 210]\n"
    metal = read(text, ff.load_metal)
    assert (metal.E, metal.thickness, metal.density) == (186600.0, 1.0, 7.85)
    assert metal.hardening == ff.HardeningTable((0.0, 0.1), (159.0, 330.0))
    assert metal.scatter == {"yield_factor": (0.9, 1.1), "E": (1.8e5, 2.1e5)}
    harder = metal.changed({"yield_factor": 1.1}).hardening
    assert harder.stress(np.array([0.0, 0.1])) == pytest.approx([174.9, 363.0])
    size = "thickness = 1.0\ndensity = 0.75"
    by_area = FABRIC.replace(size, "thickness = 0.4\nareal_weight_g_per_m2 = 300")
    assert read(by_area).density == 0.75


def test_intervals_are_read_in_their_units_and_written(read):
    """A number that was changed has none, nor has one of both yarns that differ."""
    fabric = read(
        f"{FABRIC}[scatter]\ns1_kPa = [18, 35]\nthickness = [0.4, 2]\nshear_factor = [0.5, 2]"
    )
    told = {"s1": (0.018, 0.035), "thickness": (0.4, 2.0), "shear_factor": (0.5, 2.0)}
    assert fabric.scatter == told and fabric == KOMEILI.replace(name="")
    assert read(fabric.dumps()).scatter == told
    assert set(fabric.replace(s1=1.0).changed({"thickness": 1.1}).scatter) == {"shear_factor"}
    with pytest.raises(ff.InputError, match="and b is 667.5 and 300; expected an interval"):
        read(f"{FABRIC}[weft]\nb = 300\n[scatter]\nb = [200, 700]")


@pytest.mark.parametrize("fabric", [KOMEILI, LAW58, TABLE], ids=lambda fabric: fabric.law)
def test_a_factor_multiplies_the_stresses_of_one_kind(fabric):
    """A factor is of numbers that are changed with it."""
    komeili = KOMEILI.changed({"shear_factor": 2.0, "s1": 0.03})
    assert (komeili.s1, komeili.s3) == (0.06, 2 * 562.39e-3)
    states = np.array([[0.01, 0.0, -0.01, 0.0], [0.0, 0.02, -0.01, 0.0], [0.0, 0.0, 0.0, 0.35]])
    before = fabric.derivatives(*states).first
    for name, times in (("shear_factor", (1, 1, 3)), ("yarn_factor", (3, 3, 1))):
        after = fabric.changed({name: 3.0}).derivatives(*states).first
        assert after == pytest.approx(before * np.array(times)[:, None], rel=1e-12)


END = "s3 = 562.39e-3\n"
REFUSED = [  # of a file, or behind a line of it
    ("a = 4130", "a_psi = 1", "yarns.a_psi is unknown (did you mean a_Pa?); expected a_MPa"),
    ("a = 4130", "", "missing yarns.a; expected all of them, in [yarns] or [warp]"),
    ('density = "g/cm3"', "", "density has no unit; expected density_g_per_cm3 or density_kg"),
    ("thickness = 1.0", "law = 'tabelled'", "law 'tabelled' is unknown (did you mean tabulated?)"),
    (END, "[shear_friction]\nstiffness_MPa = [2, 1]\nstrength_MPa = 1", "2 stiffnesses and 1 str"),
    (END, "[bending]\ncantilever_a_mm = 200", "bending is incomplete, or given twice"),
    (END, "[bending]\ncurvature_1_per_m = [0, 1]\nmoment_a_N = [1, 1]", "a curve that rises "),
    (END, "[scatter]\ns1 = [0.02, 0.025]", "scatter.s1 is from 0.02 to 0.025, and s1 is 0.02506"),
    (CURVE, f"{CURVE_OF}[0]\nsigma_MPa = [1]", "two lists of 2 or more"),
    (CURVE, f"{CURVE_OF}[0, 1]\nsigma_MPa = [2, 1]", "point 2 is (1.0, 1.0"),
]


@pytest.mark.parametrize("old, new, words", REFUSED)
def test_what_is_wrong_in_a_file_is_said(read, old, new, words):
    text, load = (FABRIC, ff.load) if old in FABRIC else (METAL, ff.load_metal)
    with pytest.raises(ff.InputError) as error:
        read(text.replace(old, f"{END}{new}" if old == END else new, 1), load)
    assert "m.toml: " in str(error.value) and words in str(error.value)


def test_what_cannot_be_read_written_or_set(tmp_path):
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    for call, words in (
        (lambda: ff.load("nylon.toml"), r"nylon.toml' is unknown; expected a preset \(komeili, "),
        (lambda: ff.load(tmp_path / "bytes.toml"), "bytes.toml: cannot be read .*; expected TO"),
        (lambda: KOMEILI.to_toml(tmp_path / "none" / "x.toml"), "x.toml can't be read or written"),
        (lambda: KOMEILI.replace(fibre_density=0.75), "fibre_density is 0.75 g/cm3; expected"),
    ):
        with pytest.raises(ff.InputError, match=words):
            call()
    assert os.listdir(tmp_path) == ["bytes.toml"]


def test_numbers_that_no_test_has_determined_are_told_where_they_act():
    assert KOMEILI.assumed_values() == {"d": "0.65 MPa", "p_min": "0.75", "s_C": "100"}
    assert set(KOMEILI.without("biaxial").assumed_values()) == {"d", "s_C"}
    unbalanced = KOMEILI.replace(weft=Yarn(b=300.0, d=1.9), assumed=["s1", "d"])
    assert list(unbalanced.assumed_values().values()) == ["0.65 MPa and 1.9 MPa", "0.02506 MPa"]
