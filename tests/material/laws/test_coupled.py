"""WovenFabric: which of its numbers are assumed."""

from fabric_fenicsx.material.laws.coupled import Yarn
from fabric_fenicsx.material.presets import PRESETS

KOMEILI = PRESETS["komeili"]


def test_numbers_that_no_test_has_determined_are_told_where_they_act():
    assert KOMEILI.assumed == ("d", "p_min", "s_C")
    assert KOMEILI.assumed_values() == {"d": "0.65 MPa", "p_min": "0.75", "s_C": "100"}
    assert set(KOMEILI.without("biaxial").assumed_values()) == {"d", "s_C"}
    assert KOMEILI.replace(assumed=()).assumed_values() == {}
    assert KOMEILI.without("tension–shear").couplings == {"biaxial", "compression_shear"}
    unbalanced = KOMEILI.replace(weft=Yarn(b=300.0, d=1.9), assumed=["s1", "d"])
    assert list(unbalanced.assumed_values().values()) == ["0.65 MPa and 1.9 MPa", "0.02506 MPa"]
