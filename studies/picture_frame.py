"""Picture-frame test: a square sheared by a hinged rigid frame, with or without pre-tension along
the yarns."""

from fabric_fenicsx.cli.study import Study, parser, run
from fabric_fenicsx.coupons.picture_frame import PictureFrame


def options():
    return parser(PictureFrame, __doc__)


def main(study: Study):
    result = study.run(study.build(study.describe(PictureFrame)))
    q = result.summary["quantities"]
    study.say(
        f"{result.folder}: {result.formatted('normalised_shear_force_N_per_mm')} N/mm at "
        f"{q['shear_angle_deg']:.4g} deg (closed form {q['closed_form_N_per_mm']:.6g} N/mm)"
    )


if __name__ == "__main__":
    run("picture_frame", options(), main)
