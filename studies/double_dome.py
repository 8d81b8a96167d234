"""Forming of a woven ply over a generic double dome: Figs 11 to 16 of Schäfer et al., for a single
ply between rigid tools."""

from fabric_fenicsx.command_line.forming_study import DomeTest, build, dome_parser, of_quarter
from fabric_fenicsx.command_line.study import Study, run
from fabric_fenicsx.material.laws import coupling_variants
from fabric_fenicsx.runtime.formatting import percent


def options():
    p = dome_parser(DomeTest, __doc__)
    p.group("test")
    p.option("--compare", action="store_true", help="run all variants of the couplings", free=True)
    return p


def main(study: Study):
    args = study.args
    fabrics = coupling_variants(study.fabric) if args.compare else {"": study.fabric}
    results = {}
    for label, fabric in fabrics.items():
        forming = build(study, DomeTest, fabric)
        results[label] = study.run(forming, label.replace(" ", "_"))
    found = {label: result.summary["quantities"] for label, result in results.items()}
    if args.compare:
        folder = study.folder()
        if study.comm.rank == 0 and not args.no_pictures:
            from fabric_fenicsx.forming.pictures import compare
            from fabric_fenicsx.plot import pictures

            compare(forming, results, folder)
            labels = "stroke / mm", f"{forming.force_name()} / N"
            pictures.reactions(folder / "compare_curves.png", results, *labels)
        study.summarise(folder, converged=True, stroke_reached=1.0, quantities=found)
    for label, r in results.items():
        q = found[label]
        study.say(
            f"{label or args.out}: punch force {r.formatted('punch_force_N', '.5g')} N"
            f"{of_quarter(forming, q)}, largest shear angle "
            f"{r.formatted('shear_angle_max_deg', '.2f')} deg (99 % of the area below "
            f"{r.formatted('shear_angle_99_percent_deg', '.2f')}), draw-in "
            f"{r.formatted('draw_in.largest_mm', '.2f')} mm, "
            f"penetration {percent(q['penetration_of_thickness'])} of the thickness"
        )


if __name__ == "__main__":
    run("double_dome", options(), main)
