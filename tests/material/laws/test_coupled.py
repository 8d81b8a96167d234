"""WovenFabric: which of its numbers are assumed."""

import math

from fabric_fenicsx.material.laws.coupled import Yarn
from fabric_fenicsx.material.presets import PRESETS

KOMEILI = PRESETS["komeili"]
UNBALANCED = KOMEILI.replace(
    weft=Yarn(a=1 / 3, b=0.1 + 0.2, d=5e-324, c=math.pi, s_T=1e300),
    s2=-1 / 7,
    name='plain "2/2"\n\x7f µ',
    density=2 / 3,
)


def test_numbers_that_no_test_has_determined_are_told_where_they_act():
    assert KOMEILI.assumed == ("d", "p_min", "s_C")
    assert KOMEILI.assumed_values() == {"d": "0.65 MPa", "p_min": "0.75", "s_C": "100"}
    assert set(KOMEILI.without("biaxial").assumed_values()) == {"d", "s_C"}
    assert KOMEILI.replace(assumed=()).assumed_values() == {}
    assert KOMEILI.without("tension–shear").couplings == {"biaxial", "compression_shear"}
    weft = UNBALANCED.replace(assumed=["s1", "d"])
    assert list(weft.assumed_values().values()) == ["0.65 MPa and 4.94066e-324 MPa", "0.02506 MPa"]
