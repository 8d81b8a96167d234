"""Uniaxial tension of a woven strip along its yarns, with clamped ends: Figs 8 and 10 of Schäfer et al."""

import math

import numpy as np

from fabric_fenicsx.cli import ANY, FRACTION, POSITIVE
from fabric_fenicsx.material.parameters import coupling_variants
from fabric_fenicsx.results import measures
from fabric_fenicsx.scene import grips, pulled
from fabric_fenicsx.study import add_weave_options, parser, run


def options():
    p = parser("tensile", __doc__)
    test = p.add_argument_group("test")
    test.add_argument("--length", type=POSITIVE, default=200.0, help="[mm]")
    test.add_argument("--width", type=POSITIVE, default=50.0, help="[mm]")
    test.add_argument("--strain", type=FRACTION, default=0.03, help="nominal, of the length: 0.1 is 10 %%")
    test.add_argument("--grips", choices=("clamped", "rollers"), default="clamped", help="rollers: a homogeneous state")
    test.add_argument("--turned", type=ANY, default=0.0, metavar="DEG", help="angle of the whole test in the plane")
    test.add_argument("--compare", action="store_true", help="run all variants of the couplings, side by side")
    add_weave_options(p)
    return p


def pull(study, fabric, part=""):
    args = study.args
    blank = study.specimen(args.length, args.width, math.radians(args.turned))
    membrane = study.membrane(blank, fabric)
    low, high = blank.extent()
    stroke = args.strain * (high - low)[0]
    area, middle, width = measures.areas(blank), ((low + high) / 2)[:2], (high - low)[1]
    has_middle = measures.covers(blank, middle)
    if not has_middle:
        study.warn("the sheet has a hole at its centre, so there are no strains at the middle")

    def quantities(fields, rows):
        distance = np.linalg.norm(blank.midpoints()[:2] - middle[:, None], axis=0)
        near = distance <= max(width / 8, study.extremes(distance)[0])
        degrees = np.degrees(fields["shear_angle"])
        strains = {name: fields[name] for name in ("log_eps_11", "log_eps_22")}
        x, u = blank.along(blank.coordinates().T), blank.u.x.array.reshape(-1, len(low)).T
        distance = np.abs(x[0] - (low + high)[0] / 2)
        nearest = study.extremes(distance)[0]
        edges = study.extremes((x + u)[1][distance <= nearest + 0.02 * (high - low)[0]])
        return {
            "log_eps_22_middle": measures.mean(study.comm, fields["log_eps_22"], near * area) if has_middle else None,
            **{name: study.extremes(e) for name, e in strains.items()},
            **{f"{name}_98_percent": measures.bulk(study.comm, e, area) for name, e in strains.items()},
            "shear_angle_98_percent_deg": measures.bulk(study.comm, degrees, area),
            "nominal_stress_MPa": rows[-1]["reaction_N"] / ((high - low)[1] * fabric.thickness),
            "log_eps_11_max": study.extremes(fields["log_eps_11"])[1],
            "log_eps_22_min": study.extremes(fields["log_eps_22"])[0],
            "eps_a": study.extremes(fields["eps_a"]),
            "eps_b": study.extremes(fields["eps_b"]),
            "shear_angle_deg": study.extremes(degrees),
            "shear_angle_max_deg": math.degrees(max(map(abs, study.extremes(fields["shear_angle"])))),
            "width_at_middle_mm": edges[1] - edges[0],
        }

    return study.march(membrane, grips(blank, stroke, args.grips == "clamped"), pulled(stroke), quantities, part)


def strains_across(quantities):
    """Words for log eps22 at the middle, which finer meshes keep, and of the cell that has least, which they need not."""
    middle, least = quantities["log_eps_22_middle"], quantities["log_eps_22_min"]
    at = "no cell at the middle" if middle is None else f"log eps22 at the middle {round(100 * middle, 2) + 0.0:.2f} %"
    return f"{at} (least of a cell {round(100 * least, 2) + 0.0:.2f} %, which a finer mesh may lower)"


def main(study):
    if not study.args.compare:
        result = pull(study, study.fabric)
        summary = result.summary
        study.say(f"{result.folder}: reaction {summary['reaction_N']:.6g} N, {strains_across(summary['quantities'])}")
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
        across = strains_across(r.summary["quantities"])
        study.say(f"{name:24s} reaction {r.summary['reaction_N']:9.4f} N, {across}")


if __name__ == "__main__":
    run("tensile", options(), main)
