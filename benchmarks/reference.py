"""Reference values with error bars for three strips, extrapolated over finer and finer meshes; what
other runs are measured by. Mesh, element and steps are the scenes' own."""

import shlex
import sys

from bench.once import once
from bench.reference import convergence, make_reference, solve_member
from bench.strips import STRIPS

from fabric_fenicsx.command_line.study import parser, run
from fabric_fenicsx.coupons.coupon import Coupon


def options():
    p = parser(Coupon, __doc__, "reference")
    p.group("test")
    p.option("--scenes", nargs="+", choices=tuple(STRIPS), default=list(STRIPS))
    return p


def main(study):
    args, folder, found = study.args, study.folder(), {}

    def solve(name, strip, how):
        problem = study.comm, study.fabric, strip, how, args.tolerance, args.linear_solver
        member = once(study, f"{name} {how}", lambda: solve_member(*problem))
        study.say(
            f"{name}  {how!s:28s} {member['dofs']:7d} dofs {member['iterations']:4d} iterations "
            f"{member['wall_s']:7.1f} s  reaction {member['values']['reaction_N']:.8g} N"
        )
        return member

    for name in args.scenes:
        found[name] = make_reference(name, lambda *how, name=name: solve(name, *how), args.quick)
        if study.comm.rank == 0:
            command = shlex.join([".venv/bin/python", "benchmarks/reference.py", *sys.argv[1:]])
            found[name].write(folder, command, study.fabric)
        r = found[name].quantities["reaction_N"]
        order = "finest mesh" if r["order"] is None else f"order {r['order']:.2g}"
        value = f"{r['value']:.6g} +- {r['error']:.2g} N"
        study.say(f"{folder}/{name}.json: reaction {value}, {order}")
    quantities = {name: reference.quantities for name, reference in found.items()}
    study.summarise(folder, converged=True, stroke_reached=1.0, quantities=quantities)
    if study.comm.rank == 0 and not args.no_pictures:
        from fabric_fenicsx.plot.pictures import curves

        labels = "unknowns", "error of the reaction, relative", "log"
        curves(folder / "convergence.png", convergence(found.values()), *labels)


if __name__ == "__main__":
    run("reference", options(), main)
