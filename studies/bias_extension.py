"""Bias extension of a woven strip with yarns at +-45 deg to the load and clamped ends: Fig. 9 of Schäfer et al."""

import math

import numpy as np

from fabric_fenicsx.errors import InputError
from fabric_fenicsx.mechanics.membrane import Membrane
from fabric_fenicsx.scene import grips
from fabric_fenicsx.study import POSITIVE, parser, run


def options():
    p = parser("bias_extension", __doc__, fibre_angle=45.0)
    test = p.add_argument_group("test")
    test.add_argument("--length", type=POSITIVE, default=200.0, help="[mm]")
    test.add_argument("--width", type=POSITIVE, default=50.0, help="[mm]")
    test.add_argument("--strain", type=POSITIVE, default=0.10, help="nominal, of the length")
    return p


def shear_angle_of_theory(length, width, displacement):
    """Shear angle of the central zone with inextensible yarns at +-45 deg [rad]; NaN beyond their reach."""
    free = length - width
    cosine = (free + displacement) / (math.sqrt(2) * free)
    return math.pi / 2 - 2 * math.acos(cosine) if cosine <= 1 else math.nan


def main(study):
    args = study.args
    blank = study.specimen(args.length, args.width)
    low, high = blank.extent()
    length, width = high - low
    if length < 2 * width:
        raise InputError(f"the strip is {length:.6g} mm long and {width:.6g} mm wide; allowed is a length of 2 widths or more, for a zone of full shear")
    stroke = args.strain * length
    membrane = Membrane(blank, study.fabric)

    def quantities(fields, rows):
        distance = np.linalg.norm(blank.midpoints() - ((low + high) / 2)[:, None], axis=0)
        centre = distance <= max(width / 8, study.extremes(distance)[0])
        gamma = np.abs(fields["shear_angle"])
        theory = shear_angle_of_theory(length, width, rows[-1]["displacement_mm"])
        return {
            "centre_shear_angle_deg": math.degrees(study.mean(gamma, centre)),
            "theory_shear_angle_deg": math.degrees(theory) if math.isfinite(theory) else None,
            "shear_angle_max_deg": math.degrees(study.extremes(gamma)[1]),
            "eps_a": study.extremes(fields["eps_a"]),
            "eps_b": study.extremes(fields["eps_b"]),
        }

    result = study.march(membrane, grips(blank, stroke), "moving grip", stroke, quantities)
    q = result.summary["quantities"]
    study.say(
        f"{result.folder}: reaction {result.summary['reaction_N']:.6g} N, centre shear angle "
        f"{q['centre_shear_angle_deg']:.2f} deg (theory {q['theory_shear_angle_deg'] or math.nan:.2f} deg)"
    )


if __name__ == "__main__":
    run("bias_extension", options(), main)
