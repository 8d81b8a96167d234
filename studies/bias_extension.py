"""Bias extension of a woven strip with yarns at +-45 deg to the load and clamped ends: Fig. 9 of
Schäfer et al."""

from fabric_fenicsx.cli.study import Study, parser, run
from fabric_fenicsx.coupons.bias_extension import BiasExtension


def options():
    return parser(BiasExtension, __doc__)


def main(study: Study):
    bias = study.build(study.describe(BiasExtension))
    result = study.run(bias)
    q, theory = result.summary["quantities"], "no theory"
    centre = "no cell at the centre"
    if bias.has_centre:
        centre = f"centre shear angle {result.formatted('centre_shear_angle_deg', '.2f')} deg"
    if q["theory_shear_angle_deg"] is None:
        theory = f"no theory: {q['no_theory_because']}"
    else:
        theory = f"theory {q['theory_shear_angle_deg']:.2f} deg"
    reaction = result.formatted("reaction_N")
    study.say(f"{result.folder}: reaction {reaction} N, {centre} ({theory})")


if __name__ == "__main__":
    run("bias_extension", options(), main)
