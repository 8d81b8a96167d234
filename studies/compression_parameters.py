"""Influence of the compression parameters on a formed double dome: Figs 12 to 14 of Schäfer et al.,
each varied alone."""

from fabric_fenicsx.cli.study import run
from fabric_fenicsx.core.errors import SolverFailure
from fabric_fenicsx.results.verdict import INVALID, Reason
from fabric_fenicsx.studies.lib import compression_parameters as parameters
from fabric_fenicsx.studies.lib.press_study import PressStudy, press_parser


def options():
    p = press_parser(__doc__, "compression_parameters", "double_dome")
    p.set_defaults(error=False)  # all plies have the same cells
    names = tuple(parameters.VARIED)
    p.group("test")
    p.option("--vary", nargs="+", choices=names, default=[*names])
    return p


def formed(study, press, values):
    """Summary of the ply formed with these parameters, its grid on rank 0, the contrast of its
    shear angle [deg], and why it was not formed ("" if it was)."""
    part = "_".join(f"{name}_{value:g}" for name, value in values.items())
    ply = study.build(press.with_fabrics(lambda fabric: parameters.changed(fabric, values)))
    try:
        result, reason = study.run(ply, part), ""
    except SolverFailure as failure:
        if not failure.result:
            raise
        result, reason = failure.result, failure.result.summary["reason"]
    grid = contrast = None
    if study.comm.rank == 0:
        grid = parameters.with_lost_ellipticity(result.grid)
        contrast = parameters.shear_contrast(grid)
    return result.summary, grid, study.comm.bcast(contrast), reason


def main(study):
    press = study.read("stage.1.steps=40")
    folder, runs, rows, grids = study.folder(), {}, [], {}
    for name, value, values in parameters.variants(study.args.vary):
        key = tuple(values.values())
        if key not in runs:
            runs[key] = formed(study, press, values)
        summary, grid, contrast, reason = runs[key]
        rows.append(parameters.row(name, value, summary, contrast, reason))
        grids.setdefault(name, {})[parameters.title(rows[-1])] = grid
        lost = f"{rows[-1]['cells_that_lost_ellipticity']} cells lost ellipticity"
        study.say(
            f"{name} = {value:g}: contrast of the shear angle {contrast:.3g} deg, "
            f"{lost}{': ' + reason if reason else ''}"
        )
    study.write_table(folder / "parameters.csv", rows)
    if study.comm.rank == 0 and not study.args.no_pictures:
        from fabric_fenicsx.results import pictures

        fields = "shear_angle", "log_eps_11", "ellipticity_lost"
        for name, plies in grids.items():
            pictures.maps(folder / f"{name}.png", plies, fields, outliers=0.01)
    study.comm.barrier()
    failed = [r for r in rows if r["reason"]]
    for row in failed:
        words = f"{row['parameter']} = {row['value']:g}: {row['reason']}"
        study.output.doubt(Reason(words, verdict=INVALID))
    study.summarise(
        folder,
        converged=not failed,
        stroke_reached=min(r["stroke_reached"] for r in rows),
        quantities={f"{r['parameter']} = {r['value']:g}": r for r in rows},
    )
    if failed:
        some = f"{len(failed)} of {len(rows)} plies"
        raise SolverFailure(f"{some} were not formed to the end; see {folder / 'parameters.csv'}")


if __name__ == "__main__":
    run("compression_parameters", options(), main, PressStudy)
