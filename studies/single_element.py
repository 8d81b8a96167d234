"""One element against closed form and kernel under uniaxial, biaxial and shear loads: Fig. 7 of Schäfer et al."""

import csv

import numpy as np

from fabric_fenicsx.blank import Blank
from fabric_fenicsx.errors import SolverFailure
from fabric_fenicsx.material import pointwise
from fabric_fenicsx.material.closed_form import nominal_stresses
from fabric_fenicsx.material.homogeneous import lateral_strain
from fabric_fenicsx.material.paths import PATHS, conjugate, gradient
from fabric_fenicsx.meshes.specimen import specimen
from fabric_fenicsx.scene import Scene, grips
from fabric_fenicsx.solve.newton import Newton
from fabric_fenicsx.solve.stepping import march
from fabric_fenicsx.study import parser, run

FREE = "free uniaxial a"
AGREEMENT = 1e-9  # of the stresses at a state, or of s1 where they are smaller
PANELS = {
    "(a) uniaxial": (("constrained uniaxial a", 0, "a"), ("constrained uniaxial a", 1, "a"), (FREE, 0, "a")),
    "(b) biaxial": (("equibiaxial", 0, "a"), ("biaxial 2:1", 0, "a"), ("biaxial 1:2", 0, "a")),
    "(c) compression": (("in-plane compression", 0, "a"), ("in-plane compression", 1, "a")),
    "(d) shear": tuple((f"shear, {x}", 2, "g") for x in ("1 % pre-tension", "5 % pre-compression", "20 % pre-compression")) + (("pure shear", 2, "g"),),
}  # fmt: skip


def options():
    p = parser("single_element", __doc__, element="Q1")
    p.add_argument_group("test").add_argument(
        "--points", type=int, default=47, choices=range(3, 1001), metavar="N", help="states a path, 3 to 1000"
    )
    return p


def element(study, fabric):
    points, cells, kind = specimen(
        1.0, 1.0, 1, 1, "crossed", "triangle" if study.args.element[0] == "P" else "quadrilateral"
    )
    return study.membrane(Blank.from_arrays(study.comm, points, cells, kind, degree=int(study.args.element[1])), fabric)


def prescribed(membrane, strains):
    """Conjugate stresses (n, 3) of finite elements at prescribed states (3, n), and the kernel's mismatch with UFL."""
    scene = Scene(membrane.blank, [membrane])
    F, x = gradient(*strains), membrane.blank.coordinates()[:, :2]
    P, r, mismatch = np.empty_like(F), scene.u.duplicate(), 0.0
    for k in range(len(F)):
        membrane.blank.u.x.array[:] = (x @ (F[k] - np.eye(2)).T).ravel()
        scene.residual(r)
        P[k] = scene.virial() / membrane.fabric.thickness
        mismatch = max(mismatch, membrane.state()[3])
    return conjugate(P, F), mismatch


def free_uniaxial(membrane, eps_a, tolerance):
    """Lateral strains (n,) and conjugate stresses (n, 3) that elements find under free tension to each of `eps_a`."""
    membrane.blank.u.x.array[:] = 0
    scene = Scene(membrane.blank, [membrane], grips(membrane.blank, eps_a[-1], clamped=False))
    found = [(0.0, 0.0)]

    def accept(accepted):
        if accepted.load > 0:
            across = np.sqrt(membrane.state()[0].invariants[:, :, 2]) - 1
            across = np.concatenate(scene.comm.allgather(across.ravel()))  # of one or two cells in all
            found.append((across.mean(), scene.reaction("moving grip")[0] / membrane.fabric.thickness))

    outcome = march(Newton(scene, tolerance), steps=len(eps_a) - 1, on_accept=accept)
    if outcome.reached < 1 or len(found) != len(eps_a):
        raise SolverFailure(outcome.reason or "free uniaxial tension needed cuts")
    lateral, stress = np.array(found).T
    return lateral, np.stack([stress, 0 * stress, 0 * stress], -1)


def main(study):
    args, s = study.args, np.linspace(0, 1, study.args.points)
    folder = study.folder()
    results, worst, mismatch = {}, {}, 0.0
    for model, fabric in {"hyperelastic": study.fabric, "FABRIC": study.fabric.decoupled()}.items():
        membrane = element(study, fabric)
        for name in [*PATHS, FREE]:
            if name == FREE:
                eps_a = 0.03 * s
                lateral, fe = free_uniaxial(membrane, eps_a, min(args.tolerance, 1e-12))
                strains = np.stack([eps_a, lateral_strain(fabric, 0, eps_a), 0 * s])
                difference = np.abs(lateral - strains[1]).max()
            else:
                strains, difference = np.stack(PATHS[name](s)), 0.0
                fe, gap = prescribed(membrane, strains)
                mismatch = max(mismatch, gap)
            F = gradient(*strains)
            kernel = conjugate(F @ pointwise.evaluate(fabric, gradient=F).S, F)
            closed = np.stack(nominal_stresses(fabric, *strains), -1)
            scale = np.maximum(np.linalg.norm(closed, axis=1), fabric.s1)[:, None]
            gaps = [float((np.abs(x - closed) / scale).max()) for x in (fe, kernel)]
            worst[f"{model}: {name}"] = {"elements": max(gaps[0], difference), "kernel": gaps[1]}
            results[model, name] = strains, closed, kernel, fe
    largest = {leg: max(w[leg] for w in worst.values()) for leg in ("elements", "kernel")}
    agree = max(largest.values()) <= AGREEMENT
    mesh = membrane.blank
    study.summarise(
        folder, converged=agree, stroke_reached=1.0, dofs=mesh.V.dofmap.index_map.size_global * 2, cells=mesh.mesh.topology.index_map(2).size_global,
        terms=[membrane.name], material=study.fabric.name, couplings=sorted(study.fabric.couplings), kernel_mismatch=study.comm.allreduce(mismatch, op=max),
        quantities={"largest_difference": largest, "differences": worst},
    )  # fmt: skip
    if study.comm.rank == 0:
        write(folder / "curves.csv", results)
        if not args.no_pictures:
            picture(folder / "fig7.png", results)
    study.say(
        f"{folder}: {len(results)} curves; largest difference to closed form: elements {largest['elements']:.1e}, kernel {largest['kernel']:.1e}"
    )
    if not agree:
        raise SolverFailure(
            f"elements or kernel differ from the closed form by more than {AGREEMENT}; see summary.json"
        )


def write(path, results):
    stresses = ("sigma_a", "sigma_b", "tau")
    with open(path, "w", newline="") as file:
        out = csv.writer(file)
        out.writerow(
            [
                "model",
                "path",
                "eps_a",
                "eps_b",
                "gamma_deg",
                *(f"{n}_{leg}_MPa" for leg in ("closed_form", "kernel", "elements") for n in stresses),
            ]
        )
        for (model, name), (strains, *legs) in results.items():
            for row in np.column_stack([strains[0], strains[1], np.degrees(strains[2]), *legs]):
                out.writerow([model, name, *row])


def picture(path, results):
    from fabric_fenicsx.results.pictures import panels

    series = {}
    for title, curves in PANELS.items():
        series[title] = {}
        for name, component, over in curves:
            for model in ("hyperelastic", "FABRIC"):
                strains, closed, kernel, fe = results[model, name]
                x = 100 * strains[0] if over == "a" else np.degrees(strains[2])
                label = f"{name}, {('along a', 'along b', 'shear')[component]}"
                series[title][label, model] = x, closed[:, component], kernel[:, component], fe[:, component]
    strain = r"$\varepsilon_a$ / %", "nominal stress / MPa"
    labels = dict.fromkeys(series, (*strain, (-1, 3.2))) | {
        "(c) compression": (*strain, None),
        "(d) shear": ("shear angle / deg", strain[1], (0, 62)),
    }
    panels(path, series, labels)


if __name__ == "__main__":
    run("single_element", options(), main)
