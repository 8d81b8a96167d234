"""The parameters of a woven fabric from test curves: two-stage nonlinear regression with confidence
intervals. Nothing here needs DOLFINx.

Stage 1 fits a, b, d and s1..s3 to the points at which no coupling acts (other yarns unstrained, no
shear: k_TC = 1 in eq. (17)). Stage 2 fits c, p_min, s_T, s_C to all points with the former fixed,
as in the paper. A joint fit of all of them from there gives the result, since stage 2 alone would
hide what stage 1 leaves uncertain.

A parameter is fitted only if the data determine it (`problem.Problem.undetermined`). p_min needs
tension with a negative strain across, as tension-tension data hardly tell it from c; without that
strain free strips have a p_min of 1, with which held ones are not too stiff. All others keep the
value of `[assumed]` in sheet.toml or of Table 1, and the result says so. A direction that was
neither pulled nor stated is refused: it would get another fabric's values.
"""

from .fit import identify, identify_simulated
from .problem import Assumed, Determined
from .result import Identification
from .separate import CompactionFit, fit_compaction
