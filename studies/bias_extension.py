"""Bias extension of a woven strip with yarns at +-45 deg to the load and clamped ends: Fig. 9 of Schäfer et al."""

import math

import numpy as np

from fabric_fenicsx.cli import FRACTION, FROM_ZERO, POSITIVE
from fabric_fenicsx.errors import InputError
from fabric_fenicsx.material import curves
from fabric_fenicsx.material.curves import bias_normalised
from fabric_fenicsx.mechanics.bending import Bending, plate_stiffness
from fabric_fenicsx.meshes.specimen import can_be_graded
from fabric_fenicsx.pin_jointed import PinJointedStrip
from fabric_fenicsx.results import measures
from fabric_fenicsx.scene import grips, pulled
from fabric_fenicsx.study import add_weave_options, parser, run

ALONG = "crossed", "graded"  # patterns whose cells have edges at 45 deg
GRADED = 0.2  # nominal strain up to which the mesh is graded by default
RISE = 0.1, 0.9  # of the turn of a yarn, between which its transition zone is measured
OUTER = 2 / 3  # of the distance from a zone's edge, from where a turn counts as whole


def options():
    p = parser("bias_extension", __doc__, fibre_angle=45.0, pattern=None, integration=None, element=None)
    test = p.add_argument_group("test")
    test.add_argument("--length", type=POSITIVE, default=200.0, help="[mm]")
    test.add_argument("--width", type=POSITIVE, default=50.0, help="[mm]")
    test.add_argument("--strain", type=FRACTION, default=0.10, help="nominal, of the length: 0.1 is 10 %%")
    test.add_argument("--bending-modulus", type=FROM_ZERO, default=100.0, help="E_b of both yarns [MPa]")
    test.add_argument(
        "--in-plane-bending",
        type=FROM_ZERO,
        default=0.0,
        help="stiffness of yarns in the ply, of that out of it; cells are P1 then, otherwise P2",
    )
    test.add_argument(
        "--measured",
        metavar="DIR",
        help="test data with a normalised shear force F_sh, as studies/identify.py reads them, to compare with",
    )
    add_weave_options(p)
    return p


def shear_forces(strip, rest, rows):
    """Magnitude of theory's shear angle [rad] and normalised shear force [N/mm] of a test's rows, as an experiment
    derives them."""
    gamma = np.array([abs(strip.shear_angle(row["displacement_mm"], rest)) for row in rows])
    reach = np.isfinite(gamma)
    reaction = np.array([row["reaction_N"] for row in rows])[reach]
    return gamma[reach], bias_normalised(gamma[reach], reaction, strip.length, strip.width)


def compared(measured, gamma, force):
    """Measured shear angles [rad], forces and predicted forces [N/mm] there (within the simulated range)."""
    angles = measured.strains[:, 2]
    there = angles <= gamma.max() + 1e-9
    return angles[there], measured.responses[0].values[there], np.interp(angles[there], gamma, force)


def transition_width(comm, strip, x, y, gamma):
    """Width [mm] of the zones beside the clamps in which a yarn's turn rises from 10 to 90 %; None where there is none.

    Of cells at x, y with shear angles `gamma` (n,), all ranks'. Both yarns and ends are averaged. The profile across a line
    is that of means over groups of cells at about the same distance; 0 and 100 % are the means of its outer sixths.
    """
    widths = []
    for counts, into in strip.beside_clamps(x, y):
        parts = comm.allgather(np.stack([into[counts], gamma[counts]]))
        s, g = np.concatenate(parts, 1).round(12)
        outer = [k * s > OUTER * np.abs(s).max(initial=0) for k in (-1, 1)]
        if len(s) < 20 or not all(side.any() for side in outer):
            return None
        low, high = (g[side].mean() for side in outer)
        groups = np.array_split(np.lexsort((g, s)), math.ceil(math.sqrt(2 * len(s))))
        s, g = (np.array([values[group].mean() for group in groups]) for values in (s, (g - low) / (high - low)))
        places = []
        for level in RISE:
            k = int(np.argmax(g >= level))
            if k == 0:
                return None
            places.append(s[k - 1] + (s[k] - s[k - 1]) * (level - g[k - 1]) / (g[k] - g[k - 1]))
        widths.append(places[1] - places[0])
    return float(np.mean(widths)) if widths else None


def along_the_axis(study, blank, result, strip, rest):
    """Magnitude of the shear angle of the cells along the strip's axis to axis.csv and, beside theory, to axis.png."""
    low, high = blank.extent()
    length, width = high - low
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
    if strip:
        x = np.linspace(0, length, 2001)
        theory = strip.shear_angles(x, np.full_like(x, width / 2), result.rows[-1]["displacement_mm"], rest)
        if np.isfinite(theory).any():
            series["inextensible yarns"] = (x, np.degrees(np.abs(theory)), "-")
    pictures.curves(
        result.folder / "axis.png", series, "position along the axis / mm", "magnitude of the shear angle / deg"
    )


def no_theory(strip, full):
    """Why the kinematics of inextensible yarns say nothing of this strip; empty if they do."""
    if not full:
        return "the sheet is not the whole rectangle"
    return strip.locked


def main(study):
    args = study.args
    if args.element is None:
        args.element = "P1" if args.in_plane_bending else "P2"
    if args.in_plane_bending and args.element != "P1":
        raise InputError(
            f"--in-plane-bending {args.in_plane_bending:g} is given with --element {args.element}; allowed is P1, for which bending is"
        )
    measured = None
    if args.measured:
        measured = [curve for curve in curves.read(args.measured)[1] if curve.responses[0].column == "F_sh"]
        if not measured:
            raise InputError(
                f"--measured {args.measured} has no test with a column F_sh; allowed is one with gamma and F_sh"
            )
    if args.pattern is None:  # thin cells would fold in deep shear
        graded = args.strain <= GRADED and can_be_graded(args.length, args.width) and args.fibre_angle == 45
        args.pattern = "graded" if graded and args.yarn_angle == 90 else "crossed"
    blank = study.specimen(args.length, args.width)
    if args.integration is None:
        at_45 = args.pattern in ALONG and args.fibre_angle == 45 and args.yarn_angle == 90
        follow = args.mesh or args.pattern == "yarns" or at_45
        args.integration = "full" if follow or args.element != "P2" else "reduced"
    low, high = blank.extent()
    length, width = high - low
    if length < 2 * width * (1 - 1e-9):
        raise InputError(
            f"the strip is {length:.6g} mm long and {width:.6g} mm wide; allowed is a length of 2 widths or more, for a zone of full shear"
        )
    stroke = args.strain * length
    membrane = study.membrane(blank)
    area = measures.areas(blank)
    full = abs(study.comm.allreduce(area.sum()) / (length * width) - 1) < 1e-6
    a, rest = math.radians(args.fibre_angle), membrane.weave_angle
    strip = PinJointedStrip(length, width, a, a + math.radians(args.yarn_angle))
    reason = no_theory(strip, full)
    at_45 = not reason and args.yarn_angle == 90 and args.fibre_angle % 90 == 45 and rest is None
    if measured and not at_45:
        raise InputError(
            f"--measured {args.measured} has a normalised shear force, which is known of a whole rectangle with yarns at +-45 deg; allowed is --fibre-angle 45 with neither --yarn-angle nor --weave-angle nor a hole in --mesh"
        )
    has_centre = measures.covers(blank, ((low + high) / 2)[:2])
    if not has_centre:
        study.warn("the sheet has a hole at its centre, so there is no shear angle at the centre")
    bending = []
    if stiffness := args.in_plane_bending and plate_stiffness(args.bending_modulus, study.fabric.thickness):
        ends = [lambda x, at=at: abs(blank.along(x)[0] - at) < 1e-6 * length for at in (low[0], high[0])]
        bending.append(Bending(blank, stiffness, in_plane=args.in_plane_bending, clamped=ends))

    def quantities(fields, rows):
        x, y = blank.midpoints() - low[:, None]
        distance = np.hypot(x - length / 2, y - width / 2)
        centre = distance <= max(width / 8, study.extremes(distance)[0])
        signed, displacement = fields["shear_angle"], rows[-1]["displacement_mm"]
        gamma = np.abs(signed)
        theory = math.nan if reason else abs(float(strip.shear_angle(displacement, rest)))
        found = {}
        if not reason:
            (a_held, b_held), distance = strip.held(x, y)
            zones = {"free": ~a_held & ~b_held, "half": a_held != b_held, "clamped": a_held & b_held}
            if args.fibre_angle % 90 != 45 or args.yarn_angle != 90:  # then the two yarns turn by different angles
                del zones["half"]
                zones |= {"only_a_held": a_held & ~b_held, "only_b_held": b_held & ~a_held}
            for name, zone in zones.items():
                inside = zone & (distance > width / 10)
                if study.comm.allreduce(int(inside.sum())):
                    found[f"{name}_zone_shear_angle_deg"] = math.degrees(study.mean(gamma, inside))
            found["transition_width_mm"] = transition_width(study.comm, strip, x, y, signed)
        if at_45 and math.isfinite(theory) and theory > 0:
            found["normalised_shear_force_N_per_mm"] = float(shear_forces(strip, rest, rows[-1:])[1][0])
        if measured:
            _, mine, predicted = compared(measured[0], *shear_forces(strip, rest, rows))
            found["measured_rms_N_per_mm"] = float(np.sqrt(np.mean((predicted - mine) ** 2)))
            found["measured_rms_relative"] = float(np.sqrt(np.mean((predicted / mine - 1) ** 2)))
        found |= {
            "centre_shear_angle_deg": math.degrees(study.mean(gamma, centre)) if has_centre else None,
            "theory_shear_angle_deg": math.degrees(theory) if math.isfinite(theory) else None,
        }
        if not math.isfinite(theory):
            found["no_theory_because"] = reason or "the clamps are further apart than inextensible yarns let them"
        degrees, comm = np.degrees(signed), study.comm
        return found | {
            "shear_angle_98_percent_deg": measures.bulk(comm, degrees, area),
            "eps_a_98_percent": measures.bulk(comm, fields["eps_a"], area),
            "eps_b_98_percent": measures.bulk(comm, fields["eps_b"], area),
            "log_eps_11": study.extremes(fields["log_eps_11"]),
            "log_eps_22": study.extremes(fields["log_eps_22"]),
            "shear_angle_deg": study.extremes(degrees),
            "shear_angle_max_deg": math.degrees(study.extremes(gamma)[1]),
            "eps_a": study.extremes(fields["eps_a"]),
            "eps_b": study.extremes(fields["eps_b"]),
        }

    result = study.march(membrane, grips(blank, stroke), pulled(stroke), quantities, terms=bending)
    q = result.summary["quantities"]
    along_the_axis(study, blank, result, None if reason else strip, rest)
    if measured:
        gamma, force = shear_forces(strip, rest, result.rows)
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
    centre = f"centre shear angle {q['centre_shear_angle_deg']:.2f} deg" if has_centre else "no cell at the centre"
    theory = q["theory_shear_angle_deg"]
    beside = f"no theory: {q['no_theory_because']}" if theory is None else f"theory {theory:.2f} deg"
    study.say(f"{result.folder}: reaction {result.summary['reaction_N']:.6g} N, {centre} ({beside})")


if __name__ == "__main__":
    run("bias_extension", options(), main)
