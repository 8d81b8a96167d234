"""The parameters of a woven fabric from test curves: two-stage nonlinear regression with confidence
intervals.

Stage 1 fits a, b, d and s1..s3 to the points at which no coupling acts (other yarns unstrained, no
shear: k_TC = 1 in eq. (17)); stage 2 fits c, p_min, s_T, s_C to all points with the former held, as
in the paper. A joint fit of all of them from there gives the result, since stage 2 alone would hide
what stage 1 leaves uncertain. A parameter is fitted only if the data determine it: a test excites
it, its interval at 1 % noise or more is narrow enough (`problem.Problem.undetermined`), and p_min
only from tension with a negative strain across, as tension-tension data hardly tell it from c. All
others keep an assumed value, and say so; `[assumed]` of the data set's sheet.toml replaces those of
Table 1, and is also where the fit starts. A fabric with balanced = false of which only one
direction was pulled is refused: what its other direction is must be said, by a test or in
sheet.toml, as another fabric's would make up the very difference that the user asked for.

Stresses are those of the law (`homogeneous.nominal`); nothing of the law is repeated here.
"""

from .fit import identify
from .lines import coverage_lines, result_lines
from .pictures import draw
from .problem import true_values
from .result import Assumed, Determined, Identification
from .synthetic import PLANS, coverage, synthesise

__all__ = [
    "PLANS",
    "Assumed",
    "Determined",
    "Identification",
    "coverage",
    "coverage_lines",
    "draw",
    "identify",
    "result_lines",
    "synthesise",
    "true_values",
]
