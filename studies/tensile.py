"""Uniaxial tension of a woven strip along its yarns, with clamped ends: Figs 8 and 10 of Schäfer et
al."""

from fabric_fenicsx.cli.study import Study, parser, run
from fabric_fenicsx.coupons.tensile import Tensile
from fabric_fenicsx.job.job import Result
from fabric_fenicsx.studies.lib.coupling_variants import coupling_variants


def options():
    p = parser(Tensile, __doc__)
    p.group("test")
    p.switch("--compare", "run all variants of the couplings")
    return p


def main(study: Study):
    if not study.args.compare:
        result = study.run(study.build(study.describe(Tensile)))
        reaction = result.formatted("reaction_N")
        study.say(f"{result.folder}: reaction {reaction} N, {strains_across(result)}")
        return
    folder, results = study.folder(), {}
    for name, fabric in coupling_variants(study.fabric).items():
        strip = study.build(study.describe(Tensile, fabric))
        results[name] = study.run(strip, name.replace(" ", "_"))
    found = {
        name: r.summary["quantities"] | {"reaction_N": r.summary["reaction_N"]}
        for name, r in results.items()
    }
    facts = {"quantities": found, "variants": sorted(found)}
    study.summarise(folder, converged=True, stroke_reached=1.0, **facts)
    if study.comm.rank == 0 and not study.args.no_pictures:
        from fabric_fenicsx.results import pictures

        names = "log_eps_11", "log_eps_22", "shear_angle"
        pictures.maps(folder / "compare.png", {k: r.grid for k, r in results.items()}, names)
        pictures.reactions(folder / "compare_curves.png", results)
    for name, r in results.items():
        study.say(f"{name:24s} reaction {r.formatted('reaction_N', '9.4f')} N, {strains_across(r)}")


def strains_across(result: Result) -> str:
    """Sentence on the strain along yarns b at the middle, which finer meshes keep, and on the least
    of a cell, which they need not."""
    at = "no cell at the middle"
    if result.number("log_eps_22_middle") is not None:
        middle = result.formatted("log_eps_22_middle", ".2f", 100)
        at = f"log strain along yarns b at the middle {middle} %"
    least = result.formatted("log_eps_22_min", ".2f", 100)
    return f"{at} (minimum of a cell {least} %, which depends on the mesh)"


if __name__ == "__main__":
    run("tensile", options(), main)
