"""Reference values with error bars for three strips, extrapolated over finer and finer meshes; what
other runs are measured by. Mesh, element and steps are the scenes' own."""

import shlex
import sys
import time

import bench
from bench.reference import LOADS, make_reference
from bench.strips import STRIPS, camera_displacements, pull, strip_scene, strip_values

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import run
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.settings import Settings

SETTINGS = Settings(steps=20, path_tolerance=None, milestones=LOADS[1:])


def options():
    p = bench.options("reference", __doc__)
    p.option("--scenes", nargs="+", choices=tuple(STRIPS), default=list(STRIPS))
    return p


def solved(study, name, mesh):
    """Values, reactions at LOADS [N], cost and the camera's displacements on one mesh."""
    args, began = study.args, time.perf_counter()
    degree = int(mesh[1])  # of quadrature, with which the files of studies/reference were made
    scene = strip_scene(study.comm, study.fabric, name, mesh, degree, "full")
    newton = Newton(scene, args.tolerance, linear_solver=args.linear_solver)
    outcome, (loads, forces) = pull(newton, SETTINGS)
    if outcome.reason:
        raise ff.SolverFailure(f"{mesh}: {outcome.reason}")
    reaction, values = dict(zip(loads, forces.tolist())), strip_values(scene)
    del values["shear_deg_min"]  # 0 somewhere
    member = {"dofs": 2 * scene.blank.V.dofmap.index_map.size_global, "steps": outcome.accepted}
    member |= {"iterations": outcome.iterations, "values": values}
    member |= {"wall_s": round(time.perf_counter() - began, 2)}
    member["reactions_N"] = [reaction[load] for load in LOADS]
    return member | {"seen": camera_displacements(scene).tolist()}


def main(study):
    args, folder, found = study.args, study.folder(), {}
    command = shlex.join([".venv/bin/python", "benchmarks/reference.py", *sys.argv[1:]])
    for name in args.scenes:
        strip, members = STRIPS[name], {}
        series = strip.series[:2] if args.quick else strip.series
        for mesh in (*series, *(() if args.quick else strip.checks)):
            key = f"{name} {mesh}"
            members[mesh] = m = solved(study, name, mesh)
            study.say(
                f"{key:36s} {m['dofs']:7d} dofs {m['iterations']:4d} iterations "
                f"{m['wall_s']:7.1f} s  reaction {m['values']['reaction_N']:.8g} N"
            )
        if study.comm.rank == 0:
            facts = {"command": command, "material": study.fabric.dumps()}
            found[name] = make_reference(folder, name, series, members, **facts)
            r = found[name]["reaction_N"]
            value = f"{r['value']:.6g} +- {r['error']:.2g} N"
            study.say(f"{folder}/{name}.json: reaction {value}, of order {r['order']}")
    bench.finish(study, {}, quantities=found)


if __name__ == "__main__":
    run("reference", options(), main)
