"""Uniaxial tension of a woven strip along its yarns, with clamped ends: Figs 8 and 10 of Schäfer et al."""

import math

import numpy as np

from fabric_fenicsx.cli import ANY, FRACTION, POSITIVE
from fabric_fenicsx.material.parameters import coupling_variants
from fabric_fenicsx.scene import grips, pulled
from fabric_fenicsx.study import parser, run


def options():
    p = parser("tensile", __doc__)
    test = p.add_argument_group("test")
    test.add_argument("--length", type=POSITIVE, default=200.0, help="[mm]")
    test.add_argument("--width", type=POSITIVE, default=50.0, help="[mm]")
    test.add_argument("--strain", type=FRACTION, default=0.03, help="nominal, of the length: 0.1 is 10 %%")
    test.add_argument("--grips", choices=("clamped", "rollers"), default="clamped", help="rollers: a homogeneous state")
    test.add_argument("--turned", type=ANY, default=0.0, metavar="DEG", help="angle of the whole test in the plane")
    test.add_argument("--compare", action="store_true", help="run all variants of the couplings, side by side")
    return p


def pull(study, fabric, part=""):
    args = study.args
    blank = study.specimen(args.length, args.width, math.radians(args.turned))
    membrane = study.membrane(blank, fabric)
    low, high = blank.extent()
    stroke = args.strain * (high - low)[0]

    def quantities(fields, rows):
        x, u = blank.along(blank.coordinates().T), blank.u.x.array.reshape(-1, len(low)).T
        distance = np.abs(x[0] - (low + high)[0] / 2)
        nearest = study.extremes(distance)[0]
        edges = study.extremes((x + u)[1][distance <= nearest + 0.02 * (high - low)[0]])
        return {
            "nominal_stress_MPa": rows[-1]["reaction_N"] / ((high - low)[1] * fabric.thickness),
            "log_eps_11_max": study.extremes(fields["log_eps_11"])[1],
            "log_eps_22_min": study.extremes(fields["log_eps_22"])[0],
            "eps_a": study.extremes(fields["eps_a"]),
            "eps_b": study.extremes(fields["eps_b"]),
            "shear_angle_max_deg": math.degrees(max(map(abs, study.extremes(fields["shear_angle"])))),
            "width_at_middle_mm": edges[1] - edges[0],
        }

    return study.march(membrane, grips(blank, stroke, args.grips == "clamped"), pulled(stroke), quantities, part)


def main(study):
    if not study.args.compare:
        result = pull(study, study.fabric)
        study.say(
            f"{result.folder}: reaction {result.summary['reaction_N']:.6g} N, most negative log eps22 {100 * result.summary['quantities']['log_eps_22_min']:.3g} %"
        )
        return
    folder = study.folder()
    results = {
        name: pull(study, fabric, name.replace(" ", "_")) for name, fabric in coupling_variants(study.fabric).items()
    }
    variants = {name: r.summary for name, r in results.items()}
    study.summarise(
        folder,
        converged=True,
        stroke_reached=1.0,
        quantities={name: s["quantities"] | {"reaction_N": s["reaction_N"]} for name, s in variants.items()},
        variants=sorted(variants),
    )
    if study.comm.rank == 0 and not study.args.no_pictures:
        from fabric_fenicsx.results import pictures
        from fabric_fenicsx.results.fields import read_last

        out = study.args.out
        pictures.maps(
            out / "compare.png",
            {name: read_last(r.folder) for name, r in results.items()},
            ("log_eps_11", "log_eps_22", "shear_angle"),
        )
        curves = {
            name: ([row["displacement_mm"] for row in r.rows], [row["reaction_N"] for row in r.rows])
            for name, r in results.items()
        }
        pictures.curves(out / "compare_curves.png", curves, "displacement / mm", "reaction / N")
    for name, r in results.items():
        study.say(
            f"{name:24s} reaction {r.summary['reaction_N']:9.4f} N, most negative log eps22 {100 * r.summary['quantities']['log_eps_22_min']:9.4f} %"
        )


if __name__ == "__main__":
    run("tensile", options(), main)
