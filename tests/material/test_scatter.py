"""Intervals of numbers in material files, and numbers of a material that are changed."""

import numpy as np
import pytest
from fabrics import LAW58, TABLE

import fabric_fenicsx as ff
from fabric_fenicsx.core.errors import InputError

KOMEILI = ff.load("komeili")
FABRIC = KOMEILI.dumps() + "[scatter]\n"
DC04 = ff.load_metal("dc04").replace(hardening=ff.HardeningTable((0, 0.1), (200, 300)))
METAL = DC04.dumps() + "[scatter]\nyield_factor = [0.9, 1.1]\nE = [1.8e5, 2.1e5]\n"


@pytest.fixture
def read(tmp_path):
    def read(text, load=ff.load):
        (tmp_path / "own.toml").write_text(text)
        return load(tmp_path / "own.toml")

    return read


def test_intervals_are_read_in_their_units_and_written(read):
    """A number that was changed has none, nor has one of both yarns that differ."""
    fabric = read(FABRIC + "s1_kPa = [18, 35]\nthickness = [0.4, 2]\nshear_factor = [0.5, 2]")
    told = {"s1": (0.018, 0.035), "thickness": (0.4, 2.0), "shear_factor": (0.5, 2.0)}
    assert fabric.scatter == told and fabric == KOMEILI
    assert read(fabric.dumps()).scatter == told
    assert set(fabric.replace(s1=1.0).changed({"thickness": 1.1}).scatter) == {"shear_factor"}
    text = FABRIC.replace("[shear]", "[weft]\nb = 300\n[shear]")
    with pytest.raises(InputError, match="and b is 667.5 and 300; allowed is an interval"):
        read(text + "b = [200, 700]")


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


def test_a_metals_yield_stress_scatters(read):
    metal = read(METAL, ff.load_metal)
    assert metal.scatter == {"yield_factor": (0.9, 1.1), "E": (1.8e5, 2.1e5)}
    harder = metal.changed({"yield_factor": 1.1}).hardening
    assert harder.stress(np.array([0.0, 0.1])) == pytest.approx((220.0, 330.0))
