"""Forming over the double dome beside the results of an explicit code, OpenRadioss, on the same
mesh with the same law and tools: yarns at 0/90, or with --fibre-angle 45 at +-45 deg."""

from pathlib import Path

from bench import explicit_code

from fabric_fenicsx.command_line.forming_study import DomeTest, build, dome_parser
from fabric_fenicsx.command_line.study import Study, run

REFERENCE = Path(__file__).resolve().parents[1] / "studies" / "reference" / "openradioss"
SAME = {  # as in OpenRadioss, which has rigid contact, and no bending: ours is small
    "material": str(REFERENCE / "tab.toml"),
    "holder": "force",
    "holder_force": 20000.0,
    "bending_modulus": 20.0,
    "twist_modulus": 0.0,
    "penalty": 333.0,  # N/mm^3: 2 % of stretch over the die's radius press the ply 1.25 % deep
}


def options():
    return dome_parser(DomeTest, __doc__, name="openradioss", **SAME)


def main(study: Study):
    explicit_code.check_angle(study.args.fibre_angle)
    forming = build(study, DomeTest)
    result, found = study.run(forming), None
    if study.comm.rank == 0:
        found = explicit_code.compare_formed(
            REFERENCE, forming.sheets[0].fibre_angle, result.grid, result.rows
        )
    found = study.comm.bcast(found)
    study.write_table(result.folder / "openradioss.csv", [found])
    for name, value in found.items():
        study.say(f"{name:40s} {value:.4g}")


if __name__ == "__main__":
    run("openradioss", options(), main)
