"""One element against closed form and kernel under uniaxial, biaxial and shear loads: Fig. 7 of
Schäfer et al."""

from functools import partial

from fabric_fenicsx.cli.study import parser, run
from fabric_fenicsx.core.errors import SolverFailure
from fabric_fenicsx.coupons.coupon import Coupon
from fabric_fenicsx.energy.membrane import Membrane
from fabric_fenicsx.sheet.blank import Blank
from fabric_fenicsx.sheet.specimen import specimen
from fabric_fenicsx.studies.lib.single_element import LABELS, MODELS, compare

AGREEMENT = 1e-9  # of the stresses at a state, or of s1 where they are smaller


def options():
    p = parser(Coupon, __doc__, "single_element", element="Q1")
    p.group("test")
    how = {"type": int, "default": 47, "choices": range(3, 1001), "metavar": "N"}
    p.option("--points", **how, help="states a path, 3 to 1000")
    return p


def draw(path, series, labels):
    """Diagrams side by side, of {title: {(label, model): (x, closed form, kernel, elements)}} and
    {title: (x label, y label, x limits)}: closed form is a line (the second model's dashed), the
    kernel a square, elements a dot."""
    from fabric_fenicsx.results.pictures import figure

    with figure(path, (11, 8), 2, (len(series) + 1) // 2) as (_, axes):
        for ax, (title, curves) in zip(axes.flat, series.items()):
            labelled, models = (list(dict.fromkeys(each)) for each in zip(*curves))
            for (label, model), (x, closed, kernel, elements) in curves.items():
                is_first, colour = model == models[0], f"C{labelled.index(label)}"
                style = {"ls": "-", "label": label} if is_first else {"ls": "--"}
                ax.plot(x, closed, color=colour, lw=1, **style)
                ax.plot(x[::4], kernel[::4], "s", color=colour, ms=5, mfc="none", mew=0.6)
                ax.plot(x[2::4], elements[2::4], ".", color=colour, ms=4)
            lines = ", ".join(f"{m} {s}" for m, s in zip(models, ("(line)", "(dashed)")))
            ax.set_title(f"{title}: {lines}", fontsize="medium")
            ax.set(**dict(zip(("xlabel", "ylabel", "xlim"), labels[title])))
            ax.grid(alpha=0.3)
            ax.legend(fontsize="small")


def main(study):
    args, folder = study.args, study.folder()
    cell = "triangle" if args.element[0] == "P" else "quadrilateral"
    arrays = specimen(1.0, 1.0, 1, 1, "crossed", cell)
    blank = Blank.from_arrays(study.comm, *arrays, degree=int(args.element[1]))
    fabrics = dict(zip(MODELS, (study.fabric, study.fabric.decoupled())))
    membrane = partial(Membrane, integration=args.integration or "full")
    found = compare(fabrics, blank, membrane, args.points, min(args.tolerance, 1e-12))
    largest = found.largest
    agree = max(largest.values()) <= AGREEMENT
    study.summarise(
        folder,
        converged=agree,
        stroke_reached=1.0,
        dofs=blank.V.dofmap.index_map.size_global * 2,
        cells=blank.mesh.topology.index_map(2).size_global,
        terms=["membrane"],
        material=study.fabric.name,
        couplings=sorted(study.fabric.couplings),
        kernel_mismatch=study.comm.allreduce(found.kernel_mismatch, op=max),
        quantities={"largest_difference": largest, "differences": found.differences},
    )
    study.write_table(folder / "curves.csv", list(found.rows()))
    if study.comm.rank == 0 and not args.no_pictures:
        draw(folder / "fig7.png", found.panels(), LABELS)
    study.say(
        f"{folder}: {len(found.curves)} curves; largest difference to closed form: "
        f"elements {largest['elements']:.1e}, kernel {largest['kernel']:.1e}"
    )
    if not agree:
        wrong = f"elements or kernel differ from the closed form by more than {AGREEMENT}"
        raise SolverFailure(f"{wrong}; see summary.json")


if __name__ == "__main__":
    run("single_element", options(), main)
