"""What the compression parameters do to a formed double dome: Figs 12 to 14 of Schäfer et al., each varied alone."""

from fabric_fenicsx.errors import SolverFailure
from fabric_fenicsx.forming import Forming, forming_parser
from fabric_fenicsx.study import run

BASE = {"p_min": 0.75, "E_C": 1.3, "s_C": 100.0}  # E_C [MPa] = 2 d, the modulus of a yarn in compression
VARIED = {
    "p_min": (0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 1.0),
    "E_C": (0.13, 1.3, 13.0, 130.0, 1300.0),
    "s_C": (10.0, 100.0, 1000.0),
}
FIGURES = {"p_min": 12, "E_C": 13, "s_C": 14}


def options():
    p = forming_parser("compression_parameters", __doc__, {"nx": 24, "steps": 40}, {"nx": 10, "steps": 10})
    p.add_argument_group("test").add_argument("--vary", nargs="+", choices=tuple(VARIED), default=list(VARIED))
    return p


def formed(study, values):
    """Quantities of the ply formed with these parameters, its grid on rank 0, and why it was not formed ("" if it was)."""
    from fabric_fenicsx.results.fields import read_last

    fabric = study.fabric.replace(p_min=values["p_min"], d=values["E_C"] / 2, s_C=values["s_C"])
    part = "_".join(f"{name}_{value:g}" for name, value in values.items())
    forming = Forming(study, fabric, part)
    try:
        summary, reason = forming.run().summary, ""
    except SolverFailure as failure:
        summary, reason = forming.summary(), str(failure)
    grid = read_last(forming.folder) if study.comm.rank == 0 else None
    if grid:
        grid.cell_data["ellipticity_lost"] = (grid.cell_data["stability_ellipticity"] < 0) * 1.0
    return summary, grid, reason


def main(study):
    folder, runs, rows = study.folder(), {}, []
    for name in study.args.vary:
        for value in VARIED[name]:
            values = BASE | {name: value}
            key = tuple(values.values())
            if key not in runs:
                runs[key] = formed(study, values)
            summary, grid, reason = runs[key]
            rows.append(row(name, value, summary, grid, reason, study.comm))
            study.say(
                f"{name} = {value:g}: contrast of the shear angle {rows[-1]['contrast_deg']:.3g} deg, "
                f"{rows[-1]['cells_that_lost_ellipticity']} cells lost ellipticity{': ' + reason if reason else ''}"
            )
    study.write_table(folder / "parameters.csv", rows)
    if study.comm.rank == 0 and not study.args.no_pictures:
        from fabric_fenicsx.results import pictures

        for name in study.args.vary:
            variants = {f"{name} = {v:g}": runs[tuple((BASE | {name: v}).values())][1] for v in VARIED[name]}
            fields = "shear_angle", "log_eps_11", "ellipticity_lost"
            pictures.maps(folder / f"{name}.png", variants, fields, outliers=0.01)
    study.comm.barrier()
    failed = [r for r in rows if r["reason"]]
    study.summarise(
        folder, converged=not failed, stroke_reached=min(r["stroke_reached"] for r in rows),
        quantities={f"{r['parameter']} = {r['value']:g}": r for r in rows},
    )  # fmt: skip
    if failed:
        raise SolverFailure(
            f"{len(failed)} of {len(rows)} plies were not formed to the end; see {folder / 'parameters.csv'}"
        )


def row(name, value, summary, grid, reason, comm):
    """A line of the table; contrast [deg] as in `results.forming.contrast`."""
    q, contrast = summary["quantities"], None
    if comm.rank == 0:
        from numpy import degrees

        from fabric_fenicsx.results import forming

        contrast = float(degrees(forming.contrast(grid, "shear_angle")))
    return {
        "figure": FIGURES[name], "parameter": name, "value": value, "stroke_reached": summary["stroke_reached"],
        "shear_angle_max_deg": q["shear_angle_max_deg"], "contrast_deg": comm.bcast(contrast),
        "cells_that_lost_ellipticity": q["cells_that_lost_ellipticity"], "ellipticity_min": q["stability_ellipticity_min"],
        "log_eps_11_min": q["log_eps_11"][0], "log_eps_22_min": q["log_eps_22"][0], "draw_in_largest_mm": q["draw_in"]["largest_mm"],
        "punch_force_N": q["punch_force_N"], "reason": reason,
    }  # fmt: skip


if __name__ == "__main__":
    run("compression_parameters", options(), main)
