"""Picture-frame test: a square sheared by a hinged rigid frame, with or without pre-tension along the yarns."""

import math

import numpy as np

from fabric_fenicsx.cli import POSITIVE, number
from fabric_fenicsx.errors import InputError
from fabric_fenicsx.material.closed_form import nominal_stresses
from fabric_fenicsx.material.paths import conjugate, gradient
from fabric_fenicsx.scene import framed
from fabric_fenicsx.study import add_weave_options, parser, run


def options():
    p = parser(
        "picture_frame", __doc__, {"nx": 20, "steps": 40}, {"nx": 20, "steps": 10}, element="P1"
    )  # the state is homogeneous
    test = p.add_argument_group("test")
    test.add_argument("--side", type=POSITIVE, default=200.0, help="of the square [mm]")
    test.add_argument(
        "--angle",
        type=number("an angle above 0 and below 85 deg", lambda v: 0 < v < 85),
        default=45.0,
        metavar="DEG",
        help="shear angle at the end",
    )
    test.add_argument(
        "--pre-tension",
        type=number("a strain from 0 to 0.1", lambda v: 0 <= v <= 0.1),
        default=0.0,
        metavar="STRAIN",
        help="yarn strain applied first, in the first tenth of the load",
    )
    add_weave_options(p)
    return p


def main(study):
    args = study.args
    if args.fibre_angle % 90 or args.yarn_angle != 90:
        raise InputError(
            f"yarns are at {args.fibre_angle:g} deg to the frame and {args.yarn_angle:g} deg to each other; allowed is 0 and 90, along its arms"
        )
    blank = study.specimen(args.side, args.side)
    low, high = blank.extent()
    side = (high - low)[0]
    stretched = 0.1 if args.pre_tension else 0.0
    sheared = math.radians((args.weave_angle or 90) - 90)  # of the weave as it is mounted

    def state(load):
        """Yarn strain and shear angle that the frame prescribes."""
        shear = max(load - stretched, 0) / (1 - stretched)
        strain = args.pre_tension * min(load / stretched, 1) if stretched else 0.0
        return strain, math.radians(args.angle) * shear

    def deformation(load):
        strain, gamma = state(load)
        return gradient(*np.atleast_1d(strain, strain, gamma))[0]

    thickness = study.fabric.thickness

    def measure(scene, load):
        """Lengthening of the frame's diagonal and the force along it, from the power of the frame's forces."""
        strain, gamma = state(load)
        P = scene.virial() / (side**2 * thickness)
        tau = conjugate(P[None], deformation(load)[None])[0, 2]
        arm = side * (1 + strain) * math.sin(math.pi / 4 - gamma / 2)  # d(diagonal)/d(gamma)
        diagonal = 2 * side * ((1 + strain) * math.cos(math.pi / 4 - gamma / 2) - math.cos(math.pi / 4))
        return diagonal, tau * thickness * side**2 / arm

    def shear_force(row):
        """Shear angle and normalised shear force F_s L_frame / L_fabric^2 [N/mm] of a row (Cao et al. 2008)."""
        gamma = state(row["load"])[1]
        return math.degrees(gamma), row["reaction_N"] / (2 * math.cos(math.pi / 4 - gamma / 2)) / side

    def quantities(fields, rows):
        strain, gamma = state(rows[-1]["load"])
        tau = nominal_stresses(study.fabric, strain, strain, sheared + gamma)[2][0]
        angle, force = shear_force(rows[-1])
        return {
            "shear_angle_deg": angle,
            "normalised_shear_force_N_per_mm": force,
            "closed_form_N_per_mm": tau * thickness / ((1 + strain) * math.cos(gamma)),
            "shear_angle": study.extremes(fields["shear_angle"]),
            "eps_a": study.extremes(fields["eps_a"]),
            "eps_b": study.extremes(fields["eps_b"]),
        }

    result = study.march(
        study.membrane(blank),
        framed(blank, deformation),
        measure,
        quantities,
        milestones=[stretched / 2, stretched] if stretched else [],
    )
    q = result.summary["quantities"]
    if study.comm.rank == 0 and not args.no_pictures:
        from fabric_fenicsx.results import pictures

        angles, forces = np.array(
            [shear_force(row) for row in result.rows if state(row["load"])[1] > 0 or not stretched]
        ).T
        gammas = np.linspace(0, math.radians(args.angle), 200)
        exact = (
            nominal_stresses(study.fabric, args.pre_tension, args.pre_tension, sheared + gammas)[2]
            * thickness
            / ((1 + args.pre_tension) * np.cos(gammas))
        )
        series = {"elements": (angles, forces, "o"), "closed form": (np.degrees(gammas), exact, "-")}
        pictures.curves(
            result.folder / "shear_force.png", series, "shear angle / deg", "normalised shear force / (N/mm)"
        )
    study.say(
        f"{result.folder}: {q['normalised_shear_force_N_per_mm']:.6g} N/mm at {q['shear_angle_deg']:.4g} deg (closed form {q['closed_form_N_per_mm']:.6g} N/mm)"
    )


if __name__ == "__main__":
    run("picture_frame", options(), main)
