"""Forming of a woven ply over a generic double dome: Figs 11 to 16 of Schäfer et al., for a single ply between rigid tools."""

from fabric_fenicsx.forming import Forming, forming_parser, pictures
from fabric_fenicsx.material.parameters import coupling_variants
from fabric_fenicsx.study import run

# factor -> its values, the last one the reference of the others; all else as the options say
SWEEPS = {
    "nx": (12, 24, 47, 94),
    "steps": (10, 20, 40, 160),
    "lag": (1.0, 0.1, 0.01, 0.001),
    "path_tolerance": (1e-1, 1e-2, 1e-3, 1e-6),
    "penalty": (200.0, 800.0, 3200.0, 12800.0),
    "slip": (0.8, 0.4, 0.1, 0.01),
}
QUICK_SWEEPS = {"nx": (6, 10), "steps": (5, 10)}


def options():
    p = forming_parser("double_dome", __doc__, {"nx": 47, "steps": 40}, {"nx": 12, "steps": 12})
    test = p.add_argument_group("test").add_mutually_exclusive_group()
    test.add_argument("--compare", action="store_true", help="run all variants of the couplings")
    test.add_argument("--sweep", action="store_true", help="run meshes, steps, tolerances, penalties and slips against finer ones")  # fmt: skip
    return p


def sweep(study):
    """Each factor of `SWEEPS` against its finest value: cost and errors, as a table."""
    args, folder, rows = study.args, study.folder(), []
    for factor, values in (QUICK_SWEEPS if args.quick else SWEEPS).items():
        usual, found = getattr(args, factor), []
        for value in values:
            setattr(args, factor, value)
            found.append(study.once(f"{factor} {value:g}", lambda: swept(study, factor, value)))
        setattr(args, factor, usual)
        for row in found:
            for name in ("punch_force_N", "shear_angle_max_deg", "draw_in_mm", "strain_energy_Nmm"):
                row[f"error_{name}"] = row[name] / found[-1][name] - 1
            study.say(
                f"{factor} {row['value']:g}: {row['wall_s']:.3g} s, {row['iterations']} iterations; off {values[-1]:g}'s: "
                f"punch force {row['error_punch_force_N']:.2%}, shear angle {row['shear_angle_max_deg'] - found[-1]['shear_angle_max_deg']:.2f} deg, "
                f"draw-in {row['draw_in_mm'] - found[-1]['draw_in_mm']:.3f} mm, strain energy {row['error_strain_energy_Nmm']:.2%}"
            )
        rows += found
    study.write_table(folder / "sweep.csv", rows)
    study.summarise(folder, converged=True, stroke_reached=1.0, quantities={"rows": rows})


def swept(study, factor, value):
    """The row of one run."""
    s = Forming(study, study.fabric, f"{factor}_{value:g}").run().summary
    q = s["quantities"]
    return {
        "factor": factor, "value": value, "cells": s["cells"], "steps": s["steps_accepted"], "rejected": s["steps_rejected"],
        "iterations": s["newton_iterations"], "wall_s": s["wall_s"]["total"], "memory_mib": s["peak_memory_mib"],
        "punch_force_N": q["punch_force_N"], "shear_angle_max_deg": q["shear_angle_max_deg"],
        "draw_in_mm": q["draw_in"]["largest_mm"], "strain_energy_Nmm": s["energy"]["strain"],
        "penetration_of_thickness": q["penetration_of_thickness"], "energy_imbalance": s["energy_imbalance"],
        "viscous_of_strain_energy": q["viscous_of_strain_energy"],
    }  # fmt: skip


def main(study):
    if study.args.sweep:
        sweep(study)
        return
    fabrics = coupling_variants(study.fabric) if study.args.compare else {"": study.fabric}
    runs = {}
    for label, fabric in fabrics.items():
        forming = Forming(study, fabric, label.replace(" ", "_"))
        runs[label] = forming, forming.run()
    pictures(study, runs)
    found = {label: result.summary["quantities"] for label, (_, result) in runs.items()}
    if study.args.compare:
        study.summarise(study.folder(), converged=True, stroke_reached=1.0, quantities=found)
    for label, q in found.items():
        study.say(
            f"{label or study.args.out}: punch force {q['punch_force_N']:.5g} N, largest shear angle {q['shear_angle_max_deg']:.2f} deg, "
            f"draw-in {q['draw_in']['largest_mm']:.2f} mm, penetration {100 * q['penetration_of_thickness']:.2g} % of the thickness"
        )


if __name__ == "__main__":
    run("double_dome", options(), main)
