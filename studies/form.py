"""Forming in a press of your own: blank, tools, holders and stages from a file."""

from fabric_fenicsx.cli.options import Parser, option_type
from fabric_fenicsx.cli.study import run
from fabric_fenicsx.core.errors import InputError, SolverFailure
from fabric_fenicsx.core.formatting import percent, rounded
from fabric_fenicsx.core.rules import POSITIVE
from fabric_fenicsx.job.validity import AIM, MIN_CELLS, coarsest_waves
from fabric_fenicsx.press.unloading import unloading
from fabric_fenicsx.results.verdict import INVALID, Reason
from fabric_fenicsx.studies.lib.coupling_variants import coupling_variants
from fabric_fenicsx.studies.lib.press_study import PressStudy, press_parser
from fabric_fenicsx.sweep.folder import REFINED, flat


def options(description: str | None, press: str = "") -> Parser:
    """The options of the example `press`, by default of the press that the command names."""
    p = press_parser(description, press or "form", press)
    p.group("more runs")
    p.switch("--compare", "run all variants of the couplings")
    words = f"if a wave has fewer than {MIN_CELLS:g} cells, repeat the run with {AIM:g}"
    p.switch("--refine", words)
    words = "also run the whole blank with the leading tool displaced [mm], and report changes"
    aside = {"metavar": "MM", "type": option_type(POSITIVE)}
    p.option("--disturb", **aside, help=words, free=True)
    return p


def main(study: PressStudy):
    if study.args.compare:
        compared(study, study.read())
        return
    press = study.build(study.read())
    try:
        result = study.run(press)
    except SolverFailure as failure:
        if failure.result:
            tell(study, press, failure.result, study.args.out)
        if press.schedule.unloads:
            study.say("the blank is not unloaded, as the forming is not valid")
        raise
    tell(study, press, result, study.args.out)
    if study.args.refine:
        press, result = refined(study, press, result)
    if study.args.disturb:
        disturbed(study, press, result)
    if press.schedule.unloads:
        unloaded = study.run_job(unloading(result), "unloaded")
        found = unloaded.summary["quantities"]
        sheets = found.get("sheets") or {"the blank": found}
        back = [
            f"{name} by up to {rounded(each['springback_largest_mm'])} mm"
            for name, each in sheets.items()
        ]
        study.say(f"{study.args.out}/unloaded: springback of {', '.join(back)}")


def compared(study, press):
    """Run the variants of the couplings, and lay them side by side."""
    if study.args.refine or study.args.disturb:
        raise InputError("`compare` is not allowed with `refine` and `disturb`")
    results, failed = {}, []
    for label in coupling_variants(press.fabric):
        made = study.build(press.with_fabrics(lambda f, label=label: coupling_variants(f)[label]))
        try:
            results[label] = study.run(made, label.replace(" ", "_"))
        except SolverFailure as failure:
            if not failure.result:
                raise
            results[label] = failure.result
            failed.append(f"{label}: {failure}")
        tell(study, made, results[label], label)
    reached = {label: r.summary["stroke_reached"] for label, r in results.items()}
    numbers = {label: flat(r.summary["quantities"]) for label, r in results.items()}
    rows = [{"variant": n, "stroke_reached": reached[n], **each} for n, each in numbers.items()]
    folder = study.folder()
    study.write_table(folder / "variants.csv", rows)
    if study.comm.rank == 0 and not study.args.no_pictures:
        from fabric_fenicsx.press.pictures import compare
        from fabric_fenicsx.results import pictures

        compare(results, folder, made.leader(), made.sheets)
        labels = "stroke / mm", f"{made.force_name} / N"
        pictures.reactions(folder / "compare_curves.png", results, *labels)
    least = min(reached.values())
    for reason in failed:
        study.output.doubt(Reason(reason, verdict=INVALID))
    study.summarise(folder, converged=not failed, stroke_reached=least, quantities=numbers)
    if failed:
        raise SolverFailure("; ".join(failed))


def refined(study, press, result):
    """The press and result of cells that wrinkles need, in a folder of theirs, or those given."""
    for part in REFINED:
        waves = coarsest_waves(result.summary["quantities"])
        if not waves:
            break
        press = study.build(press.finer(AIM / waves["cells_a_wave"]))
        result = study.run(press, part)
        tell(study, press, result, result.folder)
    return press, result


def disturbed(study, press, result):
    """Run the whole blank with a tool aside, into the folder disturbed; tell what that changes."""
    other = study.build(press.disturbed(study.args.disturb))
    try:
        found = study.run(other, "disturbed")
    except SolverFailure as failure:
        if failure.result and failure.result.summary["stroke_reached"] == 1:
            _compare(study, press, result, failure.result)
        raise
    tell(study, other, found, found.folder)
    _compare(study, press, result, found)


def _compare(study, press, result, found):
    from fabric_fenicsx.results.wrinkles import MIN_HEIGHT

    names = "force_of_whole_blank_N", "shear_angle_99_percent_deg", "wrinkles.height_mm"
    numbers = {name: (result.number(name), found.number(name)) for name in names}
    both = {name: two for name, two in numbers.items() if None not in two}
    words = [
        f"{name} {rounded(a)}, then {rounded(b)}"
        for name, (a, b) in both.items()
        if abs(b - a) > max(0.05 * abs(a), MIN_HEIGHT if name.endswith("_mm") else 0.0)
    ]
    if words:
        study.warn(
            f"with {press.leader().name} {study.args.disturb:g} mm aside and the whole blank the "
            f"result differs: {'; '.join(words)}. Real presses are never exactly symmetric"
        )
    ends = {name: b for name, (_, b) in both.items()}
    result.summary = study.output.amend(result.folder, result.summary, disturbed=ends)


def tell(study, press, result, folder):
    found = result.summary["quantities"]
    whole = f", {rounded(found['force_of_whole_blank_N'], 5)} N on all of it"
    study.say(
        f"{folder}: {press.force_name} {result.formatted('reaction_N', '.5g')} N"
        f"{whole if press.data.planes else ''}, largest shear angle "
        f"{result.formatted('shear_angle_max_deg', '.2f')} deg (99th percentile "
        f"{result.formatted('shear_angle_99_percent_deg', '.2f')}), draw-in "
        f"{result.formatted('draw_in.largest_mm', '.2f')} mm, yarns shortened by "
        f"{percent(found.get('shortening_mean') or 0.0, 3)} on average"
    )


if __name__ == "__main__":
    run("form", options(__doc__), main, PressStudy)
