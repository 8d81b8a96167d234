"""WovenFabric: values, switches, TOML files and what a wrong input says."""

import math
import os
import re
import tomllib

import numpy as np
import pytest

from fabric_fenicsx.material.laws import COUPLINGS
from fabric_fenicsx.material.laws.coupled import WovenFabric, Yarn
from fabric_fenicsx.material.presets import PRESETS, load
from fabric_fenicsx.runtime.errors import InputError

KOMEILI = PRESETS["komeili"]
UNBALANCED = KOMEILI.replace(
    weft=Yarn(a=1 / 3, b=0.1 + 0.2, d=5e-324, c=math.pi, s_T=1e300),
    s2=-1 / 7,
    name='plain "2/2"\n\x7f µ',
    density=2 / 3,
)
MM = """
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
KEYS = """
thickness_um = 1000
density_kg_per_m3 = 750
[yarns]
a_GPa = 4.13
b_MPa = 667.5
d_kPa = 650
p_min = 0.75
c = 23.67
s_T_Pa = 1467.6e6
s_C = 100
[shear]
s1_kPa = 25.06
s2_Pa = -186790
s3_GPa = 562.39e-6
"""
KILO = """
thickness = 0.1
density = 750
[units]
stress = "kPa"
length = "cm"
density = "kg/m3"
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


def write(tmp_path, text):
    path = tmp_path / "weave.toml"
    path.write_text(text, encoding="utf-8")
    return path


def numbers(fabric):
    yarns = [value for yarn in (fabric.warp, fabric.weft) for value in vars(yarn).values()]
    return [*yarns, fabric.s1, fabric.s2, fabric.s3]


def test_table_1():
    yarn = [4130.0, 667.5, 0.65, 0.75, 23.67, 1467.6, 100.0]
    assert numbers(KOMEILI) == [*yarn, *yarn, 0.02506, -0.18679, 0.56239]
    assert (KOMEILI.thickness, KOMEILI.density, KOMEILI.name) == (1.0, 0.75, "komeili")
    assert len(numbers(KOMEILI)) == 17
    assert KOMEILI.is_balanced
    assert not UNBALANCED.is_balanced


def test_switches():
    assert KOMEILI.couplings == frozenset(COUPLINGS)
    for spelling in ("tension_shear", "tension-shear", "tension–shear"):
        assert KOMEILI.without("biaxial", spelling).couplings == {"compression_shear"}
    assert KOMEILI.without() == KOMEILI
    assert KOMEILI.decoupled().couplings == PRESETS["fabric"].couplings == frozenset()
    assert numbers(PRESETS["fabric"]) == numbers(KOMEILI)
    with pytest.raises(
        InputError, match=r"'tension_sheer' is unknown \(did you mean tension_shear\?\); allowed"
    ):
        KOMEILI.without("tension_sheer")
    with pytest.raises(
        InputError, match="couplings is 'biaxial'; allowed is a list of biaxial, tension_shear"
    ):
        KOMEILI.replace(couplings="biaxial")


def test_replace():
    fabric = KOMEILI.replace(p_min=0.1, s1=1, weft=UNBALANCED.weft)
    assert (fabric.warp.p_min, fabric.weft.p_min, fabric.weft.a, fabric.s1) == (
        0.1,
        0.1,
        1 / 3,
        1.0,
    )
    assert KOMEILI.warp.p_min == 0.75
    with pytest.raises(InputError, match=r"replace: pmin is unknown \(did you mean p_min\?\)"):
        KOMEILI.replace(pmin=0.1)


def test_numbers_become_floats():
    fabric = KOMEILI.replace(a=4130, c=np.float32(0.5), s2=-0.0)
    assert {type(v) for v in numbers(fabric)} == {float}
    assert math.copysign(1, fabric.s2) == 1
    assert hash(fabric) == hash(KOMEILI.replace(a=4130.0, c=0.5, s2=0.0))


def test_symbols():
    made = []
    symbols = UNBALANCED.without("biaxial").symbols(lambda v: made.append(v) or f"<{v}>")
    assert made == [*numbers(UNBALANCED), UNBALANCED.thickness]
    assert (symbols.warp.a, symbols.weft.s_T, symbols.thickness) == (
        "<4130.0>",
        "<1e+300>",
        "<1.0>",
    )
    assert symbols.couplings == {"tension_shear", "compression_shear"}


def test_each_number_goes_through_its_rule():
    for name in [*KOMEILI.parameters, "thickness", "density"]:
        with pytest.raises(InputError, match=rf"{name} is nan; allowed is a \w+"):
            KOMEILI.replace(**{name: math.nan})


@pytest.mark.parametrize(
    "fabric",
    [
        *PRESETS.values(),
        UNBALANCED,
        UNBALANCED.without("biaxial"),
        KOMEILI.replace(p_min=0.1 + 0.2),
    ],
)
def test_round_trip_is_exact(tmp_path, fabric):
    path = tmp_path / "weave.toml"
    for _ in range(2):  # the second one overwrites
        fabric.to_toml(path)
    again = WovenFabric.from_toml(path)
    assert again == fabric
    assert [v.hex() for v in numbers(again)] == [v.hex() for v in numbers(fabric)]
    assert os.listdir(tmp_path) == ["weave.toml"]
    assert tomllib.loads(fabric.dumps())["units"] == {
        "stress": "MPa",
        "length": "mm",
        "density": "g/cm3",
    }


@pytest.mark.parametrize("text", [MM, KEYS, KILO, "\ufeff" + MM, MM.replace("\n", "\r\n")])
def test_units_and_layouts_give_the_same_fabric(tmp_path, text):
    assert load(write(tmp_path, text)) == KOMEILI.replace(name="")


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("a = 4130", "a = -1", "yarns.a is -1; allowed is a number from 0"),
        ("a = 4130", "a = 1\na_Pa = 1", "yarns.a_Pa repeats yarns.a; allowed is a once"),
        (
            "a = 4130",
            "a_psi = 1",
            "yarns.a_psi: stress unit 'psi' is unknown; allowed are MPa, kPa, Pa, GPa",
        ),
        ("a = 4130", "", "missing yarns.a; allowed is to give all, in [yarns] or [warp]"),
        ("[yarns]", "[warp]", "missing weft.a, weft.b, weft.d"),
        (
            "p_min =",
            "p_mn =",
            "yarns.p_mn is unknown (did you mean p_min?); allowed are a, b, d, p_min",
        ),
        (
            "p_min =",
            "p_min_MPa =",
            "yarns.p_min_MPa has a unit, but p_min is a pure number; allowed is the key p_min",
        ),
        ("[shear]", "[sheer]", "sheer is unknown (did you mean shear?)"),
        (
            'density = "g/cm3"',
            "",
            "density has no unit; allowed is density_g_per_cm3 or density_kg_per_m3, or",
        ),
        (
            'stress = "MPa"',
            'sress = "MPa"',
            "units.sress is unknown (did you mean stress?); allowed are stress",
        ),
        ("thickness = 1.0", "thickness = 1.0\nwarp = 1", "warp is 1; allowed is a table, [warp]"),
        (
            "thickness = 1.0",
            "thickness = 1.0\ncouplings = ['biaxal']",
            "'biaxal' is unknown (did you mean biaxial?)",
        ),
    ],
)
def test_bad_files(tmp_path, old, new, sentence):
    assert old in MM
    path = write(tmp_path, MM.replace(old, new, 1))
    with pytest.raises(InputError, match=re.escape(f"{path}: ") + ".*" + re.escape(sentence)):
        load(path)


def test_files_that_cannot_be_read_or_written(tmp_path):
    with pytest.raises(
        InputError,
        match=r"nylon.toml' is unknown; allowed is a preset \(komeili, fabric\) or a file that",
    ):
        load("nylon.toml")
    with pytest.raises(InputError, match=r"cannot be read .Is a directory"):
        load(tmp_path)
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="bytes.toml: cannot be read .*; allowed is a TOML file"):
        load(tmp_path / "bytes.toml")
    target = tmp_path / "none" / "x.toml"
    with pytest.raises(InputError, match=re.escape(f"{target}: cannot be written")):
        KOMEILI.to_toml(target)
    assert os.listdir(tmp_path) == ["bytes.toml"]


def test_presets():
    assert load("komeili") is KOMEILI and load("fabric").name == "fabric"


def test_values_of_a_wrong_unit_are_doubted():
    fabric = PRESETS["komeili"]
    assert fabric.plausibility_warnings() == []
    (thin,) = fabric.replace(thickness=4e-4).plausibility_warnings()
    assert thin.startswith("thickness of material komeili is 0.0004 mm, fabrics have 0.01 to 20")
    in_gpa = fabric.replace(b=667.5e3)
    assert [warning.split()[0] for warning in in_gpa.plausibility_warnings()] == ["b"]


def test_numbers_that_no_test_has_determined_are_told_where_they_act():
    assert KOMEILI.assumed == ("d", "p_min", "s_C")
    assert KOMEILI.assumed_values() == {"d": "0.65 MPa", "p_min": "0.75", "s_C": "100"}
    assert set(KOMEILI.without("biaxial").assumed_values()) == {"d", "s_C"}
    assert KOMEILI.replace(assumed=()).assumed_values() == {}
    weft = UNBALANCED.replace(assumed=["s1", "d"])
    assert list(weft.assumed_values().values()) == ["0.65 MPa and 4.94066e-324 MPa", "0.02506 MPa"]


def test_assumed_numbers_are_kept_in_a_file(tmp_path):
    KOMEILI.to_toml(tmp_path / "fabric.toml")
    assert load(tmp_path / "fabric.toml").assumed == KOMEILI.assumed


def test_unknown_assumed_numbers_are_refused():
    with pytest.raises(InputError, match="assumed: 'D' is unknown"):
        KOMEILI.replace(assumed=["D"])
