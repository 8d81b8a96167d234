"""Forming in a press of your own: blank, tools, holders and stages from a file."""

from fabric_fenicsx.command_line.press_study import PressStudy, press_parser
from fabric_fenicsx.command_line.study import run
from fabric_fenicsx.forming.unloading import unloading
from fabric_fenicsx.runtime.errors import SolverFailure
from fabric_fenicsx.runtime.formatting import percent, rounded


def main(study: PressStudy):
    press = study.press()
    try:
        result = study.run(press)
    except SolverFailure as failure:
        if failure.result:
            tell(study, press, failure.result)
        if press.schedule.unloads:
            study.say("the blank is not unloaded, as the forming is not believed")
        raise
    tell(study, press, result)
    if press.schedule.unloads:
        unloaded = study.run_job(unloading(result), "unloaded")
        found = unloaded.summary["quantities"]
        sheets = found.get("sheets") or {"the blank": found}
        back = [
            f"{name} by up to {rounded(each['springback_largest_mm'])} mm"
            for name, each in sheets.items()
        ]
        study.say(f"{study.args.out}/unloaded: without tools springs back {', '.join(back)}")


def tell(study, press, result):
    found = result.summary["quantities"]
    study.say(
        f"{study.args.out}: {press.force_name()} {result.formatted('force_N', '.5g')} N"
        f"{press.of_whole(found)}, largest shear angle "
        f"{result.formatted('shear_angle_max_deg', '.2f')} deg (99 % of the area below "
        f"{result.formatted('shear_angle_99_percent_deg', '.2f')}), draw-in "
        f"{result.formatted('draw_in.largest_mm', '.2f')} mm, yarns shortened by "
        f"{percent(found.get('shortening_mean') or 0.0, 3)} in the mean"
    )


if __name__ == "__main__":
    run("form", press_parser(__doc__), main, PressStudy)
