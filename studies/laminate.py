"""Forming of a fibre-metal laminate over a generic double dome: Figs 11 to 16 of Schäfer et al.,
metal, three plies at 0/90, metal."""

from fabric_fenicsx.command_line.forming_study import LaminateTest, build, dome_parser, of_quarter
from fabric_fenicsx.command_line.study import Study, run
from fabric_fenicsx.material.laws import coupling_variants
from fabric_fenicsx.runtime.errors import InputError, SolverFailure
from fabric_fenicsx.runtime.formatting import percent, rounded
from fabric_fenicsx.studies.lib import compression_parameters as parameters

MIDDLE = "middle"  # ply


def options():
    p = dome_parser(LaminateTest, __doc__)
    p.group("test")
    p.option("--compare", action="store_true", help="run all variants of the couplings", free=True)
    p.option(
        "--vary", choices=tuple(parameters.VARIED), help="run all values of a parameter", free=True
    )
    return p


def variants(study: Study):
    """{label: fabric} to be run."""
    args = study.args
    if args.compare and args.vary:
        raise InputError("--compare and --vary are both given; allowed is one of them")
    if args.compare:
        return coupling_variants(study.fabric)
    if args.vary:
        known = parameters.variants([args.vary])
        return {f"{n} = {v:g}": parameters.changed(study.fabric, all_) for n, v, all_ in known}
    return {"": study.fabric}


def main(study: Study):
    results, rows, failed = {}, [], []
    for label, fabric in variants(study).items():
        laminate = build(study, LaminateTest, fabric)
        try:
            result = study.run(laminate, label.replace(" = ", "_").replace(" ", "_"))
        except SolverFailure as failure:
            if not (label and failure.result):
                raise
            result = failure.result
            failed.append(f"{label}: {failure}")
        results[label], q = result, result.summary["quantities"]
        middle = q["plies"].get(MIDDLE, {})
        row = {"variant": label, "stroke_reached": result.summary["stroke_reached"]}
        row |= {k: v for k, v in q.items() if isinstance(v, float)}
        rows.append(row | {f"middle_{k}": v for k, v in middle.items() if isinstance(v, float)})
        shear = result.formatted(f"plies.{MIDDLE}.shear_angle_max_deg", ".2f")
        study.say(
            f"{label or study.args.out}: punch force {rounded(q['punch_force_N'], 5)} N"
            f"{of_quarter(laminate, q)}, largest shear angle of the middle ply {shear} deg, "
            f"thinning of the metal {result.formatted('thinning_max', '.2f', 100)} %, "
            f"penetration {percent(q['penetration_of_thickness'])} of a thickness"
        )
    if len(results) > 1:
        folder = study.folder()
        study.write_table(folder / "variants.csv", rows)
        if study.comm.rank == 0 and not study.args.no_pictures:
            from fabric_fenicsx.forming.pictures import compare

            compare(laminate, results, folder)
        reached = min(row["stroke_reached"] for row in rows)
        found = {row["variant"]: row for row in rows}
        study.summarise(folder, converged=not failed, stroke_reached=reached, quantities=found)
    if failed:
        raise SolverFailure("; ".join(failed))


if __name__ == "__main__":
    run("laminate", options(), main)
