"""Curves of material tests in CSV files, read and checked as a whole before anything is fitted.

A data set is a folder with one `sheet.toml` (the sheet) and one CSV file a test. A CSV file has
comment lines `# key: value` that state the test, then a header `name [unit]` for each column, then
rows of numbers:

    # test: uniaxial_a
    # lateral: free
    # noise: 2 % of maximum
    eps_a [%], sigma_a [N/mm]
    0.1, 1.36

docs/howto/own_data.md has the whole format, `model.TESTS` the tests with their columns and keys.

The usual strip test, pulled between two grips with nothing at its sides, is `lateral: free`: the
width follows from sigma_b = 0, be it measured (eps_b) or not. A strip as wide as it is long, or a
biaxial rig, comes near `held`, eps_b = 0.

Stresses are nominal, conjugate to (eps_a, eps_b, gamma) per undeformed volume: sigma_i =
dW/d(eps_i), tau = dW/d(gamma); a force per width (N/mm) is divided by the sheet's thickness. Yarns
start at right angles. Noise is the standard deviation of a test.
"""

from .checks import check_copies, curve_warnings
from .forces import bias_displacement, bias_force, bias_normalised
from .model import MIN_POINTS, STRAINS, TESTS, CompactionTest, Curve, Response, Sheet
from .reading import read, read_sheet
