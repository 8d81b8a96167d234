"""Curves of material tests in CSV files, read and checked as a whole before anything is fitted.

docs/howto/own_data.md has the format, `model.TESTS` the tests with their columns and keys. The
usual strip test, with nothing at its sides, is `lateral: free`: the width follows from sigma_b = 0,
be it measured (eps_b) or not. A strip as wide as it is long, or a biaxial rig, comes near `held`,
eps_b = 0. Stresses are nominal, conjugate to (eps_a, eps_b, gamma) per undeformed volume: sigma_i =
dW/d(eps_i), tau = dW/d(gamma). Yarns start at right angles. Noise is the standard deviation of a
test.
"""

from .checks import curve_warnings
from .model import STRAINS, TESTS, CompactionTest, Curve, Response, Sheet, bias_normalised
from .reading import read, read_sheet
