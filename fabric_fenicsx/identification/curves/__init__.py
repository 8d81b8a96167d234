"""Curves of material tests in CSV files, read and checked as a whole before anything is fitted.

A data set is a folder with one `sheet.toml` (the sheet) and one CSV file a test. A CSV file starts
with comment lines `# key: value` that state the test, then a header `name [unit]` for each column,
then rows of numbers; machines' own spellings are read as well, see `material.text_tables`:

    # test: uniaxial_a
    # lateral: free
    # noise: 2 % of maximum
    eps_a [%], sigma_a [N/mm]
    0.1, 1.36

| test | columns | further keys |
|---|---|---|
| uniaxial_a | eps_a; sigma_a; where measured sigma_b (held), eps_b (free) | lateral: held or free |
|  | displacement in place of eps_a; F in place of sigma_a | length; width |
| uniaxial_b | the same with a and b exchanged | |
| biaxial | eps_a, eps_b; sigma_a and/or sigma_b | |
| compression_a | eps_a; sigma_a; optional gamma (sheared compression) | |
| compression_b | the same with a and b exchanged | |
| shear | gamma; tau or F_sh; optional eps_a, eps_b (pre-strain) | |
| picture_frame | gamma; F; optional eps_a, eps_b (pre-strain) | frame_length, fabric_length |
| bias_extension | gamma or displacement; F | height, width |
| compaction | pressure; thickness or fibre_volume_fraction of one ply between plates | |

The usual strip test, pulled between two grips with nothing at its sides, is `lateral: free`: the
width follows from sigma_b = 0, be it measured (eps_b) or not. A strip as wide as it is long, or a
biaxial rig, comes near `held`, eps_b = 0.

Every file may state `noise` (standard deviation): `2 % of maximum` (of each column's largest
value), `5 % of value`, or an absolute `0.2 MPa` if one column is measured. Stresses are nominal,
conjugate to (eps_a, eps_b, gamma) per undeformed volume: sigma_i = dW/d(eps_i), tau = dW/d(gamma);
a force per width (N/mm) is divided by the sheet's thickness. Yarns start at right angles.

A test of tension or shear may state `slack`, the displacement, strain or angle from which its
strain counts. `sheet.toml` may state keys, too, in [tests."FILE"], and in [columns] what other
names of columns mean.

`sheet.toml` says thickness_mm, balanced (whether warp and weft are equal), density_g_per_cm3 or
areal_weight_g_per_m2 (density = areal weight / thickness), fibre_density_g_per_cm3 if it is known,
and in [assumed], [assumed.warp], [assumed.weft] values for parameters that the data do not
determine.
"""

from .checks import check_contradictions, unit_warnings
from .forces import bias_displacement, bias_force, bias_normalised
from .model import MIN_POINTS, STRAINS, TESTS, CompactionTest, Curve, Response, Sheet
from .reading import read, read_curve, read_sheet
from .writing import write

__all__ = [
    "MIN_POINTS",
    "STRAINS",
    "TESTS",
    "CompactionTest",
    "Curve",
    "Response",
    "Sheet",
    "bias_displacement",
    "bias_force",
    "bias_normalised",
    "check_contradictions",
    "read",
    "read_curve",
    "read_sheet",
    "unit_warnings",
    "write",
]
