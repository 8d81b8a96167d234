"""Forming over the double dome beside the results of an explicit code, OpenRadioss, on the same
mesh with the same law and tools: yarns at 0/90, or with --fibre-angle 45 at +-45 deg."""

from pathlib import Path

from bench import explicit_code

import fabric_fenicsx as ff
from fabric_fenicsx.cli.study import run
from fabric_fenicsx.studies.lib.press_study import PressStudy, press_parser

REFERENCE = Path(__file__).resolve().parents[1] / "studies" / "reference" / "openradioss"
SAME = (  # as in OpenRadioss, which has rigid contact, and no bending: ours is small
    f"fabric={REFERENCE / 'tab.toml'}",
    "nx=47",
    "holder.force=20000",
    "blank.bending_modulus=20",
    "blank.twist_modulus=0",
    "contact.penalty=333",  # N/mm^3: 2 % of stretch over the die's radius press the ply 1.25 % deep
)


def main(study: PressStudy):
    press = study.read(*SAME)
    if (angle := press.sheets[0].fibre_angle) not in (0, 45):
        raise ff.InputError(f"`fibre_angle` is {angle:g}; expected 0 and 45, as OpenRadioss'")
    result, found = study.run(study.build(press)), None
    if study.comm.rank == 0:
        found = explicit_code.compare_formed(REFERENCE, int(angle), result.grid, result.rows)
    found = study.comm.bcast(found)
    study.write_table(result.folder / "openradioss.csv", [found])
    for name, value in found.items():
        study.say(f"{name:40s} {value:.4g}")


if __name__ == "__main__":
    options = press_parser(__doc__, "openradioss", "double_dome")
    options.set_defaults(error=False)  # as it has the mesh of the other code
    run("openradioss", options, main, PressStudy)
