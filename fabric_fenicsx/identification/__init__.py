"""The parameters of a woven fabric from test curves: two-stage nonlinear regression with confidence
intervals. Nothing here needs DOLFINx.

Slack and the load cell's zero of each test with the columns displacement and F come first: they are
fitted to the test itself, with a stiffness that may be any smooth one (`origin`). What they leave
uncertain widens the intervals of the parameters.

Stage 1 fits a, b, d and s1..s3 to the points at which no coupling acts (other yarns unstrained, no
shear: k_TC = 1 in eq. (17)). Stage 2 fits c, p_min, s_T, s_C to all points with the former fixed,
as in the paper. A joint fit of all of them from there gives the result, since stage 2 alone would
hide what stage 1 leaves uncertain.

A parameter is fitted only if the data determine it: a test excites it, and its interval at 1 %
noise or more is narrow enough (`problem.Problem.undetermined`). p_min needs tension with a negative
strain across, as tension-tension data hardly tell it from c. Free strips need that strain, too, or
p_min is 1, with which held strips are not too stiff. All other parameters keep an assumed
value, that of `[assumed]` in sheet.toml or of Table 1, and the result says so.

A fabric with balanced = false is refused if only one of its directions was pulled and nothing
states the other: another fabric's values would invent the very difference that the user asks for.

`identify_simulated` predicts raw bias tests by simulated specimens, for which its caller gives
a function.

Compaction is apart from that: `fit_compaction` fits it to tests across the thickness alone.
"""

from .compaction import CompactionFit, fit_compaction
from .fit import identify
from .pictures import draw
from .problem import Assumed, Determined
from .result import Identification, result_lines
from .simulated import identify_simulated
