"""Loss of convexity and ellipticity of the law over the yarn strains: maps for Table 1, other
p_min, c, d and s_C."""

import numpy as np

from fabric_fenicsx.cli.study import parser, run
from fabric_fenicsx.core.errors import InputError, SolverFailure
from fabric_fenicsx.coupons.coupon import Coupon
from fabric_fenicsx.studies.lib.stability_maps import HIGH, LOW, kernel_difference, stability_maps

AGREEMENT = 1e-9  # of the kernel's stresses with the closed form, or of s1 where they are smaller
LOST = {"stable": "#f2f2f2", "convexity lost": "#f4b942"}
LOST |= {"ellipticity lost": "#7fb2d9", "both lost": "#b0413e"}


def options():
    p = parser(Coupon, __doc__, "stability_map")
    p.group("map")
    how = {"type": int, "choices": range(11, 2001), "metavar": "N"}
    p.option("--points", **how, help="states along each axis, 11 to 2000 (225, with --quick 57)")
    return p


def draw(path, x, panels):
    """Where two indicators are negative, over a square grid: {(row, column): (convexity,
    ellipticity)}, each (n, n) with x (n,) along its last axis."""
    from matplotlib.colors import ListedColormap

    from fabric_fenicsx.results.pictures import figure, label_outer

    rows, columns = (list(dict.fromkeys(key[k] for key in panels)) for k in (0, 1))
    size = 2.1 * len(columns) + 0.6, 2.4 * len(rows) + 1.2
    colours = {"cmap": ListedColormap(list(LOST.values())), "vmin": -0.5, "vmax": 3.5}
    with figure(path, size, len(rows), len(columns), sharex=True, sharey=True) as (page, axes):
        for (row, column), (convexity, ellipticity) in panels.items():
            ax = axes[rows.index(row), columns.index(column)]
            lost = (convexity < 0) + 2 * (ellipticity < 0)
            image = ax.pcolormesh(x, x, lost, rasterized=True, **colours)
            ax.axhline(0, color="k", lw=0.4)
            ax.axvline(0, color="k", lw=0.4)
            ax.set_aspect("equal")
            ax.set_title(f"{column}, {row}", fontsize="small")
        label_outer(axes, r"$\varepsilon_a$ / %", r"$\varepsilon_b$ / %")
        place = {"location": "bottom", "fraction": 0.05, "aspect": 60, "pad": 0.02}
        bar = page.colorbar(image, ax=list(axes.flat), ticks=range(4), **place)
        bar.ax.set_xticklabels(list(LOST))


def main(study):
    args, fabric = study.args, study.fabric
    if missing := {"p_min", "c", "d"} - {*fabric.parameters}:
        law = f"--material {args.material} has the law {fabric.law}"
        raise InputError(f"{law}, which has no {', '.join(missing)}; expected one that has")
    folder = study.folder()
    e = np.linspace(LOW, HIGH, args.points or (57 if args.quick else 225))
    maps, shares = stability_maps(fabric, e)
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
        quantities={"states_per_map": len(e) ** 2, "share_of_map_lost": shares},
    )
    if study.comm.rank == 0 and not args.no_pictures:
        for name, panels in maps.items():
            draw(folder / f"{name}.png", 100 * e, panels)
    study.say(f"{folder}: {sum(map(len, maps.values()))} maps")
    if difference > AGREEMENT:
        more = f"by {difference:.1e}, more than {AGREEMENT}"
        raise SolverFailure(f"kernel and closed form differ {more}, so the maps are not reliable")


if __name__ == "__main__":
    run("stability_map", options(), main)
