"""Compaction and fibres of a fabric in its material file."""

import math

import pytest

import fabric_fenicsx as ff
from fabric_fenicsx.material.laws import LAWS
from fabric_fenicsx.runtime.errors import InputError

KOMEILI = ff.load("komeili")
LAW58 = LAWS["law58"](1335.0, 900.0, 4000.0, 0.0, 1e-3, 0.025, 0.6, 0.8, thickness=0.4)
OWN = ff.Compaction(12.5, onset=2e-3, pressure=5e-4)


def written(tmp_path, text):
    path = tmp_path / "m.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("fabric", [KOMEILI, LAW58], ids=["coupled", "law58"])
@pytest.mark.parametrize("compaction", [ff.Compaction(), OWN, None])
@pytest.mark.parametrize("fibre_density", [None, 2.54])
def test_a_file_reads_back_equal(tmp_path, fabric, compaction, fibre_density):
    fabric = fabric.replace(compaction=compaction, fibre_density=fibre_density)
    path = tmp_path / "m.toml"
    fabric.to_toml(path)
    assert ff.load(path) == fabric
    told = "compaction = false" if compaction is None else "[compaction]\nexponent = "
    assert told in path.read_text()
    assert ("fibre_density" in path.read_text()) == (fibre_density is not None)


def test_a_file_that_says_nothing_has_the_default(tmp_path):
    text = LAW58.dumps()
    start = text.index("[compaction]")
    path = written(tmp_path, text[:start] + text[start:].partition("\n\n")[2])
    assert "compaction" not in path.read_text()
    assert ff.load(path).compaction == ff.Compaction()


TABLE = """[compaction]
exponent = 16.0
onset = 0.001
pressure = 0.001
"""


@pytest.mark.parametrize(
    "table",
    [
        "exponent = 12.5\nonset_kPa = 2\npressure_Pa = 500\n",
        "exponent = 12.5\nonset = 0.002\npressure_kPa = 0.5\n",  # the file has stress = "MPa"
    ],
)
def test_units_are_in_the_key_or_in_units(tmp_path, table):
    text = KOMEILI.dumps().replace(TABLE, f"[compaction]\n{table}")
    assert ff.load(written(tmp_path, text)).compaction == OWN


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (TABLE, "[compaction]\nexponent = 16\n", "missing compaction.onset, compaction.pressure;"),
        ("exponent = 16.0", "exponent = 1.0", "compaction.exponent is 1.0; allowed is a number a"),
    ],
)
def test_bad_tables_are_refused(tmp_path, old, new, words):
    text = KOMEILI.dumps()
    assert old in text
    with pytest.raises(InputError) as error:
        ff.load(written(tmp_path, text.replace(old, new)))
    assert "m.toml: " in str(error.value) and words in str(error.value)


@pytest.mark.parametrize("value", ["3"])
def test_a_word_for_compaction_is_refused(tmp_path, value):
    path = written(tmp_path, f"compaction = {value}\n" + KOMEILI.dumps().replace(TABLE, ""))
    words = r"allowed is a table \[compaction\], or false"
    with pytest.raises(InputError, match=words):
        ff.load(path)


def test_fibre_volume_fraction():
    """0.75 g/cm3 of fabric, of fibres of 2.5 g/cm3; half the thickness, or half the area, has twice
    the share."""
    fabric = KOMEILI.replace(fibre_density=2.5)
    assert fabric.fibre_volume_fraction(1.0) == pytest.approx(0.3)
    assert fabric.fibre_volume_fraction(0.5) == pytest.approx(0.6)
    sheared = math.cos(math.radians(30))
    assert fabric.fibre_volume_fraction(1.0, sheared) == pytest.approx(0.3 / sheared)
    thin = fabric.replace(thickness=0.2)  # of the same density
    assert thin.fibre_volume_fraction(0.2) == pytest.approx(0.3)
    with pytest.raises(InputError, match="fibre_density of material komeili is not known"):
        KOMEILI.fibre_volume_fraction(1.0)


@pytest.mark.parametrize("fibre_density", [0.75])
def test_bad_fibre_densities_are_refused(fibre_density):
    with pytest.raises(InputError, match="fibre_density is .*; allowed is"):
        KOMEILI.replace(fibre_density=fibre_density)


def test_units_of_a_fibre_density(tmp_path):
    text = f"fibre_density_kg_per_m3 = 2540\n{KOMEILI.dumps()}"
    assert ff.load(written(tmp_path, text)).fibre_density == 2.54
    doubt = KOMEILI.replace(fibre_density=25.4).plausibility_warnings()
    assert doubt == [
        "fibre_density of material komeili is 25.4 g/cm3, fabrics have 0.8 to 10; look at its unit"
    ]


def test_another_compaction_is_another_material():
    """A checkpoint knows a material by the text of its file."""
    assert KOMEILI.replace(compaction=OWN).dumps() != KOMEILI.dumps()
    assert KOMEILI.replace(fibre_density=2.5).dumps() != KOMEILI.dumps()
