"""Where the law loses convexity and ellipticity, over the yarn strains: maps for Table 1, other
p_min, c, d, s_C, and thresholds."""

import numpy as np

from fabric_fenicsx.command_line.study import parser, run
from fabric_fenicsx.coupons.scenario import Scenario
from fabric_fenicsx.runtime.errors import SolverFailure
from fabric_fenicsx.studies.lib.stability_maps import kernel_difference, stability_maps
from fabric_fenicsx.studies.lib.stability_thresholds import HIGH, LOW, thresholds

AGREEMENT = 1e-9  # of the kernel's stresses with the closed form, or of s1 where they are smaller


def options():
    p = parser(Scenario, __doc__, "stability_map")
    p.group("map")
    p.option(
        "--points",
        type=int,
        choices=range(11, 2001),
        metavar="N",
        help="states along each axis, 11 to 2000 (225, with --quick 57)",
    )
    return p


def main(study):
    args, fabric = study.args, study.fabric
    fabric.require(("p_min", "c", "d"), f"--material {args.material}")
    folder = study.folder()
    e = np.linspace(LOW, HIGH, args.points or (57 if args.quick else 225))
    maps, shares = stability_maps(fabric, e)
    rows = thresholds(fabric)
    difference = kernel_difference(fabric, e[:: max(1, len(e) // 57)])
    study.summarise(
        folder,
        converged=difference <= AGREEMENT,
        stroke_reached=1.0,
        dofs=0,
        cells=0,
        terms=[],
        material=fabric.name,
        couplings=sorted(fabric.couplings),
        kernel_mismatch=difference,
        quantities={"states_per_map": len(e) ** 2, "thresholds": rows, "share_of_map_lost": shares},
    )
    study.write_table(folder / "thresholds.csv", rows)
    if study.comm.rank == 0 and not args.no_pictures:
        from fabric_fenicsx.plot.pictures import regions

        labels = r"$\varepsilon_a$ / %", r"$\varepsilon_b$ / %"
        for name, panels in maps.items():
            regions(folder / f"{name}.png", 100 * e, panels, *labels)
    study.say(f"{folder}: {sum(map(len, maps.values()))} maps, {len(rows)} thresholds")
    if difference > AGREEMENT:
        more = f"by {difference:.1e}, more than {AGREEMENT}"
        raise SolverFailure(f"kernel and closed form differ {more}, so the maps can't be trusted")


if __name__ == "__main__":
    run("stability_map", options(), main)
