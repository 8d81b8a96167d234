"""Bias extension of a woven strip with yarns at +-45 deg to the load and clamped ends: Fig. 9 of Schäfer et al."""

import math

import numpy as np

from fabric_fenicsx.cli import FRACTION, POSITIVE
from fabric_fenicsx.errors import InputError
from fabric_fenicsx.material import curves
from fabric_fenicsx.material.curves import bias_normalised
from fabric_fenicsx.meshes.specimen import can_be_graded
from fabric_fenicsx.scene import grips, pulled
from fabric_fenicsx.study import parser, run

ALONG = "crossed", "graded"  # patterns whose cells have edges at 45 deg
GRADED = 0.2  # nominal strain up to which the mesh is graded by default


def options():
    p = parser("bias_extension", __doc__, fibre_angle=45.0, pattern=None, integration=None)
    test = p.add_argument_group("test")
    test.add_argument("--length", type=POSITIVE, default=200.0, help="[mm]")
    test.add_argument("--width", type=POSITIVE, default=50.0, help="[mm]")
    test.add_argument("--strain", type=FRACTION, default=0.10, help="nominal, of the length: 0.1 is 10 %%")
    test.add_argument(
        "--measured",
        metavar="DIR",
        help="test data with a normalised shear force F_sh, as studies/identify.py reads them, to compare with",
    )
    return p


def shear_angle_of_theory(length, width, displacement):
    """Shear angle of the central zone with inextensible yarns at +-45 deg [rad]; NaN beyond their reach."""
    free = length - width
    cosine = (free + displacement) / (math.sqrt(2) * free)
    return math.pi / 2 - 2 * math.acos(cosine) if cosine <= 1 else math.nan


def yarns_held(x, y, length, width):
    """How many of the two yarns at +-45 deg through points (x, y) of the strip are held by a clamp, 0 to 2, and the
    points' distance to the lines where that changes [mm]."""
    x = np.minimum(x, length - x)
    ends = y - x, y + x  # where the yarns meet the line of the nearer clamp
    held = sum((end >= 0) & (end <= width) for end in ends)
    return held, np.min([np.abs(end - edge) for end in ends for edge in (0, width)], 0) / math.sqrt(2)


def shear_forces(length, width, rows):
    """Shear angle of theory [rad] and normalised shear force [N/mm] of a test's rows, as an experiment derives them."""
    gamma = np.array([shear_angle_of_theory(length, width, row["displacement_mm"]) for row in rows])
    reach = np.isfinite(gamma) & (gamma >= 0)
    return gamma[reach], bias_normalised(
        gamma[reach], np.array([row["reaction_N"] for row in rows])[reach], length, width
    )


def compared(measured, gamma, force):
    """Measured shear angles [rad], forces and predicted forces [N/mm] there (within the simulated range)."""
    angles = measured.strains[:, 2]
    there = angles <= gamma.max() + 1e-9
    return angles[there], measured.responses[0].values[there], np.interp(angles[there], gamma, force)


def along_the_axis(study, blank, result, low, length, width):
    """Shear angle of the cells along the strip's axis to axis.csv and, beside theory, to axis.png."""
    x, y = blank.midpoints() - low[:, None]
    near = np.abs(y - width / 2) <= width / 20
    gamma = np.degrees(np.abs(result.fields["shear_angle"]))
    parts = study.comm.gather(np.column_stack([x, y, gamma])[near])
    if study.comm.rank != 0:
        return
    profile = np.concatenate(parts)
    profile = profile[np.lexsort(np.round(profile[:, 1::-1].T, 6))][:, ::2]
    np.savetxt(
        result.folder / "axis.csv",
        profile,
        fmt="%.9g",
        delimiter=",",
        header="position_mm,shear_angle_deg",
        comments="",
    )
    if study.args.no_pictures:
        return
    from fabric_fenicsx.results import pictures

    series = {"simulated": (*profile.T, ".")}
    theory = math.degrees(shear_angle_of_theory(length, width, result.rows[-1]["displacement_mm"]))
    if math.isfinite(theory):
        free = [0, width / 2, width / 2, length - width / 2, length - width / 2, length]
        series["inextensible yarns"] = (free, [0, 0, theory, theory, 0, 0], "-")
    pictures.curves(result.folder / "axis.png", series, "position along the axis / mm", "shear angle / deg")


def main(study):
    args = study.args
    measured = None
    if args.measured:
        measured = [curve for curve in curves.read(args.measured)[1] if curve.responses[0].column == "F_sh"]
        if not measured:
            raise InputError(
                f"--measured {args.measured} has no test with a column F_sh; allowed is one with gamma and F_sh"
            )
    if args.pattern is None:  # thin cells would fold in deep shear
        graded = args.strain <= GRADED and can_be_graded(args.length, args.width) and args.fibre_angle == 45
        args.pattern = "graded" if graded else "crossed"
    blank = study.specimen(args.length, args.width)
    if args.integration is None:
        follow = args.mesh or args.pattern == "yarns" or (args.pattern in ALONG and args.fibre_angle == 45)
        args.integration = "full" if follow or args.element != "P2" else "reduced"
    low, high = blank.extent()
    length, width = high - low
    if length < 2 * width * (1 - 1e-9):
        raise InputError(
            f"the strip is {length:.6g} mm long and {width:.6g} mm wide; allowed is a length of 2 widths or more, for a zone of full shear"
        )
    stroke = args.strain * length
    membrane = study.membrane(blank)

    def quantities(fields, rows):
        distance = np.linalg.norm(blank.midpoints() - ((low + high) / 2)[:, None], axis=0)
        centre = distance <= max(width / 8, study.extremes(distance)[0])
        gamma = np.abs(fields["shear_angle"])
        theory = shear_angle_of_theory(length, width, rows[-1]["displacement_mm"])
        found = {}
        if args.fibre_angle == 45:
            x, y = blank.midpoints() - low[:, None]
            held, distance = yarns_held(x, y, length, width)
            for name, count in (("free", 0), ("half", 1), ("clamped", 2)):
                inside = (held == count) & (distance > width / 10)
                if study.comm.allreduce(int(inside.sum())):
                    found[f"{name}_zone_shear_angle_deg"] = math.degrees(study.mean(gamma, inside))
        if math.isfinite(theory) and theory > 0:
            found["normalised_shear_force_N_per_mm"] = float(shear_forces(length, width, rows[-1:])[1][0])
        if measured:
            _, mine, predicted = compared(measured[0], *shear_forces(length, width, rows))
            found["measured_rms_N_per_mm"] = float(np.sqrt(np.mean((predicted - mine) ** 2)))
            found["measured_rms_relative"] = float(np.sqrt(np.mean((predicted / mine - 1) ** 2)))
        return found | {
            "centre_shear_angle_deg": math.degrees(study.mean(gamma, centre)),
            "theory_shear_angle_deg": math.degrees(theory) if math.isfinite(theory) else None,
            "shear_angle_max_deg": math.degrees(study.extremes(gamma)[1]),
            "eps_a": study.extremes(fields["eps_a"]),
            "eps_b": study.extremes(fields["eps_b"]),
        }

    result = study.march(membrane, grips(blank, stroke), pulled(stroke), quantities)
    q = result.summary["quantities"]
    along_the_axis(study, blank, result, low, length, width)
    if measured:
        gamma, force = shear_forces(length, width, result.rows)
        angles, mine, _ = compared(measured[0], gamma, force)
        if study.comm.rank == 0 and not args.no_pictures:
            from fabric_fenicsx.results import pictures

            series = {"measured": (np.degrees(angles), mine, "s"), "simulated": (np.degrees(gamma), force, "-")}
            pictures.curves(
                result.folder / "measured.png",
                series,
                "shear angle from the crosshead / deg",
                "normalised shear force / (N/mm)",
            )
        study.say(
            f"measured and simulated shear force differ by {q['measured_rms_N_per_mm']:.3g} N/mm ({100 * q['measured_rms_relative']:.3g} %) r.m.s."
        )
    study.say(
        f"{result.folder}: reaction {result.summary['reaction_N']:.6g} N, centre shear angle "
        f"{q['centre_shear_angle_deg']:.2f} deg (theory {q['theory_shear_angle_deg'] or math.nan:.2f} deg)"
    )


if __name__ == "__main__":
    run("bias_extension", options(), main)
